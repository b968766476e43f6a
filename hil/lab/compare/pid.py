"""A tuned PID controller with filtered derivative, in the compiled loop: what a good ordinary autopilot reaches.

It steers the ship of the compiled loop (hil/lab/twin) by the same compass in the same sea, seed by seed. Its five
numbers were found by search over the four seas of physics.md at once, on other seeds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from hil.lab.compiled import compiled
from hil.lab.twin import intake, plant, sailing
from hil.lab.twin.devices import SAID_RAD, THERE_S
from hil.lab.twin.plant import PLANT, Plant, Record, Sea, Waters
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND, Array, Truth

STEP_S = 0.1
LIMIT_RAD = radians(30.0)


class Pid(NamedTuple):
    """Gains on error [rad/rad], its integral [1/s] and its rate [s]; filters of heading and rate [s]."""

    proportional: float
    integral_1_s: float
    derivative_s: float
    heading_filter_s: float
    rate_filter_s: float


TUNED = Pid(1.2, 0.0226, 1.18, 4.6, 8.0)


@compiled
def voyage(at: Plant, waters: Waters, pid: Pid, given_s: Array, goals_rad: Array, record: Record) -> None:
    """Simulate the closed loop with the PID controller until the rows of the record are full.

    The integral stands still while the rudder is at its limit and the error would drive it farther.
    """
    kp, ki, kd, heading_filter_s, rate_filter_s = pid
    plant.begin(at, waters.ship)
    seen, rate, total, command, now_s, goal = np.nan, 0.0, 0.0, 0.0, 0.0, 0
    near, quick = 1.0 - math.exp(-STEP_S / heading_filter_s), 1.0 - math.exp(-STEP_S / rate_filter_s)
    while at.row < record.heading_rad.size - 1:
        plant.until_tick(at, waters, record, now_s)
        while goal + 1 < given_s.size and given_s[goal + 1] <= now_s:
            goal += 1
        headings = 0
        while headings < at.heading_count and at.headings[headings, THERE_S] <= now_s:
            said_rad = at.headings[headings, SAID_RAD]
            seen = said_rad if math.isnan(seen) else seen
            moved = near * wrap_pi(said_rad - seen)
            seen = wrap_pi(seen + moved)
            rate += quick * (moved / STEP_S - rate)
            headings += 1
        intake.drop(at, headings, at.fix_count)
        if not math.isnan(seen):
            error = wrap_pi(goals_rad[goal] - seen)
            wanted = kp * error + total - kd * rate
            command = clamp(wanted, -LIMIT_RAD, LIMIT_RAD)
            if wanted == command or wanted * error < 0.0:
                total = clamp(total + ki * error * STEP_S, -LIMIT_RAD, LIMIT_RAD)
        plant.send_rudder(at, now_s, command)
        now_s += STEP_S


def sail_sea(sea: Sea, goals: Sequence[Goal], seconds: float, pid: Pid) -> Truth:
    """Simulate a run in a given sea with the PID controller and return its truth."""
    rows = round(seconds * ROWS_PER_SECOND) + 1
    record = Record(np.zeros(rows), np.zeros(rows), np.zeros((0, 0)))
    given_s, goals_rad = (np.array(column) for column in zip(*((g.t_s, g.heading_rad) for g in goals), strict=True))
    at: Any = sailing.zeros(PLANT)
    voyage(at, sailing.waters_of(sea), pid, given_s, goals_rad, record)
    return sailing.truth_of(record, goals)


def sail(scenario: Scenario, seed: int, goals: Sequence[Goal], seconds: float, pid: Pid) -> Truth:
    """Simulate a run of a scenario with the PID controller and return its truth."""
    return sail_sea(sea_of(scenario, seed, seconds), goals, seconds, pid)
