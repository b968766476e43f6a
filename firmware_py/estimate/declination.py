"""Magnetic declination from the World Magnetic Model, computed again after 10 km or 30 days.

Spherical harmonics of degree 12 with Schmidt's semi-normalised Legendre functions on the WGS 84
ellipsoid (Chulliat et al., The US/UK World Magnetic Model for 2025-2030, NOAA, section 1.2).
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate.wmm2025 import COEFFICIENTS, DEGREE

MAX_DISTANCE_RAD: Final = 10e3 / EARTH_RADIUS_M  # from the position for which it was computed
MAX_AGE_S: Final = 30.0 * 86400.0
YEAR_S: Final = 365.25 * 86400.0
EPOCH_S: Final = 1_735_689_600.0  # 2025-01-01 UTC
MAX_MODEL_YEARS: Final = 10.0  # the model is valid for 5 years; after 10 it is no longer extrapolated
MAJOR_KM, MINOR_KM, REFERENCE_KM = 6378.137, 6356.7523142, 6371.2  # semi-axes of WGS 84; radius of the model
# In a smaller horizontal field a compass is not usable; the authors of the model advise caution below 6000 nT.
MIN_HORIZONTAL_FIELD_NT: Final = 2000.0


class Declination(msgspec.Struct, frozen=True):
    """Declination, and the position and time for which it was computed; None: a compass is not usable there.

    `utc_s` None: not computed yet.
    """

    declination_rad: float | None = None
    latitude_rad: float = 0.0
    longitude_rad: float = 0.0
    utc_s: float | None = None


def update(previous: Declination, latitude_rad: float, longitude_rad: float, utc_s: float | None) -> Declination:
    """Return the declination at a position: the previous one if that is near enough in distance and time.

    With `utc_s` None, the time of the previous one is used, without one EPOCH_S.
    """
    time_s = utc_s if utc_s is not None else previous.utc_s if previous.utc_s is not None else EPOCH_S
    if previous.utc_s is not None and abs(time_s - previous.utc_s) < MAX_AGE_S:
        east_rad = (longitude_rad - previous.longitude_rad) * math.cos(latitude_rad)
        if math.hypot(latitude_rad - previous.latitude_rad, east_rad) < MAX_DISTANCE_RAD:
            return previous
    return Declination(declination_rad(latitude_rad, longitude_rad, time_s), latitude_rad, longitude_rad, time_s)


def declination_rad(latitude_rad: float, longitude_rad: float, utc_s: float) -> float | None:
    """Return the declination at sea level, positive to the east; None near the magnetic poles."""
    north_nt, east_nt = horizontal_field_nt(latitude_rad, longitude_rad, utc_s)
    if math.hypot(north_nt, east_nt) < MIN_HORIZONTAL_FIELD_NT:
        return None
    return math.atan2(east_nt, north_nt)


def horizontal_field_nt(latitude_rad: float, longitude_rad: float, utc_s: float) -> tuple[float, float]:
    """Return the north and east components of the field [nT] at sea level, at a geodetic latitude."""
    years = min(max((utc_s - EPOCH_S) / YEAR_S, 0.0), MAX_MODEL_YEARS)
    geocentric_rad, radius_km = _geocentric(latitude_rad)
    sine, cosine = math.sin(geocentric_rad), math.cos(geocentric_rad)  # the cosine of a float is never 0
    legendre, derivatives = _legendre(sine, cosine)
    ratio = REFERENCE_KM / radius_km
    north = east = down = 0.0
    for degree, order, g, h, g_year, h_year in COEFFICIENTS:
        g += g_year * years  # noqa: PLW2901
        h += h_year * years  # noqa: PLW2901
        power = ratio ** (degree + 2)
        order_cosine, order_sine = math.cos(order * longitude_rad), math.sin(order * longitude_rad)
        value, derivative = legendre[degree][order], derivatives[degree][order]
        north -= power * (g * order_cosine + h * order_sine) * derivative
        east += power * order * (g * order_sine - h * order_cosine) * value / cosine
        down -= power * (degree + 1) * (g * order_cosine + h * order_sine) * value
    # From the geocentric to the geodetic vertical.
    tilt_rad = geocentric_rad - latitude_rad
    return north * math.cos(tilt_rad) - down * math.sin(tilt_rad), east


def _geocentric(latitude_rad: float) -> tuple[float, float]:
    """Return the geocentric latitude and radius [km] of a point on the ellipsoid."""
    sine, cosine = math.sin(latitude_rad), math.cos(latitude_rad)
    eccentricity2 = 1.0 - (MINOR_KM / MAJOR_KM) ** 2
    curvature_km = MAJOR_KM / math.sqrt(1.0 - eccentricity2 * sine * sine)
    axis_km, equator_km = curvature_km * cosine, curvature_km * (1.0 - eccentricity2) * sine
    return math.atan2(equator_km, axis_km), math.hypot(axis_km, equator_km)


def _legendre(sine: float, cosine: float) -> tuple[list[list[float]], list[list[float]]]:
    """Return Schmidt's functions P[n][m](sin latitude) and their derivatives with respect to the latitude."""
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
            # 0 for m = n - 1, where there is no function of degree n - 2.
            older_root = math.sqrt(float((n - 1) ** 2 - m * m))
            older_p, older_d = p[n - 2][m], d[n - 2][m]
            p[n][m] = ((2.0 * n - 1.0) * sine * p[n - 1][m] - older_root * older_p) / root
            sum_d = (2.0 * n - 1.0) * (sine * d[n - 1][m] + cosine * p[n - 1][m])
            d[n][m] = (sum_d - older_root * older_d) / root
    return p, d
