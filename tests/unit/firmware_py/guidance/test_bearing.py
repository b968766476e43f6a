import math

import pytest

from firmware_py.guidance.bearing import EARTH_RADIUS_M, distance_and_bearing


@pytest.mark.parametrize(
    ("here_deg", "there_deg", "distance_m", "bearing_deg"),
    [
        ((0.0, 0.0), (0.0, 90.0), EARTH_RADIUS_M * math.pi / 2, 90.0),
        ((0.0, 0.0), (1.0, 0.0), EARTH_RADIUS_M * math.pi / 180, 0.0),
        ((10.0, 179.5), (10.0, -179.5), 109_505.0, 89.9),  # across the date line
        ((50.06639, -5.71472), (58.64389, -3.07), 968_853.5, 9.1198),  # Land's End to John o' Groats
        ((45.0, 7.0), (45.0, 7.0), 0.0, 0.0),
    ],
)
def test_known_distances_and_bearings(here_deg, there_deg, distance_m, bearing_deg):
    found_m, found_rad = distance_and_bearing(*map(math.radians, (*here_deg, *there_deg)))
    assert found_m == pytest.approx(distance_m, rel=2e-4, abs=1e-6)
    assert math.degrees(found_rad) == pytest.approx(bearing_deg, abs=0.02)


def test_a_metre_is_resolved():
    found_m, _ = distance_and_bearing(0.8, 0.1, 0.8 + 1.0 / EARTH_RADIUS_M, 0.1)
    assert found_m == pytest.approx(1.0, rel=1e-6)
