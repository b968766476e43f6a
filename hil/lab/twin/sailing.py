"""Simulate a run in the compiled loop: conversion of its parameters, sea, goals and results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from firmware_py.common.angles import TWO_PI, compass_degrees, radians
from firmware_py.common.parameters import ParameterSet
from hil.lab.numeric_core import Gains, HeadingSettings, LawSettings
from hil.lab.twin.autopilot import STATE, Autopilot, Boat, Task, initial_state
from hil.lab.twin.loop import MAX_EXTRA_TICKS, TICK_COLUMNS, voyage
from hil.lab.twin.plant import PLANT, Record, Sea, Waters
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND, Truth


def boat_of(parameters: ParameterSet) -> Boat:
    """Return the parameters of the loop, computed as in the autopilot."""
    return Boat(
        HeadingSettings.of(parameters),
        Gains.of(parameters),
        radians(parameters["RUD_LIMIT_DEG"]),
        radians(parameters["RUD_SLEW_DEG_S"]),
        radians(parameters["RUD_DBAND_DEG"]),
        parameters["CMP_TIMEOUT_S"],
        parameters["POS_TIMEOUT_S"],
        parameters["CRUISE_SPEED"],
        -1.0 if parameters["RUD_REVERSE"] else 1.0,
    )


def task_of(goals: Sequence[Goal]) -> Task:
    """Return the goals as the autopilot receives them: rounded to single precision by the message."""
    headings_rad = [radians(float(np.float32(compass_degrees(goal.heading_rad)))) for goal in goals]
    return Task(np.array([goal.t_s for goal in goals], np.float64), np.array(headings_rad, np.float64))


def sail(
    boat: Boat, law: LawSettings, sea: Sea, task: Task, seconds: float, *, ticks: bool = True
) -> tuple[Record, int]:
    """Simulate a run; return the record and the number of ticks. `ticks`: store a row for each tick."""
    rows = int(seconds * ROWS_PER_SECOND + 1e-9) + 1
    record = Record(np.zeros(rows), np.zeros(rows), np.zeros((rows + MAX_EXTRA_TICKS if ticks else 0, TICK_COLUMNS)))
    # Copies, because threads that share an array wait for each other when they count its references.
    autopilot = Autopilot(boat, zeros(STATE), law)
    task_copy = Task(task.times_s.copy(), task.goals_rad.copy())
    return record, voyage(zeros(PLANT), waters_of(sea), autopilot, *initial_state(boat), task_copy, record)


def waters_of(sea: Sea) -> Waters:
    """Convert a sea to records for compiled code."""
    return Waters(record_of(sea.ship), sea.series, record_of(sea.devices), np.zeros(max(1, sea.ship.delay_steps)))


def zeros(dtype: np.dtype[Any]) -> Any:
    """Return a record of zeros."""
    return np.zeros(1, dtype)[0]


def record_of(values: NamedTuple) -> Any:
    """Convert a named tuple to a numpy record, which is a single argument of compiled code."""
    field_types = [
        (n, np.asarray(value).dtype, np.shape(value)) for n, value in zip(values._fields, values, strict=True)
    ]
    return np.array([values], np.dtype(field_types))[0]


def truth_of(record: Record, goals: Sequence[Goal]) -> Truth:
    """Return heading, rudder and goals as in truth.csv; columns that no score uses are 0."""
    heading_rad = record.heading_rad
    rows = heading_rad.size
    goal_rad, zero_column = np.full(rows, np.nan), np.zeros(rows)
    for goal in goals:
        first = int(np.ceil(goal.t_s * ROWS_PER_SECOND - 1e-9))
        if first < rows:
            # Add full turns, so that the goal is nearest to the unwrapped heading at that time.
            turns = round((float(heading_rad[first]) - goal.heading_rad) / TWO_PI)
            goal_rad[first:] = goal.heading_rad + TWO_PI * turns
    time_s = np.arange(rows) / ROWS_PER_SECOND
    rudder_rad = record.rudder_rad
    return Truth(
        time_s,
        heading_rad,
        zero_column,
        zero_column,
        rudder_rad,
        zero_column,
        goal_rad,
        zero_column,
        zero_column,
        zero_column,
    )
