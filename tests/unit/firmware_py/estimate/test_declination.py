import math

import pytest

from firmware_py.estimate.declination import Declination, declination_rad, horizontal_field_nt, update

YEAR_S = 365.25 * 86400.0
EPOCH_S = 1_735_689_600.0

# Latitude, longitude, decimal year at sea level and the declination in degrees, from NOAA's test
# values of the WMM2025 (2025.0) and its own reference program's results for the later years.
VECTORS = [
    (80.0, 0.0, 2025.0, 1.28),
    (0.0, 120.0, 2025.0, -0.16),
    (-80.0, 240.0, 2027.5, 68.49),
    (36.0, 121.0, 2026.0, -7.67),
    (51.5, -0.1, 2026.5, 1.17),
]


@pytest.mark.parametrize(("latitude", "longitude", "year", "degrees"), VECTORS)
def test_the_declination_is_that_of_the_model(latitude, longitude, year, degrees):
    utc_s = EPOCH_S + (year - 2025.0) * YEAR_S
    found = declination_rad(math.radians(latitude), math.radians(longitude), utc_s)
    assert math.degrees(found) == pytest.approx(degrees, abs=0.006)


def test_there_is_no_declination_at_the_magnetic_pole():
    assert declination_rad(math.radians(85.8), math.radians(139.3), EPOCH_S) is None


@pytest.mark.parametrize("latitude", [-90.0, -89.999999, 90.0])
def test_the_poles_of_the_earth_are_valid(latitude):
    north, east = horizontal_field_nt(math.radians(latitude), 1.0, EPOCH_S)
    assert math.isfinite(north)
    assert 1000.0 < math.hypot(north, east) < 25000.0


def test_it_is_computed_again_only_after_10_km_or_30_days():
    here = update(Declination(), 0.6, 2.1, EPOCH_S)
    assert here.declination_rad is not None
    assert update(here, 0.6 + 1e-4, 2.1, EPOCH_S + 86400.0) is here
    assert update(here, 0.6, 2.1, None) is here
    assert update(here, 0.603, 2.1, EPOCH_S) is not here
    assert update(here, 0.6, 2.1, EPOCH_S + 40.0 * 86400.0) is not here


def test_without_a_date_it_is_that_of_the_model_epoch():
    assert update(Declination(), 0.6, 2.1, None).declination_rad == declination_rad(0.6, 2.1, EPOCH_S)
