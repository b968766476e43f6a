import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.model.crab import against_current, heading_for_course, speed_made_good

angles, currents = st.floats(0.0, 6.28), st.floats(-0.6, 0.6)


@given(angles, currents, currents)
def test_the_heading_makes_the_course_good_in_any_weaker_current(course_rad, north_m_s, east_m_s):
    speed_m_s = 1.0
    heading_rad = heading_for_course(course_rad, speed_m_s, north_m_s, east_m_s)
    v_north = speed_m_s * math.cos(heading_rad) + north_m_s
    v_east = speed_m_s * math.sin(heading_rad) + east_m_s
    assert math.cos(math.atan2(v_east, v_north) - course_rad) == pytest.approx(1.0, abs=1e-9)
    assert math.hypot(v_north, v_east) == pytest.approx(speed_made_good(course_rad, speed_m_s, north_m_s, east_m_s))


def test_too_strong_a_current_is_met_mostly_head_on():
    # Setting east at twice her speed, and she is to go north: she points to the west of north-west.
    assert math.degrees(heading_for_course(0.0, 0.4, 0.0, 0.8)) == pytest.approx(360.0 - 71.8, abs=0.1)
    assert speed_made_good(0.0, 0.4, 0.0, 0.8) <= 0.0
    assert speed_made_good(math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(1.2)
    assert speed_made_good(-math.pi / 2, 0.4, 0.0, 0.8) == pytest.approx(-0.4)
    assert against_current(0.0, 0.8) == pytest.approx(1.5 * math.pi)
    assert heading_for_course(1.0, 0.0, 0.5, 0.5) == 1.0
