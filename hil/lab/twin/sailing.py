"""Sails runs of the twin: from parameters, a sea and goals to what truth.csv would hold of heading and rudder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI, compass_degrees, radians
from firmware_py.common.parameters import ParameterSet
from hil.lab.lane_rows import aligned
from hil.lab.lanes import COUNT
from hil.lab.twin import helm
from hil.lab.twin.afloat import AFLOAT, Record, Sea, Waters
from hil.lab.twin.crew import PILOTS, Boat, Crew, Orders, Task
from hil.lab.twin.kalman import COVARIANCES, Floats
from hil.lab.twin.loop import MORE_TICKS, TICK_COLUMNS, voyage
from hil.lab.twin.wave_filter_state import FILTERS
from hil.sim.goals import Goal
from hil.sim.truth import ROWS_PER_SECOND, Truth


def boat_of(parameters: ParameterSet) -> Boat:
    """Return what the twin takes of the parameters, computed as the autopilot computes it."""
    return Boat(
        (parameters["MDL_K"], parameters["MDL_T_S"], parameters["MDL_ALPHA_S2"], parameters["MDL_SPEED"]),
        radians(parameters["RUD_LIMIT_DEG"]),
        radians(parameters["CTL_TRIM_DEG"]),
        radians(parameters["RUD_SLEW_DEG_S"]),
        radians(parameters["RUD_DBAND_DEG"]),
        parameters["CMP_TIMEOUT_S"],
        parameters["POS_TIMEOUT_S"],
        parameters["CMP_FROZEN_S"],
        parameters["COG_SPEED_MIN"],
        parameters["CRUISE_SPEED"],
        -1.0 if parameters["RUD_REVERSE"] else 1.0,
    )


def law_of(parameters: ParameterSet) -> Floats:
    """Return the numbers of the delivered helm, in the order of helm.LAW_NAMES."""
    return np.array((*helm.DELIVERED, parameters["CTL_PRICE"], parameters["CTL_WAY_MIN"]))


def task_of(goals: Sequence[Goal]) -> Task:
    """Return the goals as the operator's message, of single precision, brings them."""
    given = [radians(float(np.float32(compass_degrees(goal.heading_rad)))) for goal in goals]
    return Task(np.array([goal.t_s for goal in goals], np.float64), np.array(given, np.float64))


class Run(NamedTuple):
    """What a run is sailed by."""

    boat: Boat
    law: Floats
    sea: Sea
    task: Task


def sail(boat: Boat, law: Floats, sea: Sea, task: Task, seconds: float) -> tuple[Record, int]:
    """Sail a run; return the record and how many ticks there were."""
    record, ticks = sail_beside([Run(boat, law, sea, task)], seconds, ticks=True)
    return alone(record), int(ticks[0])


def alone(record: Record, number: int = 0) -> Record:
    """Return what a record holds of one of its runs."""
    return Record(record.heading_rad[number], record.rudder_rad[number], record.ticks[number])


def sail_beside(runs: Sequence[Run], seconds: float, *, ticks: bool) -> tuple[Record, NDArray[np.int64]]:
    """Sail up to COUNT runs beside each other, each to the bits that it has alone.

    Return the record, a row for each run and of the ticks only if asked for, and how many ticks there were.
    """
    rows = int(seconds * ROWS_PER_SECOND + 1e-9) + 1
    record = Record(
        np.zeros((len(runs), rows)),
        np.zeros((len(runs), rows)),
        np.zeros((len(runs), rows + MORE_TICKS if ticks else 0, TICK_COLUMNS)),
    )
    counts = np.zeros(len(runs), np.int64)
    seas = [run.sea for run in runs]
    # The series stay where they are: their numbers are counted from the one that comes first in memory.
    places = [sea.series.ctypes.data // sea.series.itemsize for sea in seas]
    first = places.index(min(places))
    starts = [place - places[first] for place in places]
    given = [run.task for run in runs]
    voyage(
        Waters(
            records_of([moved(sea.ship, start) for sea, start in zip(seas, starts, strict=True)]),
            records_of([moved(sea.devices, start) for sea, start in zip(seas, starts, strict=True)]),
            beside_of([moved(sea.ship, start) for sea, start in zip(seas, starts, strict=True)]),
            beside_of([moved(sea.devices, start) for sea, start in zip(seas, starts, strict=True)]),
            aligned(AFLOAT, 1),
            seas[first].series,
            np.zeros((COUNT, max(1, *(sea.ship.delay_steps for sea in seas)))),
        ),
        Crew(beside_of([run.boat for run in runs]), aligned(PILOTS, 1), aligned(FILTERS, 1), aligned(COVARIANCES, 1)),
        Orders(
            columns_of([run.law for run in runs], 0.0),
            columns_of([task.given_s for task in given], math.inf),
            columns_of([task.goals_rad for task in given], 0.0),
        ),
        record,
        counts,
    )
    return record, counts


def records_of(tuples: Sequence[NamedTuple]) -> NDArray[Any]:
    """Return named tuples as records of all lanes; those that are not sailed are as the first."""
    first = tuples[0]
    kinds = [(name, np.asarray(value).dtype, np.shape(value)) for name, value in zip(first._fields, first, strict=True)]
    return np.array([*tuples, *[first] * (COUNT - len(tuples))], np.dtype(kinds))


def beside_of(tuples: Sequence[NamedTuple]) -> NDArray[Any]:
    """Return named tuples as one record, each field of which is the numbers of all lanes; idle ones are the first's."""
    first, idle = tuples[0], [tuples[0]] * (COUNT - len(tuples))
    kinds = [(name, np.float64, (*np.shape(value), COUNT)) for name, value in zip(first._fields, first, strict=True)]
    found = aligned(np.dtype(kinds), 1)
    for name in first._fields:
        found[name][0] = np.array([getattr(one, name) for one in (*tuples, *idle)], np.float64).T
    return found


def moved(tuple_: Any, start: int) -> Any:
    """Return a ship, or devices, whose numbers begin that much later in the series."""
    return tuple_._replace(**{name: getattr(tuple_, name) + start for name in tuple_._fields if name.endswith("_at")})


def columns_of(lists: Sequence[Floats], otherwise: float) -> Floats:
    """Return lists of numbers as columns of the same length, one for each lane."""
    columns = np.full((max(1, *(one.size for one in lists)), COUNT), otherwise)
    for lane, one in enumerate(lists):
        columns[: one.size, lane] = one
    return columns


def truth_of(record: Record, goals: Sequence[Goal]) -> Truth:
    """Return heading, rudder and goals as truth.csv holds them; what a score does not look at is 0."""
    heading_rad = record.heading_rad
    rows = heading_rad.size
    goal_rad, nothing = np.full(rows, np.nan), np.zeros(rows)
    for goal in goals:
        first = int(np.ceil(goal.t_s * ROWS_PER_SECOND - 1e-9))
        if first < rows:
            # On the turn nearest to the heading at which it is given.
            turns = round((float(heading_rad[first]) - goal.heading_rad) / TWO_PI)
            goal_rad[first:] = goal.heading_rad + TWO_PI * turns
    time_s = np.arange(rows) / ROWS_PER_SECOND
    rudder_rad = record.rudder_rad
    return Truth(time_s, heading_rad, nothing, nothing, rudder_rad, nothing, goal_rad, nothing, nothing, nothing)
