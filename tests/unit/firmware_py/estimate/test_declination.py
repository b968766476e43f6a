import math
import zlib

import pytest

from firmware_py.estimate.declination import Declination, declination_rad, horizontal_field_nt, update
from firmware_py.estimate.wmm2025 import COEFFICIENTS

YEAR_S = 365.25 * 86400.0
EPOCH_S = 1_735_689_600.0

# Latitude, longitude [deg], decimal year and declination [deg] at sea level: from NOAA's test values of the WMM2025 for
# 2025.0, and results of NOAA's reference program for later years.
VECTORS = [
    (80.0, 0.0, 2025.0, 1.28),
    (0.0, 120.0, 2025.0, -0.16),
    (-80.0, 240.0, 2027.5, 68.49),
    (36.0, 121.0, 2026.0, -7.67),
    (51.5, -0.1, 2026.5, 1.17),
]


@pytest.mark.parametrize(("latitude", "longitude", "year", "degrees"), VECTORS)
def test_declination_equals_the_reference_values(latitude, longitude, year, degrees):
    utc_s = EPOCH_S + (year - 2025.0) * YEAR_S
    result_rad = declination_rad(math.radians(latitude), math.radians(longitude), utc_s)
    assert math.degrees(result_rad) == pytest.approx(degrees, abs=0.006)


def test_coefficients_are_the_published_ones():
    """A wrong digit of a high degree changes the declination by less than a thousandth of a degree."""
    rows = "\n".join(" ".join(f"{value + 0.0:.1f}" for value in row) for row in COEFFICIENTS)
    assert zlib.crc32(rows.encode()) == 684922188


def test_declination_is_none_at_the_magnetic_pole():
    assert declination_rad(math.radians(85.8), math.radians(139.3), EPOCH_S) is None


@pytest.mark.parametrize("latitude", [-90.0, -89.999999, 90.0])
def test_field_is_finite_at_the_geographic_poles(latitude):
    north, east = horizontal_field_nt(math.radians(latitude), 1.0, EPOCH_S)
    assert math.isfinite(north)
    assert 1000.0 < math.hypot(north, east) < 25000.0


@pytest.mark.parametrize(
    ("latitude_rad", "longitude_rad", "utc_s", "is_same"),
    [
        (0.6 + 1e-4, 2.1, EPOCH_S + 86400.0, True),
        (0.6, 2.1, None, True),
        (0.6 + 9.9e3 / 6371e3, 2.1, EPOCH_S, True),
        (0.6 + 10.1e3 / 6371e3, 2.1, EPOCH_S, False),
        (0.6, 2.1 - 11.9e3 / 6371e3, EPOCH_S, True),
        (0.6, 2.1 - 12.3e3 / 6371e3, EPOCH_S, False),
        (0.6, 2.1, EPOCH_S + 29.9 * 86400.0, True),
        (0.6, 2.1, EPOCH_S + 30.1 * 86400.0, False),
        (0.6, 2.1, EPOCH_S - 30.1 * 86400.0, False),
    ],
)
def test_declination_is_computed_again_only_after_10_km_or_30_days(latitude_rad, longitude_rad, utc_s, is_same):
    previous = update(Declination(), 0.6, 2.1, EPOCH_S)
    assert previous.declination_rad is not None
    assert (update(previous, latitude_rad, longitude_rad, utc_s) is previous) is is_same


def test_declination_without_a_date_is_that_of_the_epoch():
    assert update(Declination(), 0.6, 2.1, None).declination_rad == declination_rad(0.6, 2.1, EPOCH_S)
