"""Parameters, goals and state of the autopilot in the compiled loop; the wave filter has a state of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hil.lab.numeric_core import LawSettings
from hil.lab.twin import helm, sources
from hil.lab.twin.kalman import Floats


class Boat(NamedTuple):
    """Parameters of the autopilot; `model` is K, T, alpha and the speed at which these hold."""

    model: Any  # four numbers: in a record, an array
    limit_rad: float
    slew_rad_s: float
    deadband_rad: float
    compass_timeout_s: float
    position_timeout_s: float
    frozen_s: float
    course_speed_m_s: float
    cruise_speed_m_s: float
    servo_sign: float


class Task(NamedTuple):
    """Times at which goals are given, and their headings as the operator's message rounds them."""

    given_s: Floats
    goals_rad: Floats


# The state of the autopilot: first that of its parts, then its own. NaN stands for an absent value; `goals` counts the
# goals that have been given.
STATE = np.dtype(
    [
        *(
            (name, np.float64, (count,))
            for name, count in (
                ("helm", helm.HELM_STATES), ("known", helm.KNOWN), ("source", sources.SOURCE_STATES),
            )
        ),
        *(
            (name, np.float64)
            for name in (
                "before_s", "command_rad", "heading_rad", "rate_rad_s", "steered_s", "sample_s", "goal_rad",
                "newest_s", "error_rad",
            )
        ),
        ("goals", np.int64),
    ]
)  # fmt: skip


class Autopilot(NamedTuple):
    """The autopilot of a run: records of Boat, STATE, wave_filter_state.FILTER and kalman.COVARIANCE, and its law."""

    boat: Any
    state: Any
    filter: Any
    covariance: Any
    law: LawSettings
