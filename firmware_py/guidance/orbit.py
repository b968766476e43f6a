"""Circling a place: a vector field that converges to the circle, and the angle travelled."""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import wrap_pi, wrap_two_pi
from firmware_py.guidance.tasks import Orbit, TaskSettings, VesselMotion

LEAD_S = 8.0  # compensates for the lag behind a course with a constant rate
MIN_ORBIT_RADII = 1.5  # in turning radii; some rudder stays in reserve
ON_CIRCLE_FRACTION = 0.5  # of the radius: maximum distance from the circle at which the angle counts


class OrbitState(msgspec.Struct, frozen=True):
    """Bearing from the centre at the last step, and the angle travelled in the direction of the task."""

    bearing_rad: float | None = None
    turned_rad: float = 0.0


def radius_m(settings: TaskSettings, task: Orbit) -> float:
    """Return the radius of the task, or the smallest radius that the boat can follow."""
    return max(task.radius_m, MIN_ORBIT_RADII * settings.turning_radius_m)


def update(settings: TaskSettings, state: OrbitState, task: Orbit, motion: VesselMotion) -> tuple[OrbitState, float]:
    """Return the new state and the course over ground to steer."""
    distance_m, bearing_rad = task.centre.distance_and_bearing(motion.place)
    circle_m = radius_m(settings, task)
    sign = 1.0 if task.clockwise else -1.0
    outside_m = distance_m - circle_m
    turned_rad = state.turned_rad
    is_on_circle = motion.spread_m <= circle_m and abs(outside_m) <= ON_CIRCLE_FRACTION * circle_m
    if state.bearing_rad is not None and is_on_circle:
        turned_rad += sign * wrap_pi(bearing_rad - state.bearing_rad)
    lead_rad = LEAD_S * motion.speed_m_s / circle_m
    inward_rad = math.atan(outside_m / settings.turning_radius_m)
    course_rad = bearing_rad + sign * (0.5 * math.pi + lead_rad + inward_rad)
    return OrbitState(bearing_rad, turned_rad), wrap_two_pi(course_rad)
