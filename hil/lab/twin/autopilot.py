"""Parameters, goals and state of the autopilot in the compiled loop."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hil.lab.numeric_core import LawSettings, heading_estimate, heading_tick, law, oscillation, steering_monitor, water
from hil.lab.twin.ship import Floats


class Boat(NamedTuple):
    """Parameters of the autopilot: settings of the estimator, gains that replace the control law, and the rest."""

    heading: heading_tick.HeadingSettings
    stand_in: law.Gains
    limit_rad: float
    slew_rad_s: float
    deadband_rad: float
    compass_timeout_s: float
    position_timeout_s: float
    cruise_speed_m_s: float
    servo_sign: float


class Task(NamedTuple):
    """Times at which goals are given, and their headings as the operator's message rounds them."""

    given_s: Floats
    goals_rad: Floats


# State of the autopilot beside Intake and Helm; NaN is an absent value. `goals` counts the goals that were given.
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
    """State of the estimators, and time and interval of headings and fixes."""

    heading: heading_tick.HeadingTick
    water: water.WaterState
    heading_s: float
    heading_interval_s: float
    fix_s: float
    fix_interval_s: float


class Seen(NamedTuple):
    """What control law, monitors and record take of the estimators at a tick.

    It is separate because each function that takes the hundreds of numbers of `Intake` costs numba many seconds.
    """

    started: bool
    trusted: bool
    estimate: heading_estimate.HeadingEstimate
    heading_sd_rad: float
    wave_period_s: float
    delay_log_ratio: float
    disturbance: tuple[float, float]
    rudder_rad: float
    shown_rad: float
    heading_interval_s: float
    inconsistent: bool
    current_strong: float


class Helm(NamedTuple):
    """State of control law and monitors."""

    law: law.LawState
    oscillation: oscillation.OscillationState
    steering: steering_monitor.SteeringMonitorState


def start_of(boat: Boat) -> tuple[Intake, Helm]:
    """Return the states before the first tick."""
    expected = water.expecting(0.0, 0.0, boat.cruise_speed_m_s)
    taken = Intake(heading_tick.START, expected, np.nan, np.nan, np.nan, np.nan)
    return taken, Helm(law.IDLE, oscillation.START, steering_monitor.START)


class Autopilot(NamedTuple):
    """The autopilot of a run: its parameters, a record of STATE, and the settings of the control law."""

    boat: Boat
    state: Any
    law: LawSettings
