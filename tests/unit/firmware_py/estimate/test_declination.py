import math
import zlib

import numpy as np
import pytest
from scipy.special import lpmv

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.estimate import declination, wmm2025
from firmware_py.estimate.declination import Declination, declination_rad, horizontal_field_nt, update

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


# Latitude, longitude [deg], date and the date that counts: the model is not extrapolated beyond 2025 to 2035.
DATED_PLACES = [
    (12.0, 200.0, 2025.0, 2025.0),
    (-63.0, 33.0, 2027.5, 2027.5),
    (78.0, -100.0, 2034.9, 2034.9),
    (-5.0, 75.0, 2035.6, 2035.0),
    (45.0, 10.0, 2023.0, 2025.0),
]


def potential(position_km, years):
    """Return the magnetic potential [nT km] at a position in the coordinates of the earth (report, equation 4)."""
    x, y, z = position_km
    radius_km, longitude_rad = math.hypot(x, y, z), math.atan2(y, x)
    result = 0.0
    for n, m, g, h, g_year, h_year in wmm2025.COEFFICIENTS:
        schmidt = (-1.0) ** m * math.sqrt((2.0 if m else 1.0) * math.factorial(n - m) / math.factorial(n + m))
        wave = (g + years * g_year) * math.cos(m * longitude_rad) + (h + years * h_year) * math.sin(m * longitude_rad)
        result += (6371.2 / radius_km) ** (n + 1) * wave * schmidt * lpmv(m, n, z / radius_km)
    return 6371.2 * result


@pytest.mark.parametrize(("latitude", "longitude", "year", "model_year"), DATED_PLACES)
def test_field_is_the_gradient_of_the_potential(latitude, longitude, year, model_year):
    lat, lon, flat = math.radians(latitude), math.radians(longitude), 1.0 / 298.257223563
    axis = np.array([math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), (1.0 - flat) ** 2 * math.sin(lat)])
    position_km = 6378.137 * axis / math.sqrt(1.0 - flat * (2.0 - flat) * math.sin(lat) ** 2)
    north = np.array([-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)])
    east = np.array([-math.sin(lon), math.cos(lon), 0.0])
    expected_nt = [
        (potential(position_km - step, model_year - 2025.0) - potential(position_km + step, model_year - 2025.0)) / 0.02
        for step in (0.01 * north, 0.01 * east)
    ]
    utc_s = EPOCH_S + (year - 2025.0) * YEAR_S
    assert horizontal_field_nt(lat, lon, utc_s) == pytest.approx(expected_nt, abs=1e-3)


@pytest.mark.parametrize(("latitude", "longitude", "year", "degrees"), VECTORS)
def test_declination_equals_the_reference_values(latitude, longitude, year, degrees):
    utc_s = EPOCH_S + (year - 2025.0) * YEAR_S
    result_rad = declination_rad(math.radians(latitude), math.radians(longitude), utc_s)
    assert math.degrees(result_rad) == pytest.approx(degrees, abs=0.006)


def test_coefficients_are_the_published_ones():
    """A wrong digit of a high degree changes the declination by less than a thousandth of a degree."""
    rows = "\n".join(" ".join(str(value + 0.0) for value in row) for row in wmm2025.COEFFICIENTS)
    assert zlib.crc32(rows.encode()) == 684922188


def test_declination_is_none_below_2000_nt_near_the_magnetic_pole():
    for latitude, field_nt in ((85.8, 17.0), (81.8, 1939.0), (81.6, 2044.0)):
        place = (math.radians(latitude), math.radians(139.3), EPOCH_S)
        assert math.hypot(*horizontal_field_nt(*place)) == pytest.approx(field_nt, abs=5.0)
        assert (declination_rad(*place) is None) is (field_nt < 2000.0)


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
        (0.6, 2.1, EPOCH_S + 30.0 * 86400.0, False),
        (0.6, 2.1, EPOCH_S + 30.1 * 86400.0, False),
        (0.6, 2.1, EPOCH_S - 30.1 * 86400.0, False),
    ],
)
def test_declination_is_computed_again_only_after_10_km_or_30_days(latitude_rad, longitude_rad, utc_s, is_same):
    previous = update(Declination(), 0.6, 2.1, EPOCH_S)
    assert previous.declination_rad is not None
    assert (update(previous, latitude_rad, longitude_rad, utc_s) is previous) is is_same


def test_declination_is_computed_again_at_a_distance_of_10_km():
    previous = Declination(0.1, 0.0, 0.0, EPOCH_S)
    assert update(previous, 10e3 / EARTH_RADIUS_M, 0.0, EPOCH_S) is not previous


@pytest.mark.parametrize(
    ("east_nt", "expected_rad"), [(1999.9, None), (2000.0, 0.5 * math.pi), (-2000.0, -0.5 * math.pi)]
)
def test_compass_needs_a_horizontal_field_of_2000_nt(monkeypatch, east_nt, expected_rad):
    monkeypatch.setattr(declination, "horizontal_field_nt", lambda *_: (0.0, east_nt))
    assert declination_rad(0.6, 2.1, EPOCH_S) == expected_rad


def test_declination_without_a_date_is_that_of_the_epoch():
    assert update(Declination(), 0.6, 2.1, None).declination_rad == declination_rad(0.6, 2.1, EPOCH_S)
