"""Distances, bearings, tracks and offsets."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import EARTH_RADIUS_M, Place, is_possible_position, track

latitudes, longitudes = st.floats(-math.pi / 2, math.pi / 2), st.floats(-math.pi, math.pi)
places = st.builds(Place, latitudes, longitudes)
HERE = Place(0.6, 2.0)


@pytest.mark.parametrize(
    ("start_deg", "end_deg", "distance_m", "bearing_deg"),
    [
        ((0.0, 0.0), (0.0, 90.0), EARTH_RADIUS_M * math.pi / 2, 90.0),
        ((0.0, 0.0), (1.0, 0.0), EARTH_RADIUS_M * math.pi / 180, 0.0),
        ((10.0, 179.5), (10.0, -179.5), 109_505.0, 89.9),  # across the date line
        ((50.06639, -5.71472), (58.64389, -3.07), 968_853.5, 9.1198),  # Land's End to John o' Groats
        ((45.0, 7.0), (45.0, 7.0), 0.0, 0.0),
    ],
)
def test_distances_and_bearings(start_deg, end_deg, distance_m, bearing_deg):
    start, end = Place(*map(math.radians, start_deg)), Place(*map(math.radians, end_deg))
    measured_m, measured_rad = start.distance_and_bearing(end)
    assert measured_m == pytest.approx(distance_m, rel=2e-4, abs=1e-6)
    assert math.degrees(measured_rad) == pytest.approx(bearing_deg, abs=0.02)


def test_distance_of_one_metre():
    measured_m, _ = Place(0.8, 0.1).distance_and_bearing(Place(0.8 + 1.0 / EARTH_RADIUS_M, 0.1))
    assert measured_m == pytest.approx(1.0, rel=1e-6)


def test_offsets_of_a_nearby_place():
    place, other = Place(0.6, 2.0), Place(0.6001, 2.0002)
    for offset_m in (place.offset_m, place.nearby_offset_m, place.local_offset_m):
        assert offset_m(other) == pytest.approx((637.10, 1051.64), abs=0.1)
    for moved in (place.at_offset(637.10, 1051.64), place.at_local_offset(637.10, 1051.64)):
        assert (moved.latitude_rad, moved.longitude_rad) == pytest.approx((0.6001, 2.0002), abs=1e-7)


def test_cross_track_error_to_port_is_negative():
    position = track(Place(0.0, 0.0), Place(0.0, 0.001), Place(0.0001, 0.0004))
    assert position.cross_track_m == pytest.approx(-637.1, abs=0.1)
    assert position.remaining_m == pytest.approx(0.0006 * EARTH_RADIUS_M, rel=1e-6)
    assert position.course_rad == pytest.approx(math.pi / 2)


def test_remaining_distance_is_negative_beyond_the_end():
    position = track(HERE, HERE.at_offset(100.0, 0.0), HERE.at_offset(130.0, 5.0))
    assert position.remaining_m == pytest.approx(-30.0, abs=0.01)


def test_track_of_a_line_without_a_length_is_none():
    assert track(HERE, HERE.at_offset(1.0, 0.0), HERE).course_rad % (2 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert track(HERE, HERE, HERE.at_offset(5.0, 5.0)) is None
    assert [track(HERE, HERE.at_offset(length_m, 0.0), HERE) is None for length_m in (6.1e-3, 6.7e-3)] == [True, False]


def test_track_is_none_at_the_pole_of_its_line():
    for angle_rad, is_none in ((0.0, True), (0.95e-9, True), (1.05e-9, False)):
        position = track(Place(0.0, 0.0), Place(0.0, 1.0), Place(math.pi / 2 - angle_rad, 0.5))
        assert (position is None) is is_none


def test_tracks_across_the_date_line_and_the_pole():
    position = track(Place(0.1, math.pi - 1e-5), Place(0.1, -math.pi + 1e-5), Place(0.1, math.pi))
    assert abs(position.cross_track_m) < 1e-2
    assert position.remaining_m == pytest.approx(1e-5 * math.cos(0.1) * EARTH_RADIUS_M, rel=1e-3)
    polar = track(Place(1.57, 0.0), Place(1.57, math.pi), Place(math.pi / 2, 0.3))
    assert abs(polar.cross_track_m) < 1e-3
    assert math.cos(polar.course_rad) == pytest.approx(1.0)  # at the pole, as seen on the prime meridian


@given(places, st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0))
def test_offset_and_distance_agree(place, north_m, east_m):
    if abs(place.latitude_rad) > 1.4:
        return
    assert place.offset_m(place.at_offset(north_m, east_m)) == pytest.approx((north_m, east_m), abs=4.0)


@given(places, places, places)
def test_tracks_of_any_places_are_finite(start, end, here):
    position = track(start, end, here)
    if position is not None:
        assert all(map(math.isfinite, (position.cross_track_m, position.remaining_m, position.course_rad)))
        assert abs(position.cross_track_m) <= math.pi / 2 * EARTH_RADIUS_M + 1.0
        assert 0.0 <= position.course_rad < 2 * math.pi


@given(places, st.floats(-1000.0, 1000.0), st.floats(-1000.0, 1000.0))
def test_nearby_offsets_agree(place, north_m, east_m):
    if abs(place.latitude_rad) > 1.2:
        return
    other = place.at_offset(north_m, east_m)
    for offset in (place.offset_m, place.nearby_offset_m, place.local_offset_m):
        assert offset(other) == pytest.approx((north_m, east_m), rel=2e-3, abs=1.0)


@given(places, st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_local_offset_is_the_inverse_of_at_local_offset(place, north_m, east_m):
    other = place.at_local_offset(north_m, east_m)
    if other is not None:
        assert place.local_offset_m(other) == pytest.approx((north_m, east_m), abs=1e-4)
    else:
        assert math.pi / 2 - abs(place.latitude_rad) < 1e5 / EARTH_RADIUS_M


@pytest.mark.parametrize(
    ("latitude_rad", "longitude_rad", "is_possible"),
    [
        (0.0, 0.0, False),
        (0.99e-6, -0.99e-6, False),
        (1e-6, 0.0, True),
        (0.0, -1e-6, True),
        (math.radians(89.9), math.pi, True),
        (math.radians(-89.9), -math.pi, True),
        (math.radians(89.91), 0.0, False),
        (math.radians(-89.91), 0.0, False),
        (0.5, 3.15, False),
        (0.5, -3.15, False),
        (math.nan, 0.5, False),
        (0.5, math.nan, False),
    ],
)
def test_position_near_a_pole_or_at_0_n_0_e_is_impossible(latitude_rad, longitude_rad, is_possible):
    assert is_possible_position(latitude_rad, longitude_rad) is is_possible


def test_offsets_near_a_pole():
    near_pole = Place(math.pi / 2 - 1.05e-3, 0.0)
    assert near_pole.at_local_offset(6600.0, 0.0) is not None
    assert near_pole.at_local_offset(6800.0, 0.0) is None
    assert Place(-near_pole.latitude_rad, 0.0).at_local_offset(-6800.0, 0.0) is None
    assert Place(math.pi / 2 - 0.99e-3, 0.0).at_local_offset(0.0, 0.0) is None
    # Beyond the pole, the place is the pole, with a large but finite change of longitude.
    for side in (1.0, -1.0):
        beyond = Place(side * 1.57, 0.0).at_offset(side * 10_000.0, 1.0)
        assert (beyond.latitude_rad, beyond.longitude_rad) == pytest.approx((side * math.pi / 2, 1e6 / 6371008.8))


@given(places, places, places)
def test_track_agrees_with_the_formulas_of_spherical_trigonometry(start, end, here):
    position = track(start, end, here)
    length_m, course_rad = start.distance_and_bearing(end)
    distance_m, bearing_rad = start.distance_and_bearing(here)
    angle_rad = distance_m / 6371008.8
    if position is None or max(map(abs, (start.latitude_rad, end.latitude_rad))) > 1.5 or not 1e5 < length_m < 1.9e7:
        return
    cross_track_rad = math.asin(math.sin(angle_rad) * math.sin(bearing_rad - course_rad))
    assert position.cross_track_m == pytest.approx(cross_track_rad * 6371008.8, abs=1.0)
    along_m = 6371008.8 * math.atan2(math.sin(angle_rad) * math.cos(bearing_rad - course_rad), math.cos(angle_rad))
    if abs(cross_track_rad) < 1.5:
        difference_rad = (position.remaining_m + along_m - length_m) / 6371008.8
        assert math.remainder(difference_rad, 2 * math.pi) == pytest.approx(0.0, abs=1e-5)


def test_course_of_a_track_is_that_at_the_nearest_point_of_the_line():
    start, end = Place(0.7, 0.2), Place(0.9, 1.1)
    assert track(start, end, start).course_rad == pytest.approx(start.distance_and_bearing(end)[1])
    for longitude_rad in (math.pi / 2, math.pi):
        ends = (Place(0.0, longitude_rad - 0.1), Place(0.0, longitude_rad + 0.1))
        assert track(*ends, Place(0.0, longitude_rad)).course_rad == pytest.approx(math.pi / 2)
    arrival_rad = end.distance_and_bearing(start)[1] - math.pi
    assert track(start, end, end).course_rad == pytest.approx(arrival_rad)


def test_offsets_cross_the_date_line():
    west, east = Place(0.0, math.pi - 1e-6), Place(0.0, -math.pi + 1e-6)
    assert west.local_offset_m(east) == pytest.approx((0.0, 12.742), abs=0.01)
    assert west.nearby_offset_m(east) == pytest.approx((0.0, 12.742), abs=0.01)
