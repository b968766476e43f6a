"""One run of a campaign again, alone and in full: does it come to the same bits?"""

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
from hil.sim.run_directory import TRUTH_FILE, held
from hil.sim.signals import interruptible
from hil.sim.truth import Truth, read


@dataclass(frozen=True, slots=True)
class Replay:
    """What a replay found: a line for each difference, and the page of the run."""

    differences: tuple[str, ...]
    page: Path


def opened(directory: Path) -> Spec:
    """Read the specification of a campaign's directory as it was sailed, or raise UsageError."""
    known = store.read_identity(directory)
    spec = read_spec(directory / store.SPEC, Path(str(known.get("beside", ""))))
    if spec.digest != known.get("digest"):
        raise UsageError(
            f"{directory}: its specification, or the vehicle file of it, is not what was sailed{_other(directory)}"
        )
    return spec


def result_of(directory: Path, spec: Spec, index: int) -> dict[str, Any]:
    """Return the row of a run that is over, or raise UsageError."""
    if not 0 <= index < spec.runs:
        raise UsageError(f"there is no run {index}; give a number from 0 to {spec.runs - 1}")
    for path in store.result_files(directory, index):
        for name in store.read_table(path).to_pylist():
            if name["row"] == index:
                return dict(name)
    raise UsageError(f"run {index} has not been sailed yet; go on with the campaign first")


def replay(directory: Path, index: int, out: Path) -> Replay:
    """Sail a run of a campaign into a directory of its own, with its page, and compare."""
    spec = opened(directory)
    result = result_of(directory, spec, index)
    row = next(rows(spec, index, index + 1))
    differences = []
    with held(out), interruptible():
        outcome = firmware_engine.sail_into(row, out, full=True)
        digest = outcome.digest
        if spec.engine == COMPILED:
            (compiled,) = engine_of(spec).sail([row])
            digest = compiled.digest
            differences += _differences(row, read(out / TRUTH_FILE))
        _, page = run_page.make(out)
    if digest != result["digest"]:
        differences.insert(0, f"digest {digest} instead of {result['digest']}{_other(directory)}")
    return Replay(tuple(differences), page)


def _differences(row: Row, truth: Truth) -> list[str]:
    """Return where the two engines' runs differ first, compared with the nine digits of truth.csv."""
    from hil.lab.campaign import compiled_engine  # noqa: PLC0415 - it takes a while

    ours = compiled_engine.sailed(row)
    lines = []
    for name in ("heading_low_rad", "rudder_rad"):
        mine = np.char.mod("%.9g", getattr(ours, name)).astype(float)
        theirs = getattr(truth, name)
        rows_ = min(mine.size, theirs.size)
        if (wrong := np.flatnonzero(mine[:rows_] != theirs[:rows_])).size or mine.size != theirs.size:
            at_s = truth.time_s[wrong[0]] if wrong.size else truth.time_s[rows_ - 1]
            lines.append(f"{name} of the autopilot differs from the compiled engine's from {at_s:g} s on")
    return lines


def _other(directory: Path) -> str:
    """Say which versions are others than the campaign's."""
    known = store.read_identity(directory).get("versions", {})
    own = versions()
    differs = sorted(name for name in own.keys() | known.keys() if own.get(name) != known.get(name))
    by = store.read_identity(directory).get("program", "an unknown program")
    return f"; the campaign was sailed with other versions ({', '.join(differs)}), by {by}" if differs else ""
