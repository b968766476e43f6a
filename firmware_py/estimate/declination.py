"""Magnetic declination from the World Magnetic Model, computed again after 10 km or 30 days.

Spherical harmonics of degree 12 with Schmidt's semi-normalised Legendre functions on the WGS 84
ellipsoid (Chulliat et al., The US/UK World Magnetic Model for 2025-2030, NOAA, section 1.2).
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate.wmm2025 import COEFFICIENTS, DEGREE, EPOCH

MAX_DISTANCE_RAD: Final = 10e3 / EARTH_RADIUS_M
MAX_AGE_S: Final = 30.0 * 86400.0
YEAR_S: Final = 365.25 * 86400.0
EPOCH_S: Final = 1_735_689_600.0  # 2025-01-01 UTC
MAX_MODEL_YEARS: Final = 10.0  # the model is valid for 5 years; after 10 it is no longer extrapolated
MAJOR_KM, MINOR_KM, REFERENCE_KM = 6378.137, 6356.7523142, 6371.2
MIN_COSINE: Final = 1e-6
# Below this horizontal field [nT] a compass shows no north; the authors of the model advise caution below 6000 nT.
MIN_HORIZONTAL_FIELD_NT: Final = 2000.0


class Declination(msgspec.Struct, frozen=True):
    """Declination (None: no compass works there), and the place and time for which it was computed."""

    declination_rad: float | None = None
    latitude_rad: float = 0.0
    longitude_rad: float = 0.0
    utc_s: float | None = None


def update(before: Declination, latitude_rad: float, longitude_rad: float, utc_s: float | None) -> Declination:
    """Return the declination at a position; near the place of the last one, that one."""
    at_s = utc_s if utc_s is not None else before.utc_s if before.utc_s is not None else EPOCH_S
    if before.utc_s is not None and abs(at_s - before.utc_s) < MAX_AGE_S:
        east = (longitude_rad - before.longitude_rad) * math.cos(latitude_rad)
        if math.hypot(latitude_rad - before.latitude_rad, east) < MAX_DISTANCE_RAD:
            return before
    return Declination(declination_rad(latitude_rad, longitude_rad, at_s), latitude_rad, longitude_rad, at_s)


def declination_rad(latitude_rad: float, longitude_rad: float, utc_s: float) -> float | None:
    """Return the declination at sea level, east positive; None near the magnetic poles."""
    north_nt, east_nt = horizontal_field_nt(latitude_rad, longitude_rad, utc_s)
    if math.hypot(north_nt, east_nt) < MIN_HORIZONTAL_FIELD_NT:
        return None
    return math.atan2(east_nt, north_nt)


def horizontal_field_nt(latitude_rad: float, longitude_rad: float, utc_s: float) -> tuple[float, float]:
    """Return the field's north and east components [nT] at sea level, geodetic."""
    years = min(max((utc_s - EPOCH_S) / YEAR_S, 0.0), MAX_MODEL_YEARS)
    geocentric_rad, radius_km = _geocentric(latitude_rad)
    sine = math.sin(geocentric_rad)
    cosine = max(math.cos(geocentric_rad), MIN_COSINE)
    functions, slopes = _legendre(sine, cosine)
    ratio = REFERENCE_KM / radius_km
    north = east = down = 0.0
    for degree, order, g, h, g_year, h_year in COEFFICIENTS:
        g += g_year * years  # noqa: PLW2901
        h += h_year * years  # noqa: PLW2901
        power = ratio ** (degree + 2)
        along, across = math.cos(order * longitude_rad), math.sin(order * longitude_rad)
        value, slope = functions[degree][order], slopes[degree][order]
        north -= power * (g * along + h * across) * slope
        east += power * order * (g * across - h * along) * value / cosine
        down -= power * (degree + 1) * (g * along + h * across) * value
    # From the geocentric to the geodetic vertical.
    tilt_rad = geocentric_rad - latitude_rad
    return north * math.cos(tilt_rad) - down * math.sin(tilt_rad), east


def _geocentric(latitude_rad: float) -> tuple[float, float]:
    """Return the geocentric latitude and radius [km] of a point on the ellipsoid."""
    sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
    square = 1.0 - (MINOR_KM / MAJOR_KM) ** 2
    curvature_km = MAJOR_KM / math.sqrt(1.0 - square * sine * sine)
    out_km, up_km = curvature_km * cosine, curvature_km * (1.0 - square) * sine
    return math.atan2(up_km, out_km), math.hypot(out_km, up_km)


def _legendre(sine: float, cosine: float) -> tuple[list[list[float]], list[list[float]]]:
    """Return Schmidt's functions P[n][m](sin latitude) and their derivatives by the latitude."""
    size = DEGREE + 1
    p = [[0.0] * size for _ in range(size)]
    d = [[0.0] * size for _ in range(size)]
    p[0][0] = 1.0
    for n in range(1, size):
        for m in range(n + 1):
            if n == m:
                factor = math.sqrt((2.0 * n - 1.0) / (2.0 * n)) if n > 1 else 1.0
                p[n][n] = factor * cosine * p[n - 1][n - 1]
                d[n][n] = factor * (cosine * d[n - 1][n - 1] - sine * p[n - 1][n - 1])
                continue
            root = math.sqrt(float(n * n - m * m))
            older = math.sqrt(float((n - 1) ** 2 - m * m)) if n >= 2 and m <= n - 2 else 0.0
            before, before_slope = (p[n - 2][m], d[n - 2][m]) if n >= 2 else (0.0, 0.0)
            p[n][m] = ((2.0 * n - 1.0) * sine * p[n - 1][m] - older * before) / root
            slope = (2.0 * n - 1.0) * (sine * d[n - 1][m] + cosine * p[n - 1][m])
            d[n][m] = (slope - older * before_slope) / root
    return p, d


__all__ = ["EPOCH", "Declination", "declination_rad", "horizontal_field_nt", "update"]
