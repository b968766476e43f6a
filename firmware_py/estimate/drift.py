"""Drift angle: course over ground less heading, smoothed, for goals that are courses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.angles import wrap_pi
from firmware_py.records import PositionSample

# Below this speed a receiver's course is noise.
SPEED_MINIMUM_M_S = 0.1
TIME_CONSTANT_S = 20.0
# Above this yaw rate the course, which a receiver gives late, is compared with another heading.
YAW_RATE_MAXIMUM_RAD_S = 0.02


@dataclass(frozen=True, slots=True)
class DriftState:
    """The smoothed drift angle and when a fix last came that told of it."""

    t_s: float | None = None
    drift_rad: float = 0.0


def update(state: DriftState, sample: PositionSample, heading_rad: float | None, yaw_rate_rad_s: float) -> DriftState:
    """Take one fix in; without a course, a heading or way on, and in a turn, the angle stays."""
    course_rad, speed_m_s = sample.course_over_ground_rad, sample.speed_over_ground_m_s
    if heading_rad is None or course_rad is None or speed_m_s is None:
        return state
    if not (math.isfinite(course_rad) and speed_m_s >= SPEED_MINIMUM_M_S):
        return state
    if state.t_s is None or abs(yaw_rate_rad_s) > YAW_RATE_MAXIMUM_RAD_S:
        return DriftState(sample.t_s, state.drift_rad)
    gain = 1.0 - math.exp(-max(0.0, sample.t_s - state.t_s) / TIME_CONSTANT_S)
    innovation_rad = wrap_pi(course_rad - heading_rad - state.drift_rad)
    return DriftState(sample.t_s, wrap_pi(state.drift_rad + gain * innovation_rad))
