import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.model.crab import against_current, heading_for_course, speed_made_good

angles, currents = st.floats(0.0, 6.28), st.floats(-0.6, 0.6)


@given(angles, currents, currents)
def test_the_heading_gives_the_course_in_any_weaker_current(course_rad, north_m_s, east_m_s):
    speed_m_s = 1.0
    heading_rad = heading_for_course(course_rad, speed_m_s, north_m_s, east_m_s)
    v_north = speed_m_s * math.cos(heading_rad) + north_m_s
    v_east = speed_m_s * math.sin(heading_rad) + east_m_s
    assert math.cos(math.atan2(v_east, v_north) - course_rad) == pytest.approx(1.0, abs=1e-9)
    assert math.hypot(v_north, v_east) == pytest.approx(speed_made_good(course_rad, speed_m_s, north_m_s, east_m_s))


def test_headings_in_a_current_as_fast_as_the_boat_and_faster():
    assert math.degrees(heading_for_course(0.0, 0.4, 0.0, 0.399)) == pytest.approx(360.0 - 71.8, abs=0.1)
    # Current to the east at twice the speed, course north: as far north as possible for each metre east.
    assert math.degrees(heading_for_course(0.0, 0.4, 0.0, 0.8)) == pytest.approx(330.0)
    assert speed_made_good(0.0, 0.4, 0.0, 0.8) <= 0.0
    assert speed_made_good(math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(1.2)
    assert speed_made_good(-math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(-0.4)
    assert against_current(0.0, 0.8) == pytest.approx(1.5 * math.pi)
    assert heading_for_course(1.0, 0.0, 0.5, 0.5) == 1.0


@given(angles, st.floats(1.4, 3.0), angles)
def test_in_a_stronger_current_the_heading_is_best_for_the_course(course_rad, current_m_s, toward_rad):
    north_m_s, east_m_s = current_m_s * math.cos(toward_rad), current_m_s * math.sin(toward_rad)

    def over_ground(heading_rad):
        return math.cos(heading_rad) + north_m_s, math.sin(heading_rad) + east_m_s

    def made_good(heading_rad):
        north, east = over_ground(heading_rad)
        return north * math.cos(course_rad) + east * math.sin(course_rad)

    def nearness(heading_rad):
        return made_good(heading_rad) / math.hypot(*over_ground(heading_rad))

    steered_rad = heading_for_course(course_rad, 1.0, north_m_s, east_m_s)
    headings = [math.radians(degrees) for degrees in range(0, 360, 2)]
    most_m_s, nearest = max(map(made_good, headings)), max(map(nearness, headings))
    if most_m_s > 0.0:  # some heading gains on the course
        assert made_good(steered_rad) > -1e-9
        assert nearness(steered_rad) > nearest - 0.12
    else:
        assert made_good(steered_rad) >= most_m_s - 1e-3


@given(angles, angles)
def test_the_heading_changes_little_where_the_current_exceeds_the_speed(course_rad, toward_rad):
    """Within the scatter of the estimate; the largest change of the crab angle is 8.3 deg."""
    weaker_rad, stronger_rad = (
        heading_for_course(course_rad, 1.0, ratio * math.cos(toward_rad), ratio * math.sin(toward_rad))
        for ratio in (0.97, 1.03)
    )
    assert abs(math.remainder(stronger_rad - weaker_rad, 2.0 * math.pi)) < math.radians(8.4)
