"""Directory of a campaign: its specification, the finished batches, and finally one Parquet file of all runs.

Every file is written atomically: to a temporary file, synchronised to the disk, then renamed. The Parquet files contain
no time and no machine, so the same campaign always gives the same bytes.
"""

from __future__ import annotations

import importlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py import ROOT, commit_of, version_text
from hil.errors import HilError, UsageError
from hil.lab.campaign.row import Result, failure
from hil.lab.campaign.scores import SCORE_NAMES
from hil.lab.campaign.spec import Spec
from hil.sim.run_directory import CAMPAIGN
from hil.sim.truth import Array

EXTRA = "rambler-autopilot[campaign]"


def import_extra(name: str) -> Any:
    """Import a module of the extra, or raise UsageError that names the package to install."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise UsageError(f"{name.partition('.')[0]} is not installed; pip install '{EXTRA}'") from None


RUNS, PARTS, SPEC, SUMMARY, PAGE = "runs.parquet", "parts", "spec.toml", "summary.json", "report.html"
PART = re.compile(r"(\d{8})-(\d{8})\.parquet")
ROWS_PER_GROUP = 1 << 16  # of a Parquet row group


@dataclass(frozen=True, slots=True)
class Store:
    """Directory of a campaign, which the caller has locked; `beside` is the directory of its specification."""

    directory: Path
    spec: Spec
    versions: dict[str, str]
    beside: Path = Path()

    def begin(self, *, resume: bool) -> None:
        """Begin or resume a campaign; raise UsageError if the directory has another one, or `resume` is missing."""
        path = self.directory / CAMPAIGN
        if not path.exists():
            # Files that remain if a campaign is killed while it starts.
            start_files = {PARTS, SPEC, f"{SPEC}.new", f"{CAMPAIGN}.new"}
            if any(entry.name not in start_files for entry in self.directory.iterdir()):
                raise UsageError(f"{self.directory} is not empty and contains no campaign; give another --out")
            (self.directory / PARTS).mkdir(exist_ok=True)
            write_file(self.directory / SPEC, self.spec.text.encode())
            write_file(path, (json.dumps(self._identity(), indent=2) + "\n").encode())
            return
        identity = read_identity(self.directory)
        # Before the digest, because another version may read the same specification differently.
        if identity.get("versions") != self.versions:
            differing = sorted(
                name
                for name in self.versions.keys() | identity.get("versions", {}).keys()
                if self.versions.get(name) != identity.get("versions", {}).get(name)
            )
            program_text = f" by {identity['program']}" if "program" in identity else ""
            raise UsageError(
                f"{self.directory} was begun{program_text} with other versions ({', '.join(differing)}), and "
                f"this is {program()}; use those versions, or give another --out"
            )
        if identity.get("digest") != self.spec.digest:
            raise UsageError(f"{self.directory} contains the campaign of another specification; give another --out")
        if not resume:
            raise UsageError(
                f"{self.directory} already contains this campaign; continue with --resume, or give another --out"
            )

    def _identity(self) -> dict[str, Any]:
        return {
            "digest": self.spec.digest,
            "runs": self.spec.runs,
            "versions": self.versions,
            "program": program(),
            "beside": str(self.beside),
        }

    def finished(self) -> list[tuple[int, int]]:
        """Return the ranges [first, last) of finished runs, sorted; delete incomplete files."""
        if (self.directory / RUNS).exists():
            return [(0, self.spec.runs)]
        parts = []
        (self.directory / PARTS).mkdir(exist_ok=True)  # may be missing if the results were deleted
        for path in (self.directory / PARTS).iterdir():
            if (match := PART.fullmatch(path.name)) is not None:
                parts.append((int(match[1]), int(match[2])))
            else:
                path.unlink()
        return sorted(parts)

    def add(self, first: int, last: int, results: Sequence[Result]) -> None:
        """Write a finished batch."""
        write_file(self.directory / PARTS / f"{first:08}-{last:08}.parquet", _encode(self._table(results)))

    def finish(self) -> None:
        """Merge all batches into one file and delete their files."""
        path, parts = self.directory / RUNS, self.directory / PARTS
        if not path.exists():
            tables = [read_table(parts / f"{first:08}-{last:08}.parquet") for first, last in self.finished()]
            write_file(path, _encode(import_extra("pyarrow").concat_tables(tables).combine_chunks()))
        if parts.exists():
            for part in parts.iterdir():
                part.unlink()
            parts.rmdir()

    def _table(self, results: Sequence[Result]) -> Any:
        pa = import_extra("pyarrow")
        rows = [result.row for result in results]
        outcomes = [result.outcome for result in results]
        scores = [{} if outcome.scores is None else asdict(outcome.scores) for outcome in outcomes]
        columns = {"row": pa.array([row.index for row in rows], pa.int64())}
        columns["seed"] = pa.array([row.seed for row in rows], pa.int64())
        for name in self.spec.drawn_names:
            values = [row.drawn_values[name] for row in rows]
            is_text = any(isinstance(value, str) for value in self.spec.draws[name].values)
            columns[name] = pa.array([str(value) for value in values] if is_text else values)
        for name in SCORE_NAMES:
            columns[name] = pa.array([score.get(name) for score in scores], pa.float64())
        columns["faults"] = pa.array([_join(outcome.faults) for outcome in outcomes], pa.string())
        columns["ended"] = pa.array([outcome.ended for outcome in outcomes], pa.string())
        columns["failed"] = pa.array([failure(outcome, self.spec.limits) for outcome in outcomes], pa.string())
        columns["digest"] = pa.array([outcome.digest for outcome in outcomes], pa.string())
        identity = {"rambler.spec": self.spec.digest, "rambler.sources": self.versions["sources"]}
        return pa.table(columns, metadata=identity)


def program() -> str:
    """Return the program and its commit, for messages only; results depend on `versions` alone."""
    return version_text("rambler-hil", commit_of(ROOT))


def _join(texts: tuple[str, ...] | None) -> str | None:
    return None if texts is None else "; ".join(texts)


def _encode(table: Any) -> bytes:
    sink = import_extra("pyarrow").BufferOutputStream()
    import_extra("pyarrow.parquet").write_table(
        table, sink, row_group_size=ROWS_PER_GROUP, compression="zstd", use_dictionary=False
    )
    return bytes(sink.getvalue())


def read_table(path: Path) -> Any:
    """Read a Parquet file, or raise HilError."""
    pa, parquet = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    try:
        return parquet.ParquetFile(path).read()
    except (OSError, pa.ArrowException) as error:
        text = getattr(error, "strerror", None) or " ".join(str(error).split())[:120]
        raise HilError(f"{path} cannot be read: {text}; remove it and continue with --resume") from None


def read_identity(directory: Path) -> dict[str, Any]:
    """Read campaign.json, or raise UsageError."""
    try:
        content = json.loads((directory / CAMPAIGN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        content = None
    if not isinstance(content, dict):
        raise UsageError(f"{directory} contains no campaign; give the --out of a campaign")
    return content


def result_files(directory: Path, index: int) -> list[Path]:
    """Return the files that may contain a run's results."""
    if (directory / RUNS).exists():
        return [directory / RUNS]
    if not (directory / PARTS).exists():
        return []
    names = ((path, PART.fullmatch(path.name)) for path in (directory / PARTS).iterdir())
    return [path for path, match in names if match is not None and int(match[1]) <= index < int(match[2])]


