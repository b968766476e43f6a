"""Positions that do not move according to the velocities of the same receiver."""

import math

import pytest

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate.position_consistency import PositionConsistency, is_stuck, update

STUCK_DISTANCE_M = 30.0

DISAGREEMENT = "GPS position/velocity differ by 0.8 m/s: spoofing?"
CONSTANT = "GPS position unchanged for 5 min: static hold?"


def fix(t_s, north_m, speed_m_s, course_rad=None, east_m=0.0):
    place = (north_m / EARTH_RADIUS_M, 2.0 + east_m / EARTH_RADIUS_M)
    return PositionSample(
        t_s, FixType.FIX_3D, *place, speed_over_ground_m_s=speed_m_s, course_over_ground_rad=course_rad
    )


def update_all(fixes, *, is_armed=True):
    """Return the state after the fixes, and the reports as (t_s, text)."""
    state, reports = PositionConsistency(), []
    for sample in fixes:
        state, events = update(state, sample, is_armed=is_armed)
        reports += [(sample.t_s, event.text) for event in events]
    return state, reports


def voyage_reports(seconds, moved_m_s=(0.4, 0.0), interval_s=1.0, without_course=()):
    """Return the reports of a voyage whose receiver states a velocity of 0.4 m/s north."""
    return update_all(
        fix(t_s, moved_m_s[0] * t_s, 0.4, None if number in without_course else 0.0, moved_m_s[1] * t_s)
        for number, t_s in enumerate(interval_s * number for number in range(int(seconds / interval_s)))
    )[1]


@pytest.mark.parametrize("interval_s", [1.0, 5.0])
@pytest.mark.parametrize("moved_m_s", [(1.2, 0.0), (-0.4, 0.0), (0.4, 0.8), (0.91, 0.0)])
def test_position_that_drifts_from_its_velocity_is_reported_after_4_min_and_10_min_later(moved_m_s, interval_s):
    reports = voyage_reports(1000.0, moved_m_s, interval_s)
    text = DISAGREEMENT.replace("0.8", f"{math.dist(moved_m_s, (0.4, 0.0)):.1f}")
    assert reports == [(240.0, text), (840.0, text)]


@pytest.mark.parametrize(
    ("moved_m_s", "interval_s", "without_course"),
    [
        pytest.param((0.4, 0.0), 1.0, (), id="equal"),
        pytest.param((0.89, 0.0), 1.0, (), id="within the errors of receivers"),
        pytest.param((1.2, 0.0), 5.1, (), id="rare fixes"),
        pytest.param((1.2, 0.0), 1.0, range(0, 3000, 100), id="fixes without a course"),
    ],
)
def test_voyage_is_not_reported(moved_m_s, interval_s, without_course):
    assert voyage_reports(3000.0, moved_m_s, interval_s, without_course) == []


@pytest.mark.parametrize("jumps_s", [(300,), (300, 600, 900)])
def test_single_inconsistent_windows_are_not_reported(jumps_s):
    fixes = (fix(float(t), 0.4 * t + 100.0 * sum(t > jump_s for jump_s in jumps_s), 0.4, 0.0) for t in range(1200))
    assert update_all(fixes)[1] == []


@pytest.mark.parametrize(
    ("north_m", "is_armed", "reports"),
    [
        ([5.0] * 2000, True, [(300, CONSTANT)]),
        ([5.0] * 400 + [5.1] * 400, True, [(300, CONSTANT), (700, CONSTANT)]),
        ([number // 299 * 0.1 for number in range(2000)], True, []),
        ([5.0] * 2000, False, []),
    ],
    ids=["constant", "two positions", "changes every 299 s", "disarmed"],
)
def test_constant_position_is_reported_once_until_it_changes(north_m, is_armed, reports):
    fixes = (fix(float(t), position_m, 0.0) for t, position_m in enumerate(north_m))
    assert update_all(fixes, is_armed=is_armed)[1] == reports


def constant_position(seconds, speed_m_s, *, is_turning=False):
    """Return whether the last of the fixes at one position is stuck, the texts and the state."""
    fixes = [fix(float(t), 5.0, speed_m_s, 1.0 + math.pi * (is_turning and t // 10 % 2)) for t in range(seconds)]
    state, reports = update_all(fixes)
    return is_stuck(state, fixes[-1]), [text for _, text in reports if "unchanged" in text], state


def test_constant_position_with_a_velocity_is_stuck_and_reported_at_once():
    seconds = math.ceil(STUCK_DISTANCE_M / 0.4)
    assert constant_position(seconds, 0.4)[:2] == (False, [])
    stuck, texts, state = constant_position(seconds + 2, 0.4)
    assert (stuck, texts) == (True, [CONSTANT.replace("5", "1")])
    assert not is_stuck(state, fix(100.0, 5.01, 0.4))


@pytest.mark.parametrize(("speed_m_s", "is_turning"), [(0.0, False), (0.4, True)], ids=["slow", "to and fro in waves"])
def test_constant_position_of_a_boat_that_does_not_move_away_is_not_stuck(speed_m_s, is_turning):
    assert constant_position(299, speed_m_s, is_turning=is_turning)[:2] == (False, [])


def test_way_at_a_constant_position_is_that_of_fixes_with_a_velocity_and_at_most_5_s_each():
    fixes = [
        fix(t_s, 5.0, speed, 0.5) for t_s, speed in ((0.0, 0.4), (2.0, 0.4), (22.0, 0.4), (21.0, 0.4), (23.0, None))
    ]
    state, _ = update_all([*fixes, fix(24.0, 5.0, 0.4, 0.5), fix(25.0, 5.0, 0.2, 0.5)])
    way_m = (2.0 + 5.0) * 0.4 + 1.0 * 0.2
    assert (state.still_north_m, state.still_east_m) == pytest.approx((way_m * math.cos(0.5), way_m * math.sin(0.5)))


@pytest.mark.parametrize(("way_m", "stuck"), [(30.0, False), (30.1, True)])
def test_position_is_stuck_after_a_way_of_more_than_30_m(way_m, stuck):
    sample = fix(0.0, 5.0, 0.4)
    assert is_stuck(PositionConsistency(still=sample, still_north_m=way_m), sample) is stuck
    assert is_stuck(PositionConsistency(still=sample, still_east_m=-way_m), sample) is stuck


def test_velocity_is_integrated_by_the_mean_of_two_fixes():
    """A velocity that alternates between 0 and 1 m/s, with a position that moves at 0.5 m/s."""
    fixes = [fix(t_s, 0.5 * t_s, t_s % 2.0, 0.0) for t_s in map(float, range(1000))]
    state, reports = update_all(fixes)
    assert reports == []
    assert state.north_m == pytest.approx(0.5 * (999.0 - state.begun.t_s))
    assert state.begun.t_s == 960.0
