import math

import pytest

from firmware_py.estimate.drift import DriftState, update
from firmware_py.records import FixType, PositionSample


def fix(t_s, course_rad, speed_m_s=0.5):
    return PositionSample(
        t_s, FixType.FIX_3D, 0.5, 0.5, speed_over_ground_m_s=speed_m_s, course_over_ground_rad=course_rad
    )


def test_it_settles_on_the_difference_across_north():
    state = DriftState()
    for second in range(200):
        state = update(state, fix(float(second), 0.1), 2 * math.pi - 0.1, 0.0)
    assert state.drift_rad == pytest.approx(0.2, abs=1e-4)


def test_without_way_on_or_heading_nothing_changes():
    state = update(DriftState(), fix(0.0, 0.3), 0.0, 0.0)
    assert update(state, fix(1.0, 3.0, speed_m_s=0.05), 0.0, 0.0) == state
    assert update(state, fix(1.0, 3.0), None, 0.0) == state
    assert update(state, fix(1.0, math.nan), 0.0, 0.0) == state
    assert update(state, fix(1.0, 3.0, speed_m_s=math.nan), 0.0, 0.0) == state
    assert update(state, PositionSample(1.0, FixType.FIX_2D, 0.5, 0.5), 0.0, 0.0) == state


def test_one_odd_course_moves_it_little():
    state = update(DriftState(), fix(0.0, 0.0), 0.0, 0.0)
    assert abs(update(state, fix(1.0, math.pi - 0.01), 0.0, 0.0).drift_rad) < 0.2


def test_a_turn_teaches_nothing_and_its_time_is_not_made_up_for():
    state = update(DriftState(), fix(0.0, 0.0), 0.0, 0.0)
    for second in range(1, 30):
        state = update(state, fix(float(second), 1.0), 0.0, -0.05)
    assert state.drift_rad == 0.0
    assert abs(update(state, fix(30.0, 1.0), 0.0, 0.0).drift_rad) < 0.06
