"""Parameters, goals and state of the autopilot in the compiled loop; the wave filter has a state of its own."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hil.lab.numeric_core import LawSettings, law, oscillation, sources, steering_monitor
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


# State of the autopilot beside the filter's and CoreState; NaN stands for an absent value. `goals` counts the goals
# that have been given.
STATE = np.dtype(
    [
        *(
            (name, np.float64)
            for name in (
                "before_s", "command_rad", "heading_rad", "heading_sd_rad", "rate_rad_s", "steered_s", "sample_s",
                "goal_rad", "newest_s", "error_rad",
            )
        ),
        ("goals", np.int64),
    ]
)  # fmt: skip


class Intake(NamedTuple):
    """State of the heading sources, and time and interval of headings and fixes."""

    sources: sources.SourceState
    heading_s: float
    heading_interval_s: float
    fix_s: float
    fix_interval_s: float


class CoreState(NamedTuple):
    """States of the firmware's functions that the loop calls."""

    intake: Intake
    law: law.LawState
    oscillation: oscillation.OscillationState
    steering: steering_monitor.SteeringMonitorState


START = CoreState(
    Intake(sources.START, np.nan, np.nan, np.nan, np.nan), law.IDLE, oscillation.START, steering_monitor.START
)


class Autopilot(NamedTuple):
    """The autopilot of a run: records of Boat, STATE, wave_filter_state.FILTER and kalman.COVARIANCE, and its law."""

    boat: Any
    state: Any
    filter: Any
    covariance: Any
    law: LawSettings
