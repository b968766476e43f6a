import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.model.crab import against_current, heading_for_course, speed_made_good

angles, currents = st.floats(0.0, 6.28), st.floats(-0.6, 0.6)


@given(angles, currents, currents, st.floats(-0.3, 0.3))
def test_heading_gives_the_course_in_any_slower_current(course_rad, north_m_s, east_m_s, leeway_rad):
    speed_m_s = 1.0
    water_course_rad = heading_for_course(course_rad, speed_m_s, north_m_s, east_m_s, leeway_rad) + leeway_rad
    v_north = speed_m_s * math.cos(water_course_rad) + north_m_s
    v_east = speed_m_s * math.sin(water_course_rad) + east_m_s
    assert math.cos(math.atan2(v_east, v_north) - course_rad) == pytest.approx(1.0, abs=1e-9)
    assert math.hypot(v_north, v_east) == pytest.approx(speed_made_good(course_rad, speed_m_s, north_m_s, east_m_s))


def test_heading_in_a_current_as_fast_as_the_boat_and_faster():
    assert math.degrees(heading_for_course(0.0, 0.4, 0.0, 0.399)) == pytest.approx(360.0 - 71.8, abs=0.1)
    # Current to the east at twice the speed, course north: largest distance north for each metre east.
    assert math.degrees(heading_for_course(0.0, 0.4, 0.0, 0.8)) == pytest.approx(330.0)
    # Current of 1.03 times the speed from 30 deg before the beam: an edge angle of pi / 2 - 2 * 0.03, and 120 deg.
    abeam_rad, current_m_s = math.radians(120.0), 1.03 * 0.4
    limited_rad = math.pi - 2.0 * 0.03 - abeam_rad
    for sign in (1.0, -1.0):
        north_m_s, east_m_s = current_m_s * math.cos(abeam_rad), sign * current_m_s * math.sin(abeam_rad)
        heading_rad = heading_for_course(0.0, 0.4, north_m_s, east_m_s)
        assert math.remainder(heading_rad, 2.0 * math.pi) == pytest.approx(-sign * limited_rad)
    assert speed_made_good(0.0, 0.4, 0.0, 0.8) <= 0.0
    assert speed_made_good(0.0, 0.5, 0.3, 0.5) == 0.0
    assert speed_made_good(math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(1.2)
    assert speed_made_good(-math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(-0.4)
    assert against_current(0.0, 0.8) == pytest.approx(1.5 * math.pi)
    assert heading_for_course(1.0, 0.0, 0.5, 0.5) == 1.0


@given(angles, st.floats(1.4, 3.0), angles)
def test_heading_in_a_faster_current_is_best_for_the_course(course_rad, current_m_s, direction_rad):
    north_m_s, east_m_s = current_m_s * math.cos(direction_rad), current_m_s * math.sin(direction_rad)

    def over_ground(heading_rad):
        return math.cos(heading_rad) + north_m_s, math.sin(heading_rad) + east_m_s

    def speed_along(heading_rad):
        north, east = over_ground(heading_rad)
        return north * math.cos(course_rad) + east * math.sin(course_rad)

    def course_cosine(heading_rad):
        return speed_along(heading_rad) / math.hypot(*over_ground(heading_rad))

    result_rad = heading_for_course(course_rad, 1.0, north_m_s, east_m_s)
    headings = [math.radians(degrees) for degrees in range(0, 360, 2)]
    max_along_m_s, max_cosine = max(map(speed_along, headings)), max(map(course_cosine, headings))
    if max_along_m_s > 0.0:  # at least one heading gives speed along the course
        assert speed_along(result_rad) > -1e-9
        assert course_cosine(result_rad) > max_cosine - 0.12
    else:
        assert speed_along(result_rad) >= max_along_m_s - 1e-3


@given(angles, angles)
def test_heading_changes_little_when_the_current_exceeds_the_speed(course_rad, direction_rad):
    """The speed ratios differ within the accuracy of estimates; the crab angle changes by at most 8.3 deg."""
    slower_rad, faster_rad = (
        heading_for_course(course_rad, 1.0, ratio * math.cos(direction_rad), ratio * math.sin(direction_rad))
        for ratio in (0.97, 1.03)
    )
    assert abs(math.remainder(faster_rad - slower_rad, 2.0 * math.pi)) < math.radians(8.4)


def test_rounding_of_a_course_along_the_current_is_no_error():
    """At these angles the component of the current along its own direction is larger than its speed, by rounding."""
    for current_rad in (0.08, 0.17):
        north_m_s, east_m_s = math.cos(current_rad), math.sin(current_rad)
        for course_rad in (current_rad, current_rad + math.pi):
            heading_rad = heading_for_course(course_rad, 0.5, north_m_s, east_m_s)
            assert math.cos(heading_rad - course_rad) == pytest.approx(1.0)
