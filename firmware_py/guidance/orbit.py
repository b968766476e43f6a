"""Going round a place: a field of courses that leads onto the circle, and the angle gone round."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_py.common.angles import wrap_pi, wrap_two_pi
from firmware_py.guidance.tasks import Orbit, TaskSettings, VesselMotion

LEAD_S = 8.0  # she lags behind a course that turns all the time
SMALLEST_RADII = 1.5  # of her turning circle: what she can go round at all, with some rudder to spare
NEAR_PART = 0.5  # of the radius: as near the circle the angle counts


@dataclass(frozen=True, slots=True)
class OrbitState:
    """The bearing from the centre at the last step, and the angle gone round since."""

    bearing_rad: float | None = None
    turned_rad: float = 0.0


def radius_m(settings: TaskSettings, order: Orbit) -> float:
    """Return the radius that she sails: the ordered one, or the smallest she can."""
    return max(order.radius_m, SMALLEST_RADII * settings.turning_radius_m)


def circle(settings: TaskSettings, state: OrbitState, order: Orbit, motion: VesselMotion) -> tuple[OrbitState, float]:
    """Return the state and the course over ground to steer."""
    distance_m, bearing_rad = order.centre.distance_and_bearing(motion.place)
    wanted_m = radius_m(settings, order)
    side = 1.0 if order.clockwise else -1.0
    outside_m = distance_m - wanted_m
    turned_rad = state.turned_rad
    if state.bearing_rad is not None and abs(outside_m) <= NEAR_PART * wanted_m:
        turned_rad += side * wrap_pi(bearing_rad - state.bearing_rad)
    lead_rad = LEAD_S * motion.speed_m_s / wanted_m
    inward_rad = math.atan(outside_m / settings.turning_radius_m)
    course_rad = bearing_rad + side * (0.5 * math.pi + lead_rad + inward_rad)
    return OrbitState(bearing_rad, turned_rad), wrap_two_pi(course_rad)
