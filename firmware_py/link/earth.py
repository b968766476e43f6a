"""Positions near each other and on the sphere."""

from __future__ import annotations

import math

EARTH_M = 6_378_137.0  # equatorial radius of WGS84
_MEAN_EARTH_M = 6_371_008.8  # mean radius, IUGG


def offset_m(
    from_latitude_rad: float, from_longitude_rad: float, latitude_rad: float, longitude_rad: float
) -> tuple[float, float]:
    """Return how far north and east of one position another lies, as offset_goal counts."""
    north_m = (latitude_rad - from_latitude_rad) * EARTH_M
    east_m = math.remainder(longitude_rad - from_longitude_rad, 2.0 * math.pi) * EARTH_M * math.cos(from_latitude_rad)
    return north_m, east_m


def destination(
    latitude_rad: float, longitude_rad: float, distance_m: float, bearing_rad: float
) -> tuple[float, float]:
    """Return the position at a great-circle distance and initial bearing, on the sphere that guidance measures on."""
    arc_rad = distance_m / _MEAN_EARTH_M
    sine = math.sin(latitude_rad) * math.cos(arc_rad) + math.cos(latitude_rad) * math.sin(arc_rad) * math.cos(
        bearing_rad
    )
    reached_rad = math.asin(min(1.0, max(-1.0, sine)))
    turned_rad = math.atan2(
        math.sin(bearing_rad) * math.sin(arc_rad) * math.cos(latitude_rad),
        math.cos(arc_rad) - math.sin(latitude_rad) * sine,
    )
    return reached_rad, math.remainder(longitude_rad + turned_rad, 2.0 * math.pi)
