import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.geodesy import Place, track

latitudes, longitudes = st.floats(-math.pi / 2, math.pi / 2), st.floats(-math.pi, math.pi)
places = st.builds(Place, latitudes, longitudes)
HERE = Place(0.6, 2.0)


def test_along_the_equator_north_is_to_port():
    on = track(Place(0.0, 0.0), Place(0.0, 0.001), Place(0.0001, 0.0004))
    assert on.cross_track_m == pytest.approx(-637.1, abs=0.1)
    assert on.remaining_m == pytest.approx(0.0006 * 6371008.8, rel=1e-6)
    assert on.course_rad == pytest.approx(math.pi / 2)


def test_beyond_the_end_the_rest_is_negative():
    assert track(HERE, HERE.moved(100.0, 0.0), HERE.moved(130.0, 5.0)).remaining_m == pytest.approx(-30.0, abs=0.01)


def test_a_line_of_a_metre_has_a_course_and_one_of_nothing_has_none():
    assert track(HERE, HERE.moved(1.0, 0.0), HERE).course_rad % (2 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert track(HERE, HERE, HERE.moved(5.0, 5.0)) is None


def test_across_the_date_line_and_over_the_pole_lines_are_short():
    on = track(Place(0.1, math.pi - 1e-5), Place(0.1, -math.pi + 1e-5), Place(0.1, math.pi))
    assert abs(on.cross_track_m) < 1e-2
    assert on.remaining_m == pytest.approx(1e-5 * math.cos(0.1) * 6371008.8, rel=1e-3)
    over = track(Place(1.57, 0.0), Place(1.57, math.pi), Place(math.pi / 2, 0.3))
    assert abs(over.cross_track_m) < 1e-3


@given(places, st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0))
def test_moving_and_measuring_agree(place, north_m, east_m):
    if abs(place.latitude_rad) > 1.4:
        return
    found = place.offset_m(place.moved(north_m, east_m))
    assert found == pytest.approx((north_m, east_m), abs=4.0)


@given(places, places, places)
def test_whatever_the_places_the_numbers_are_numbers(start, end, here):
    on = track(start, end, here)
    if on is not None:
        assert all(map(math.isfinite, (on.cross_track_m, on.remaining_m, on.course_rad)))
        assert abs(on.cross_track_m) <= math.pi / 2 * 6371008.8 + 1.0
        assert 0.0 <= on.course_rad < 2 * math.pi
