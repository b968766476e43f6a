"""Places that do not move as the velocities of the same receiver say."""

import math

import pytest

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate.place_and_velocity import HANGS_M, AgreementState, hangs, update

TOLD = "Position moves 0.8 m/s otherwise than its velocity says: is the receiver deceived?"


def voyage(seconds, moves_m_s=(0.4, 0.0), says_m_s=(0.4, 0.0), every_s=1.0, mute=()):
    """Told events of a voyage: (t_s, text)."""
    state, told = AgreementState(), []
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
        state, events = update(state, fix, afloat=True)
        told += [(t_s, event.text) for event in events]
    return told


@pytest.mark.parametrize("moves_m_s", [(1.2, 0.0), (-0.4, 0.0), (0.4, 0.8)])
def test_a_place_that_walks_off_is_told_after_four_minutes_and_again_after_ten(moves_m_s):
    assert voyage(1000.0, moves_m_s) == [(240.0, TOLD), (840.0, TOLD)]
    assert voyage(1000.0, moves_m_s, every_s=5.0) == [(240.0, TOLD), (840.0, TOLD)]


def test_places_that_go_with_their_velocities_are_not_told():
    assert voyage(3000.0) == []
    assert voyage(3000.0, (0.8, 0.0)) == []  # within what receivers differ by


def test_fixes_that_come_too_seldom_or_without_a_course_say_nothing():
    assert voyage(3000.0, (1.2, 0.0), every_s=6.0) == []
    assert voyage(3000.0, (1.2, 0.0), mute=range(0, 3000, 100)) == []


@pytest.mark.parametrize("jumps_s", [(300,), (300, 600, 900)])
def test_odd_windows_that_do_not_follow_each_other_are_jumps_and_not_told(jumps_s):
    state, told = AgreementState(), []
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
        state, events = update(state, fix, afloat=True)
        told += events
    assert told == []


STILL = "Position has not moved for 5 min, to the last digit: does the receiver hold it?"


def held(places, *, afloat=True):
    """Told events of fixes each second, without a course, at latitudes in metres."""
    state, told = AgreementState(), []
    for number, north_m in enumerate(places):
        fix = PositionSample(float(number), FixType.FIX_3D, north_m / EARTH_RADIUS_M, 2.0, speed_over_ground_m_s=0.0)
        state, events = update(state, fix, afloat=afloat)
        told += [(number, event.text) for event in events]
    return told


def test_a_place_that_is_held_to_the_last_digit_is_told_once_until_it_moves():
    assert held([5.0] * 2000) == [(300, STILL)]
    assert held([5.0] * 400 + [5.1] * 400) == [(300, STILL), (700, STILL)]
    assert held([number // 299 * 0.1 for number in range(2000)]) == []


def test_a_boat_that_is_not_armed_may_stand_still():
    assert held([5.0] * 2000, afloat=False) == []


def standing(seconds, speed_m_s, course_rad=1.0, turns=False):
    """Whether the last of fixes each second at one place hangs, and what was told."""
    state, told = AgreementState(), []
    for number in range(seconds):
        way_rad = course_rad + math.pi * (number // 10 % 2) if turns else course_rad
        fix = PositionSample(
            float(number), FixType.FIX_3D, 0.6, 2.0, speed_over_ground_m_s=speed_m_s, course_over_ground_rad=way_rad
        )
        state, events = update(state, fix, afloat=True)
        told += [event.text for event in events if "not moved" in event.text]
    return hangs(state, fix), told, state


def test_a_place_that_stands_while_its_velocity_leads_on_hangs_and_is_told_at_once():
    seconds = math.ceil(HANGS_M / 0.4)
    assert standing(seconds, 0.4)[:2] == (False, [])
    assert standing(seconds + 2, 0.4)[:2] == (True, [STILL.replace("5", "1")])
    state = standing(seconds + 2, 0.4)[2]
    assert not hangs(state, PositionSample(100.0, FixType.FIX_3D, 0.6 + 1e-9, 2.0))


@pytest.mark.parametrize(("speed_m_s", "turns"), [(0.0, False), (0.4, True)], ids=["slow", "to and fro in waves"])
def test_a_place_that_is_held_of_one_who_stays_does_not_hang(speed_m_s, turns):
    assert standing(299, speed_m_s, turns=turns)[:2] == (False, [])
