"""Places that do not move as the velocities of the same receiver say."""

import math

import pytest

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate.position_consistency import STUCK_DISTANCE_M, PositionConsistency, is_stuck, update

DISAGREEMENT = "GPS position/velocity differ by 0.8 m/s: spoofing?"


def voyage(seconds, moves_m_s=(0.4, 0.0), says_m_s=(0.4, 0.0), every_s=1.0, mute=()):
    """Return the events of a voyage as (t_s, text)."""
    state, events_so_far = PositionConsistency(), []
    for number in range(int(seconds / every_s)):
        t_s = number * every_s
        speed_m_s, course_rad = math.hypot(*says_m_s), math.atan2(says_m_s[1], says_m_s[0]) % math.tau
        fix = PositionSample(
            t_s,
            FixType.FIX_3D,
            moves_m_s[0] * t_s / EARTH_RADIUS_M,
            2.0 + moves_m_s[1] * t_s / EARTH_RADIUS_M,
            speed_over_ground_m_s=speed_m_s,
            course_over_ground_rad=None if number in mute else course_rad,
        )
        state, events = update(state, fix, armed=True)
        events_so_far += [(t_s, event.text) for event in events]
    return events_so_far


@pytest.mark.parametrize("moves_m_s", [(1.2, 0.0), (-0.4, 0.0), (0.4, 0.8)])
def test_a_position_that_drifts_against_its_velocity_is_reported_after_4_min_and_again_after_10(moves_m_s):
    assert voyage(1000.0, moves_m_s) == [(240.0, DISAGREEMENT), (840.0, DISAGREEMENT)]
    assert voyage(1000.0, moves_m_s, every_s=5.0) == [(240.0, DISAGREEMENT), (840.0, DISAGREEMENT)]


def test_positions_that_agree_with_their_velocities_are_not_reported():
    assert voyage(3000.0) == []
    assert voyage(3000.0, (0.8, 0.0)) == []  # within the errors of receivers


def test_rare_fixes_and_fixes_without_a_course_are_not_reported():
    assert voyage(3000.0, (1.2, 0.0), every_s=6.0) == []
    assert voyage(3000.0, (1.2, 0.0), mute=range(0, 3000, 100)) == []


@pytest.mark.parametrize("jumps_s", [(300,), (300, 600, 900)])
def test_single_odd_windows_are_not_reported(jumps_s):
    state, events_so_far = PositionConsistency(), []
    for number in range(1200):
        north_m = 0.4 * number + 100.0 * sum(number > jump_s for jump_s in jumps_s)
        fix = PositionSample(
            float(number),
            FixType.FIX_3D,
            north_m / EARTH_RADIUS_M,
            2.0,
            speed_over_ground_m_s=0.4,
            course_over_ground_rad=0.0,
        )
        state, events = update(state, fix, armed=True)
        events_so_far += events
    assert events_so_far == []


STILL = "GPS position unchanged for 5 min: static hold?"


def held(places, *, armed=True):
    """Return the events of fixes each second, without a course, at latitudes in metres."""
    state, events_so_far = PositionConsistency(), []
    for number, north_m in enumerate(places):
        fix = PositionSample(float(number), FixType.FIX_3D, north_m / EARTH_RADIUS_M, 2.0, speed_over_ground_m_s=0.0)
        state, events = update(state, fix, armed=armed)
        events_so_far += [(number, event.text) for event in events]
    return events_so_far


def test_a_static_hold_is_reported_once_until_the_position_changes():
    assert held([5.0] * 2000) == [(300, STILL)]
    assert held([5.0] * 400 + [5.1] * 400) == [(300, STILL), (700, STILL)]
    assert held([number // 299 * 0.1 for number in range(2000)]) == []


def test_a_disarmed_boat_may_stand_still():
    assert held([5.0] * 2000, armed=False) == []


def standing(seconds, speed_m_s, course_rad=1.0, turns=False):
    """Return whether the last of fixes each second at one position is stuck, the texts and the state."""
    state, events_so_far = PositionConsistency(), []
    for number in range(seconds):
        way_rad = course_rad + math.pi * (number // 10 % 2) if turns else course_rad
        fix = PositionSample(
            float(number), FixType.FIX_3D, 0.6, 2.0, speed_over_ground_m_s=speed_m_s, course_over_ground_rad=way_rad
        )
        state, events = update(state, fix, armed=True)
        events_so_far += [event.text for event in events if "unchanged" in event.text]
    return is_stuck(state, fix), events_so_far, state


def test_a_constant_position_with_a_velocity_is_stuck_and_reported_at_once():
    seconds = math.ceil(STUCK_DISTANCE_M / 0.4)
    assert standing(seconds, 0.4)[:2] == (False, [])
    assert standing(seconds + 2, 0.4)[:2] == (True, [STILL.replace("5", "1")])
    state = standing(seconds + 2, 0.4)[2]
    assert not is_stuck(state, PositionSample(100.0, FixType.FIX_3D, 0.6 + 1e-9, 2.0))


@pytest.mark.parametrize(("speed_m_s", "turns"), [(0.0, False), (0.4, True)], ids=["slow", "to and fro in waves"])
def test_a_static_hold_of_a_boat_that_stays_is_not_stuck(speed_m_s, turns):
    assert standing(299, speed_m_s, turns=turns)[:2] == (False, [])
