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
    """Read the specification of a campaign's directory; raise UsageError if it has changed since the campaign."""
    identity = store.read_identity(directory)
    spec = read_spec(directory / store.SPEC, Path(str(identity.get("beside", ""))))
    if spec.digest != identity.get("digest"):
        raise UsageError(
            f"{directory}: specification or vehicle file changed since the campaign{_version_text(directory)}"
        )
    return spec


def result_of(directory: Path, spec: Spec, index: int) -> dict[str, Any]:
    """Return the results of a finished run, or raise UsageError."""
    if not 0 <= index < spec.runs:
        raise UsageError(f"run {index} does not exist; give a number from 0 to {spec.runs - 1}")
    for path in store.result_files(directory, index):
        for result in store.read_table(path).to_pylist():
            if result["row"] == index:
                return dict(result)
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
        differences.insert(0, f"digest {digest} instead of {result['digest']}{_version_text(directory)}")
    return Replay(tuple(differences), page)


def _differences(row: Row, truth: Truth) -> list[str]:
    """Return texts with the times at which the two engines first differ in the nine digits of truth.csv."""
    from hil.lab.campaign import compiled_engine  # noqa: PLC0415 - slow to import

    compiled_truth = compiled_engine.simulate_truth(row)
    lines = []
    for name in ("heading_low_rad", "rudder_rad"):
        compiled_values = np.char.mod("%.9g", getattr(compiled_truth, name)).astype(float)
        autopilot_values = getattr(truth, name)
        row_count = min(compiled_values.size, autopilot_values.size)
        if (
            different := np.flatnonzero(compiled_values[:row_count] != autopilot_values[:row_count])
        ).size or compiled_values.size != autopilot_values.size:
            first_s = truth.time_s[different[0]] if different.size else truth.time_s[row_count - 1]
            lines.append(f"{name} of autopilot and compiled engine differ from {first_s:g} s on")
    return lines


def _version_text(directory: Path) -> str:
    """Return a text that names the versions that differ between this program and the campaign."""
    campaign_versions = store.read_identity(directory).get("versions", {})
    own_versions = versions()
    differing = sorted(
        name
        for name in own_versions.keys() | campaign_versions.keys()
        if own_versions.get(name) != campaign_versions.get(name)
    )
    program = store.read_identity(directory).get("program", "an unknown program")
    return f"; the campaign was run by {program} with other versions ({', '.join(differing)})" if differing else ""
