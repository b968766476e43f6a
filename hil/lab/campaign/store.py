"""The directory of a campaign: what is sailed, finished batches as they come, in the end one Parquet file of all runs.

Whatever is written stands whole or not at all: to a file beside it, onto the disk, then into its place. Nothing in the
Parquet files tells when or where a run was sailed, so they are the same bytes however they came about.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from firmware_py import ROOT, commit_of, version_text
from hil.errors import HilError, UsageError
from hil.lab.campaign.extra import imported
from hil.lab.campaign.outcome import Result, failure
from hil.lab.campaign.scores import LIMITED
from hil.lab.campaign.spec import Spec
from hil.sim.run_directory import CAMPAIGN

RUNS, PARTS, SPEC, SUMMARY, PAGE = "runs.parquet", "parts", "spec.toml", "summary.json", "report.html"
PART = re.compile(r"(\d{8})-(\d{8})\.parquet")
GROUP_ROWS = 1 << 16  # of the final file


@dataclass(frozen=True, slots=True)
class Store:
    """The directory of a campaign, which the caller holds; `beside` is where its specification came from."""

    directory: Path
    spec: Spec
    versions: dict[str, str]
    beside: Path = Path()

    def begin(self, *, resume: bool) -> None:
        """Begin a campaign, or take up the same one; UsageError where there is another, or where it goes on unasked."""
        path = self.directory / CAMPAIGN
        if not path.exists():
            # A campaign that was killed as it began has left some of this.
            begun = {PARTS, SPEC, f"{SPEC}.new", f"{CAMPAIGN}.new"}
            if any(one.name not in begun for one in self.directory.iterdir()):
                raise UsageError(f"{self.directory} is not empty and holds no campaign; give another --out")
            (self.directory / PARTS).mkdir(exist_ok=True)
            put(self.directory / SPEC, self.spec.text.encode())
            put(path, (json.dumps(self._identity(), indent=2) + "\n").encode())
            return
        known = read_identity(self.directory)
        # First: another version may read another vehicle out of the same specification.
        if known.get("versions") != self.versions:
            differs = sorted(
                name
                for name in self.versions.keys() | known.get("versions", {}).keys()
                if self.versions.get(name) != known.get("versions", {}).get(name)
            )
            by = f" by {known['program']}" if "program" in known else ""
            raise UsageError(
                f"{self.directory} was begun{by} with other versions ({', '.join(differs)}), and this is {program()}; "
                "go on with those, or give another --out"
            )
        if known.get("digest") != self.spec.digest:
            raise UsageError(f"{self.directory} holds the campaign of another specification; give another --out")
        if not resume:
            raise UsageError(
                f"{self.directory} holds this campaign already; go on with --resume, or give another --out"
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
        """Return the runs [first, last) of the parts that there are, in order; what was left half written goes."""
        if (self.directory / RUNS).exists():
            return [(0, self.spec.runs)]
        parts = []
        (self.directory / PARTS).mkdir(exist_ok=True)  # it is gone where somebody has removed what came of them
        for path in (self.directory / PARTS).iterdir():
            if (name := PART.fullmatch(path.name)) is not None:
                parts.append((int(name[1]), int(name[2])))
            else:
                path.unlink()
        return sorted(parts)

    def add(self, first: int, last: int, results: Sequence[Result]) -> None:
        """Write a finished batch."""
        put(self.directory / PARTS / f"{first:08}-{last:08}.parquet", _encoded(self._table(results)))

    def finish(self) -> None:
        """Join all parts to one file and remove them."""
        path, parts = self.directory / RUNS, self.directory / PARTS
        if not path.exists():
            tables = [read_table(parts / f"{first:08}-{last:08}.parquet") for first, last in self.finished()]
            put(path, _encoded(imported("pyarrow").concat_tables(tables).combine_chunks()))
        if parts.exists():
            for part in parts.iterdir():
                part.unlink()
            parts.rmdir()

    def _table(self, results: Sequence[Result]) -> Any:
        pa = imported("pyarrow")
        rows = [result.row for result in results]
        outcomes = [result.outcome for result in results]
        scores = [{} if one.scores is None else asdict(one.scores) for one in outcomes]
        columns = {"row": pa.array([row.index for row in rows], pa.int64())}
        columns["seed"] = pa.array([row.seed for row in rows], pa.int64())
        for name in self.spec.drawn:
            values = [row.drawn[name] for row in rows]
            texts = any(isinstance(value, str) for value in self.spec.draws[name].values)
            columns[name] = pa.array([str(value) for value in values] if texts else values)
        for name in LIMITED:
            columns[name] = pa.array([score.get(name) for score in scores], pa.float64())
        columns["faults"] = pa.array([_joined(one.faults) for one in outcomes], pa.string())
        columns["ended"] = pa.array([one.ended for one in outcomes], pa.string())
        columns["failed"] = pa.array([failure(one, self.spec.limits) for one in outcomes], pa.string())
        columns["digest"] = pa.array([one.digest for one in outcomes], pa.string())
        identity = {"rambler.spec": self.spec.digest, "rambler.sources": self.versions["sources"]}
        return pa.table(columns, metadata=identity)


def program() -> str:
    """Return the program with its commit, for people: two that differ may be the same by all that results depend on."""
    return version_text("rambler-hil", commit_of(ROOT))


def _joined(texts: tuple[str, ...] | None) -> str | None:
    return None if texts is None else "; ".join(texts)


def _encoded(table: Any) -> bytes:
    sink = imported("pyarrow").BufferOutputStream()
    imported("pyarrow.parquet").write_table(
        table, sink, row_group_size=GROUP_ROWS, compression="zstd", use_dictionary=False
    )
    return bytes(sink.getvalue())


def read_table(path: Path) -> Any:
    """Read a Parquet file, or raise HilError."""
    pa, parquet = imported("pyarrow"), imported("pyarrow.parquet")
    try:
        return parquet.ParquetFile(path).read()
    except (OSError, pa.ArrowException) as error:
        text = getattr(error, "strerror", None) or " ".join(str(error).split())[:120]
        raise HilError(f"{path} cannot be read: {text}; remove it and go on with --resume") from None


def read_identity(directory: Path) -> dict[str, Any]:
    """Read campaign.json, or raise UsageError."""
    try:
        content = json.loads((directory / CAMPAIGN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        content = None
    if not isinstance(content, dict):
        raise UsageError(f"{directory} holds no campaign; name the --out of one")
    return content


def result_files(directory: Path, index: int) -> list[Path]:
    """Return the files that could hold a run."""
    if (directory / RUNS).exists():
        return [directory / RUNS]
    if not (directory / PARTS).exists():
        return []
    names = ((path, PART.fullmatch(path.name)) for path in (directory / PARTS).iterdir())
    return [path for path, name in names if name is not None and int(name[1]) <= index < int(name[2])]


def put(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, and onto the disk; HilError when it cannot be."""
    fresh = path.with_name(path.name + ".new")
    try:
        with fresh.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
        _sync(path.parent)
    except OSError as error:
        raise HilError(f"{path} cannot be written: {error.strerror}; make room and go on with --resume") from None


def _sync(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def missing(runs: int, finished: Sequence[tuple[int, int]], batch: int) -> Iterator[tuple[int, int]]:
    """Yield the batches [first, last) that are still to be sailed."""
    at = 0
    for first, last in [*finished, (runs, runs)]:
        for begin in range(at, first, batch):
            yield begin, min(begin + batch, first)
        at = last
