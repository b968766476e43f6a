"""The crew of a batch: what the autopilots of all lanes are told, and remember, side by side."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.lab.lanes import COUNT
from hil.lab.twin import helm, late_answer, oscillation, sources
from hil.lab.twin.kalman import Floats

# Rows of Pilots.own, where NaN is what there is not yet.
(BEFORE_S, OWN_COMMAND_RAD, OWN_HEADING_RAD, OWN_RATE_RAD_S, STEERED_S, SAMPLE_S, GOAL_RAD, GOALS, NEWEST_S,
 OWN_ERROR_RAD, ARMED, THERE, USED, FIXED, HEADING_NEXT, FIX_NEXT, NEXT_GOAL_S) = range(17)  # fmt: skip
OWN = 17


class Boat(NamedTuple):
    """What the autopilot is told by its parameters; `model` is K, T, alpha and the speed that they are of."""

    model: Any  # four numbers: in a record, an array
    limit_rad: float
    trim_rad: float
    slew_rad_s: float
    deadband_rad: float
    compass_timeout_s: float
    position_timeout_s: float
    frozen_s: float
    course_speed_m_s: float
    cruise_speed_m_s: float
    servo_sign: float


class Task(NamedTuple):
    """When goals are given and their headings, as the operator's message rounds them."""

    given_s: Floats
    goals_rad: Floats


# What the autopilots of all lanes remember beside their wave filters.
PILOTS = np.dtype(
    [
        (name, np.float64, (count, COUNT))
        for name, count in (
            ("helm", helm.HELM_STATES), ("known", helm.KNOWN), ("swing", oscillation.WATCH_STATES),
            ("late", late_answer.LATE_STATES), ("source", sources.SOURCE_STATES), ("own", OWN),
        )
    ]
)  # fmt: skip
Pilots = Any  # a record of PILOTS
Lanes = Any


class Orders(NamedTuple):
    """The laws of the helms, and the goals, a column for each lane; a time of inf stands for no goal more."""

    laws: Floats
    given_s: Floats
    goals_rad: Floats


class Crew(NamedTuple):
    """The autopilots of a batch: records of all lanes side by side."""

    boats: NDArray[Any]
    pilots: NDArray[Any]
    filters: NDArray[Any]
    covariances: NDArray[Any]
