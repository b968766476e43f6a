"""Drift angle: course over ground less heading, smoothed, for goals that are courses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.angles import wrap_pi
from firmware_py.records import PositionSample

# Below this speed a receiver's course is noise.
SPEED_MINIMUM_M_S = 0.1
TIME_CONSTANT_S = 20.0


@dataclass(frozen=True, slots=True)
class DriftState:
    """The smoothed drift angle and when it was last updated."""

    t_s: float | None = None
    drift_rad: float = 0.0


def update(state: DriftState, sample: PositionSample, heading_rad: float | None) -> DriftState:
    """Take one fix in; without a course, a heading or way on, nothing changes."""
    course_rad, speed_m_s = sample.course_over_ground_rad, sample.speed_over_ground_m_s
    if heading_rad is None or course_rad is None or speed_m_s is None:
        return state
    if not (math.isfinite(course_rad) and speed_m_s >= SPEED_MINIMUM_M_S):
        return state
    measured_rad = wrap_pi(course_rad - heading_rad)
    if state.t_s is None:
        return DriftState(sample.t_s, measured_rad)
    gain = 1.0 - math.exp(-max(0.0, sample.t_s - state.t_s) / TIME_CONSTANT_S)
    return DriftState(sample.t_s, wrap_pi(state.drift_rad + gain * wrap_pi(measured_rad - state.drift_rad)))
