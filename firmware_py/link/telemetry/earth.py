"""Positions near each other."""

from __future__ import annotations

import math

EARTH_M = 6_378_137.0  # equatorial radius of WGS84


def offset_m(
    from_latitude_rad: float, from_longitude_rad: float, latitude_rad: float, longitude_rad: float
) -> tuple[float, float]:
    """Return how far north and east of one position another lies, as offset_goal counts."""
    north_m = (latitude_rad - from_latitude_rad) * EARTH_M
    east_m = math.remainder(longitude_rad - from_longitude_rad, 2.0 * math.pi) * EARTH_M * math.cos(from_latitude_rad)
    return north_m, east_m