def write_file(path: Path, content: bytes) -> None:
    """Write a file atomically and synchronise it to the disk; raise HilError on failure."""
    new_path = path.with_name(path.name + ".new")
    try:
        with new_path.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        new_path.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise HilError(
            f"{path} cannot be written: {error.strerror}; free some space and continue with --resume"
        ) from None


def _sync(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def pending_batches(runs: int, finished: Sequence[tuple[int, int]], batch: int) -> Iterator[tuple[int, int]]:
    """Yield the batches [first, last), of at most `batch` runs, that are not finished."""
    next_run = 0
    for first, last in [*finished, (runs, runs)]:
        for begin in range(next_run, first, batch):
            yield begin, min(begin + batch, first)
        next_run = last


OUTCOME_COLUMNS = ("faults", "ended", "failed", "digest")


@dataclass(frozen=True, slots=True)
class Results:
    """Columns of all runs of a campaign, sorted by run; missing scores are NaN.

    `faults`: warnings of the autopilot, None for an engine without warnings. `failed`: the reason, or "".
    """

    directory: Path
    spec: str
    identity: Mapping[str, Any]
    seeds: NDArray[np.int64]
    drawn_values: Mapping[str, NDArray[Any]]
    scores: Mapping[str, Array]
    faults: NDArray[Any]
    failed: NDArray[Any]

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        return int(self.seeds.size)

    @property
    def failures(self) -> int:
        """Return the number of failed runs."""
        return int(np.count_nonzero(self.failed != ""))

    def text_of(self, name: str, row: int) -> str:
        """Return a drawn value of a run as text."""
        value = self.drawn_values[name][row]
        return value if isinstance(value, str) else f"{value:g}"


def read_results(directory: Path) -> Results:
    """Read the results of a finished campaign, or raise UsageError."""
    identity = read_identity(directory)
    if not (directory / RUNS).exists():
        raise UsageError(f"{directory}: the campaign is not finished; continue with --resume")
    table = read_table(directory / RUNS)
    names = table.column_names
    drawn_values = [name for name in names if name not in {"row", "seed", *SCORE_NAMES, *OUTCOME_COLUMNS}]

    def column(name: str) -> NDArray[Any]:
        return np.asarray(table.column(name).to_numpy())

    return Results(
        directory,
        (directory / SPEC).read_text(encoding="utf-8"),
        identity,
        column("seed"),
        {name: column(name) for name in drawn_values},
        {name: column(name) for name in SCORE_NAMES if name in names},
        column("faults"),
        column("failed"),
    )
