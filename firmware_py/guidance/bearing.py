"""Distance and initial bearing between two positions on the sphere."""

from __future__ import annotations

import math

from firmware_py.common.angles import wrap_two_pi

EARTH_RADIUS_M = 6371008.8  # mean radius, IUGG


def distance_and_bearing(
    latitude_rad: float,
    longitude_rad: float,
    to_latitude_rad: float,
    to_longitude_rad: float,
) -> tuple[float, float]:
    """Return the great-circle distance [m] and the initial bearing [rad, from true north] to a position.

    Haversine formula, accurate from metres to half the globe; the sphere's error against
    the ellipsoid is at most 0.6 % of the distance.
    """
    half_latitude_rad = 0.5 * (to_latitude_rad - latitude_rad)
    longitude_change_rad = to_longitude_rad - longitude_rad
    haversine = (
        math.sin(half_latitude_rad) ** 2
        + math.cos(latitude_rad) * math.cos(to_latitude_rad) * math.sin(0.5 * longitude_change_rad) ** 2
    )
    distance_m = 2.0 * EARTH_RADIUS_M * math.asin(math.sqrt(min(1.0, haversine)))
    bearing_rad = math.atan2(
        math.sin(longitude_change_rad) * math.cos(to_latitude_rad),
        math.cos(latitude_rad) * math.sin(to_latitude_rad)
        - math.sin(latitude_rad) * math.cos(to_latitude_rad) * math.cos(longitude_change_rad),
    )
    return distance_m, wrap_two_pi(bearing_rad)
