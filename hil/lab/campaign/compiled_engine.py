"""Runs of a campaign in the compiled loop (hil/lab/twin)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any, cast

from firmware_py.common.parameters import ParameterSet
from hil.lab.campaign.row import Outcome, Row
from hil.lab.campaign.scores import scores_of
from hil.lab.campaign.spec import Spec
from hil.lab.compiled import compiling
from hil.lab.numeric_core import LawSettings
from hil.lab.twin import sailing
from hil.lab.twin.plant import Sea
from hil.lab.twin.sea import NO_ARRAY, sea_of
from hil.sim.truth import Truth
from hil.sim.vehicle_file import model_of

BATCH = 256
COMPILE_RUN_S = 1.0
SUPPORTED_DEVICES = {"compass": "nmea", "servo": "dynamixel"}
UNSUPPORTED_OPTIONS = ("supply", "vessels")


def refusals(spec: Spec) -> list[str]:
    """Return a line for each item of a specification that the compiled loop does not support."""
    lines = [f"with.{name}: {NOT_SUPPORTED}" for name in UNSUPPORTED_OPTIONS if name in spec.options]
    lines += [
        f"{name}: {NOT_SUPPORTED}, or {supported}"
        for name, supported in SUPPORTED_DEVICES.items()
        if set(spec.values(name)) - {supported}
    ]
    if "fault.what" in spec.draws:
        lines.append(f"fault: {NOT_SUPPORTED}")
    for name in sorted({*spec.vehicle.parameters, *(name[4:] for name in spec.draws if name.startswith("set."))}):
        if name not in supported_parameters():
            lines.append(f"set.{name}: {NOT_SUPPORTED}; it supports {', '.join(sorted(supported_parameters()))}")
    if (spec.vehicle.compass.driver, spec.vehicle.rudder.driver) != tuple(SUPPORTED_DEVICES.values()):
        lines.append(f"vehicle: its compass or servo {NOT_SUPPORTED}")
    if spec.vehicle.compass_b is not None:
        lines.append(f"vehicle: its second compass {NOT_SUPPORTED}")
    return lines


NOT_SUPPORTED = 'not supported by the compiled loop; use engine = "firmware"'


class _ReadRecorder:
    """A parameter set that records which parameters are read."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self._defaults = ParameterSet()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return self._defaults[name]


@cache
def supported_parameters() -> frozenset[str]:
    """Return the names of the parameters that the compiled loop uses."""
    recorder: Any = _ReadRecorder()
    sailing.boat_of(recorder)
    LawSettings.of(recorder)
    return frozenset(cast("set[str]", recorder.names))


def simulate(rows: Iterable[Row]) -> Iterator[Outcome]:
    """Simulate runs and yield their outcomes, in order."""
    buffer = NO_ARRAY  # memory is reused for all runs, because allocation takes longer than drawing
    with compiling("the closed loop"):
        for row in rows:
            sea = sea_of(row.scenario, row.seed, row.seconds, model_of(row.vehicle), buffer)
            buffer = sea.series
            truth = _simulate(row, sea)
            scores = scores_of(truth.heading_low_rad, truth.rudder_rad, truth.goal_rad)
            yield Outcome(digest_of(truth), scores)


def make_ready(row: Row) -> None:
    """Compile the loop with a short run, so that the workers load it from the cache."""
    for _ in simulate([replace(row, seconds=COMPILE_RUN_S)]):
        pass


def simulate_truth(row: Row) -> Truth:
    """Simulate a run; return the columns of truth.csv that the compiled loop computes."""
    return _simulate(row, sea_of(row.scenario, row.seed, row.seconds, model_of(row.vehicle)))


def _simulate(row: Row, sea: Sea) -> Truth:
    parameters = ParameterSet()
    for name, value in {**row.vehicle.parameters, **row.settings}.items():
        parameters = parameters.replaced(name, value)
    boat, law, task = sailing.boat_of(parameters), LawSettings.of(parameters), sailing.task_of(row.goals)
    record, _ = sailing.sail(boat, law, sea, task, row.seconds, ticks=False)
    return sailing.truth_of(record, row.goals)


def digest_of(truth: Truth) -> str:
    """Return the digest of heading and rudder."""
    return hashlib.sha256(truth.heading_low_rad.tobytes() + truth.rudder_rad.tobytes()).hexdigest()
