"""Repeat one run of a campaign with its log and page, and compare the results bit by bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil.errors import UsageError
from hil.lab.campaign import firmware_engine, store
from hil.lab.campaign.campaign import read_spec
from hil.lab.campaign.engines import engine_of, versions
from hil.lab.campaign.row import Row, rows
from hil.lab.campaign.spec import COMPILED, Spec
from hil.report import run_page
from hil.sim.run_directory import TRUTH_FILE, locked_directory
from hil.sim.signals import interruptible
from hil.sim.truth import Truth, read


@dataclass(frozen=True, slots=True)
class Replay:
    """Result of a replay: a line for each difference, and the page of the run."""

    differences: tuple[str, ...]
    page: Path


def read_campaign_spec(directory: Path) -> Spec:
    """Read the specification of a campaign's directory; raise UsageError if it has changed since."""
    known = store.read_identity(directory)
    spec = read_spec(directory / store.SPEC, Path(str(known.get("beside", ""))))
    if spec.digest != known.get("digest"):
        raise UsageError(f"{directory}: specification or vehicle file changed since the campaign{_other(directory)}")
    return spec


def result_of(directory: Path, spec: Spec, index: int) -> dict[str, Any]:
    """Return the results of a finished run, or raise UsageError."""
    if not 0 <= index < spec.runs:
        raise UsageError(f"run {index} does not exist; give a number from 0 to {spec.runs - 1}")
    for path in store.result_files(directory, index):
        for name in store.read_table(path).to_pylist():
            if name["row"] == index:
                return dict(name)
    raise UsageError(f"run {index} is not finished; continue the campaign with --resume first")


def replay(directory: Path, index: int, out: Path) -> Replay:
    """Repeat a run of a campaign into a directory, write its page, and compare the results."""
    spec = read_campaign_spec(directory)
    result = result_of(directory, spec, index)
    row = next(rows(spec, index, index + 1))
    differences = []
    with locked_directory(out), interruptible():
        outcome = firmware_engine.simulate_into(row, out, with_logs=True)
        digest = outcome.digest
        if spec.engine == COMPILED:
            (compiled,) = engine_of(spec).simulate([row])
            digest = compiled.digest
            differences += _differences(row, read(out / TRUTH_FILE))
        _, page = run_page.make(out)
    if digest != result["digest"]:
        differences.insert(0, f"digest {digest} instead of {result['digest']}{_other(directory)}")
    return Replay(tuple(differences), page)


def _differences(row: Row, truth: Truth) -> list[str]:
    """Return where the runs of the two engines first differ in the nine digits of truth.csv."""
    from hil.lab.campaign import compiled_engine  # noqa: PLC0415 - slow to import

    ours = compiled_engine.simulate_truth(row)
    lines = []
    for name in ("heading_low_rad", "rudder_rad"):
        mine = np.char.mod("%.9g", getattr(ours, name)).astype(float)
        theirs = getattr(truth, name)
        rows_ = min(mine.size, theirs.size)
        if (wrong := np.flatnonzero(mine[:rows_] != theirs[:rows_])).size or mine.size != theirs.size:
            at_s = truth.time_s[wrong[0]] if wrong.size else truth.time_s[rows_ - 1]
            lines.append(f"{name} of autopilot and compiled engine differ from {at_s:g} s on")
    return lines


def _other(directory: Path) -> str:
    """Return a text that names the versions that differ from those of the campaign."""
    known = store.read_identity(directory).get("versions", {})
    own = versions()
    differs = sorted(name for name in own.keys() | known.keys() if own.get(name) != known.get(name))
    by = store.read_identity(directory).get("program", "an unknown program")
    return f"; the campaign was run by {by} with other versions ({', '.join(differs)})" if differs else ""
