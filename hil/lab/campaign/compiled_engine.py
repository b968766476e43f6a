"""Runs of a campaign in the compiled loop: the one place where campaigns use hil/lab/twin."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any, cast

from firmware_py.common.parameters import ParameterSet
from hil.lab.campaign.outcome import Outcome
from hil.lab.campaign.row import Row
from hil.lab.campaign.scores import scores_of
from hil.lab.campaign.spec import Spec
from hil.lab.compiled import compiling
from hil.lab.numeric_core import LawSettings
from hil.lab.twin import sailing
from hil.lab.twin.plant import Sea
from hil.lab.twin.sea import NO_ROOM, sea_of
from hil.sim.truth import Truth
from hil.sim.vehicle_file import model_of

BATCH = 256
READY_S = 1.0
DEVICES = {"compass": "nmea", "servo": "dynamixel"}
UNKNOWN_OPTIONS = ("supply", "vessels")


def refusals(spec: Spec) -> list[str]:
    """Return a line for each thing of a specification that the compiled loop does not have."""
    lines = [f"with.{name}: {REFUSED}" for name in UNKNOWN_OPTIONS if name in spec.options]
    lines += [f"{name}: {REFUSED} but {only}" for name, only in DEVICES.items() if set(spec.values(name)) - {only}]
    if "fault.what" in spec.draws:
        lines.append(f"fault: {REFUSED}")
    for name in sorted({*spec.vehicle.parameters, *(name[4:] for name in spec.draws if name.startswith("set."))}):
        if name not in known_parameters():
            lines.append(f"set.{name}: {REFUSED}; of the parameters it knows {', '.join(sorted(known_parameters()))}")
    if (spec.vehicle.compass.driver, spec.vehicle.rudder.driver) != tuple(DEVICES.values()):
        lines.append(f"vehicle: its compass or servo {REFUSED}")
    return lines


REFUSED = 'is not in the compiled loop; take engine = "firmware"'


class _Asked:
    """Stands for a set of parameters and notes which are looked at."""

    def __init__(self) -> None:
        self.names: set[str] = set()
        self._defaults = ParameterSet()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return self._defaults[name]


@cache
def known_parameters() -> frozenset[str]:
    """Return the names of the parameters that the compiled loop takes."""
    asked: Any = _Asked()
    sailing.boat_of(asked)
    LawSettings.of(asked)
    return frozenset(cast("set[str]", asked.names))


def sail(rows: Iterable[Row]) -> Iterator[Outcome]:
    """Sail runs and yield their outcomes, in order."""
    room = NO_ROOM  # the series of all runs: new memory takes longer than what is drawn
    with compiling("the closed loop"):
        for row in rows:
            sea = sea_of(row.scenario, row.seed, row.seconds, model_of(row.vehicle), room)
            room = sea.series
            truth = _sailed(row, sea)
            scores = scores_of(truth.heading_low_rad, truth.rudder_rad, truth.goal_rad)
            yield Outcome(digest_of(truth), scores)


def make_ready(row: Row) -> None:
    """Compile the loop, so that the workers find it compiled."""
    for _ in sail([replace(row, seconds=READY_S)]):
        pass


def sailed(row: Row) -> Truth:
    """Sail a run; return what the compiled loop computes of truth.csv."""
    return _sailed(row, sea_of(row.scenario, row.seed, row.seconds, model_of(row.vehicle)))


def _sailed(row: Row, sea: Sea) -> Truth:
    told = ParameterSet()
    for name, value in {**row.vehicle.parameters, **row.settings}.items():
        told = told.replaced(name, value)
    boat, law, task = sailing.boat_of(told), LawSettings.of(told), sailing.task_of(row.goals)
    record, _ = sailing.sail(boat, law, sea, task, row.seconds, ticks=False)
    return sailing.truth_of(record, row.goals)


def digest_of(truth: Truth) -> str:
    """Return the digest of heading and rudder."""
    return hashlib.sha256(truth.heading_low_rad.tobytes() + truth.rudder_rad.tobytes()).hexdigest()
