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
READY_S = 1.0
DEVICES = {"compass": "nmea", "servo": "dynamixel"}
UNSUPPORTED_OPTIONS = ("supply", "vessels")


def refusals(spec: Spec) -> list[str]:
    """Return a line for each item of a specification that the compiled loop does not support."""
    lines = [f"with.{name}: {REFUSED}" for name in UNSUPPORTED_OPTIONS if name in spec.options]
    lines += [f"{name}: {REFUSED}, or {only}" for name, only in DEVICES.items() if set(spec.values(name)) - {only}]
    if "fault.what" in spec.draws:
        lines.append(f"fault: {REFUSED}")
    for name in sorted({*spec.vehicle.parameters, *(name[4:] for name in spec.draws if name.startswith("set."))}):
        if name not in known_parameters():
            lines.append(f"set.{name}: {REFUSED}; it supports {', '.join(sorted(known_parameters()))}")
    if (spec.vehicle.compass.driver, spec.vehicle.rudder.driver) != tuple(DEVICES.values()):
        lines.append(f"vehicle: its compass or servo {REFUSED}")
    return lines


REFUSED = 'not supported by the compiled loop; use engine = "firmware"'


class _ReadRecorder:
    """A set of parameters that records which of them are read."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self._defaults = ParameterSet()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return self._defaults[name]


@cache
def known_parameters() -> frozenset[str]:
    """Return the names of the parameters that the compiled loop uses."""
    recorder: Any = _ReadRecorder()
    sailing.boat_of(recorder)
    LawSettings.of(recorder)
    return frozenset(cast("set[str]", recorder.names))


def simulate(rows: Iterable[Row]) -> Iterator[Outcome]:
    """Simulate runs and yield their outcomes, in order."""
    room = NO_ARRAY  # reused for all runs: allocating takes longer than drawing
    with compiling("the closed loop"):
        for row in rows:
            sea = sea_of(row.scenario, row.seed, row.seconds, model_of(row.vehicle), room)
            room = sea.series
            truth = _simulate(row, sea)
            scores = scores_of(truth.heading_low_rad, truth.rudder_rad, truth.goal_rad)
            yield Outcome(digest_of(truth), scores)


def make_ready(row: Row) -> None:
    """Compile the loop, so that the workers load it from the cache."""
    for _ in simulate([replace(row, seconds=READY_S)]):
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
