"""A tuned PID controller with filtered derivative in the compiled loop, as a reference.

It uses ship and compass of the compiled loop (hil/lab/twin) in the same seas. Its five parameters are the result of
a search over four seas together (docs/explanation/physics.md), with other seeds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from firmware_py.common.angles import clamp, radians, wrap_pi
from hil.lab.compiled import compiled
from hil.lab.twin import estimator, plant, sailing
from hil.lab.twin.devices import ARRIVAL_S, MESSAGE_RAD
from hil.lab.twin.plant import PLANT, Plant, Record, Sea, Waters
from hil.lab.twin.sea import sea_of
from hil.ship.scenarios import Scenario
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND, Array, Truth

STEP_S = 0.1
LIMIT_RAD = radians(30.0)  # of the rudder


class Pid(NamedTuple):
    """Gains on error [rad/rad], its integral [1/s] and its rate [s]; filter time constants of heading and rate [s]."""

    proportional: float
    integral_1_s: float
    derivative_s: float
    heading_filter_s: float
    rate_filter_s: float


TUNED = Pid(1.2, 0.0226, 1.18, 4.6, 8.0)


@compiled
def voyage(plant_state: Plant, waters: Waters, pid: Pid, times_s: Array, goals_rad: Array, record: Record) -> None:
    """Simulate the closed loop with the PID controller until the rows of the record are full.

    The integral is constant while the rudder is at its limit and the error would increase the integral.
    """
    kp, ki, kd, heading_filter_s, rate_filter_s = pid
    plant.begin(plant_state, waters.ship)
    heading, rate, integral, command, now_s, goal = np.nan, 0.0, 0.0, 0.0, 0.0, 0
    heading_weight, rate_weight = 1.0 - math.exp(-STEP_S / heading_filter_s), 1.0 - math.exp(-STEP_S / rate_filter_s)
    while plant_state.row < record.heading_rad.size - 1:
        plant.advance_to_tick(plant_state, waters, record, now_s)
        while goal + 1 < times_s.size and times_s[goal + 1] <= now_s:
            goal += 1
        headings = 0
        while headings < plant_state.heading_count and plant_state.headings[headings, ARRIVAL_S] <= now_s:
            message_rad = plant_state.headings[headings, MESSAGE_RAD]
            heading = message_rad if math.isnan(heading) else heading
            heading_change = heading_weight * wrap_pi(message_rad - heading)
            heading = wrap_pi(heading + heading_change)
            rate += rate_weight * (heading_change / STEP_S - rate)
            headings += 1
        estimator.drop_messages(plant_state, headings, plant_state.fix_count)
        if not math.isnan(heading):
            error = wrap_pi(goals_rad[goal] - heading)
            demand = kp * error + integral - kd * rate
            command = clamp(demand, -LIMIT_RAD, LIMIT_RAD)
            if demand == command or demand * error < 0.0:
                integral = clamp(integral + ki * error * STEP_S, -LIMIT_RAD, LIMIT_RAD)
        plant.send_rudder(plant_state, now_s, command)
        now_s += STEP_S


def sail_sea(sea: Sea, goals: Sequence[Goal], seconds: float, pid: Pid) -> Truth:
    """Simulate a run in a drawn sea with the PID controller; return its truth."""
    rows = round(seconds * ROWS_PER_SECOND) + 1
    record = Record(np.zeros(rows), np.zeros(rows), np.zeros((0, 0)))
    times_s, goals_rad = (np.array(column) for column in zip(*((g.t_s, g.heading_rad) for g in goals), strict=True))
    plant_state: Any = sailing.zeros(PLANT)
    voyage(plant_state, sailing.waters_of(sea), pid, times_s, goals_rad, record)
    return sailing.truth_of(record, goals)


def sail(scenario: Scenario, seed: int, goals: Sequence[Goal], seconds: float, pid: Pid) -> Truth:
    """Simulate a run of a scenario with the PID controller; return its truth."""
    return sail_sea(sea_of(scenario, seed, seconds), goals, seconds, pid)
