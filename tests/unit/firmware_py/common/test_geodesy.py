import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import EARTH_RADIUS_M, Place, track

latitudes, longitudes = st.floats(-math.pi / 2, math.pi / 2), st.floats(-math.pi, math.pi)
places = st.builds(Place, latitudes, longitudes)
HERE = Place(0.6, 2.0)


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
    here, there = Place(*map(math.radians, here_deg)), Place(*map(math.radians, there_deg))
    found_m, found_rad = here.distance_and_bearing(there)
    assert found_m == pytest.approx(distance_m, rel=2e-4, abs=1e-6)
    assert math.degrees(found_rad) == pytest.approx(bearing_deg, abs=0.02)


def test_a_metre_is_resolved():
    found_m, _ = Place(0.8, 0.1).distance_and_bearing(Place(0.8 + 1.0 / EARTH_RADIUS_M, 0.1))
    assert found_m == pytest.approx(1.0, rel=1e-6)


def test_along_the_equator_north_is_to_port():
    on = track(Place(0.0, 0.0), Place(0.0, 0.001), Place(0.0001, 0.0004))
    assert on.cross_track_m == pytest.approx(-637.1, abs=0.1)
    assert on.remaining_m == pytest.approx(0.0006 * EARTH_RADIUS_M, rel=1e-6)
    assert on.course_rad == pytest.approx(math.pi / 2)


def test_beyond_the_end_the_rest_is_negative():
    assert track(HERE, HERE.at_offset(100.0, 0.0), HERE.at_offset(130.0, 5.0)).remaining_m == pytest.approx(
        -30.0, abs=0.01
    )


def test_a_line_needs_a_length():
    assert track(HERE, HERE.at_offset(1.0, 0.0), HERE).course_rad % (2 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert track(HERE, HERE, HERE.at_offset(5.0, 5.0)) is None


def test_across_the_date_line_and_over_the_pole_lines_are_short():
    on = track(Place(0.1, math.pi - 1e-5), Place(0.1, -math.pi + 1e-5), Place(0.1, math.pi))
    assert abs(on.cross_track_m) < 1e-2
    assert on.remaining_m == pytest.approx(1e-5 * math.cos(0.1) * EARTH_RADIUS_M, rel=1e-3)
    over = track(Place(1.57, 0.0), Place(1.57, math.pi), Place(math.pi / 2, 0.3))
    assert abs(over.cross_track_m) < 1e-3


@given(places, st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0))
def test_offset_and_distance_agree(place, north_m, east_m):
    if abs(place.latitude_rad) > 1.4:
        return
    found = place.offset_m(place.at_offset(north_m, east_m))
    assert found == pytest.approx((north_m, east_m), abs=4.0)


@given(places, places, places)
def test_any_places_give_finite_numbers(start, end, here):
    on = track(start, end, here)
    if on is not None:
        assert all(map(math.isfinite, (on.cross_track_m, on.remaining_m, on.course_rad)))
        assert abs(on.cross_track_m) <= math.pi / 2 * EARTH_RADIUS_M + 1.0
        assert 0.0 <= on.course_rad < 2 * math.pi


@given(places, st.floats(-1000.0, 1000.0), st.floats(-1000.0, 1000.0))
def test_nearby_offsets_agree(place, north_m, east_m):
    if abs(place.latitude_rad) > 1.2:
        return
    there = place.at_offset(north_m, east_m)
    for offset in (place.offset_m, place.nearby_offset_m, place.local_offset_m):
        assert offset(there) == pytest.approx((north_m, east_m), rel=2e-3, abs=1.0)


@given(places, st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_the_local_frame_is_invertible(place, north_m, east_m):
    there = place.at_local_offset(north_m, east_m)
    if there is not None:
        assert place.local_offset_m(there) == pytest.approx((north_m, east_m), abs=1e-4)
    else:
        assert math.pi / 2 - abs(place.latitude_rad) < 1e5 / EARTH_RADIUS_M


def test_offsets_cross_the_date_line():
    west, east = Place(0.0, math.pi - 1e-6), Place(0.0, -math.pi + 1e-6)
    assert west.local_offset_m(east) == pytest.approx((0.0, 12.742), abs=0.01)
    assert west.nearby_offset_m(east) == pytest.approx((0.0, 12.742), abs=0.01)
