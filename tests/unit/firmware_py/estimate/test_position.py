import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate import position, water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState, accepted_jump_m, predict, update

DEAD_RECKONING = DeadReckoning(water_results.DeadReckoning(0.0, 0.0, 0.5, 0.0, (0.0,) * 10), 0.0)


def fix(t_s, north_m=0.0, kind=FixType.FIX_3D):
    return PositionSample(t_s, kind, 0.6 + north_m / EARTH_RADIUS_M, 2.0)


def north_m(state):
    return (state.latitude_rad - 0.6) * EARTH_RADIUS_M


def after_fixes(*fixes, jump_s=60.0):
    """Return the state after fixes, and whether each was accepted."""
    state, accepted = PositionState(), []
    for sample in fixes:
        if math.isfinite(sample.t_s):
            state = predict(state, sample.t_s, (0.0, 0.0))
        state, is_accepted = update(state, sample, jump_s)
        accepted.append(is_accepted)
    return state, accepted


def test_first_fix_sets_the_position_and_later_fixes_are_smoothed():
    state, _ = after_fixes(fix(0.0))
    assert north_m(state) == pytest.approx(0.0, abs=1e-6)
    state, _ = after_fixes(fix(0.0), fix(1.0, 10.0))
    assert north_m(state) == pytest.approx(10.0 * (1.0 - math.exp(-0.1)), abs=1e-6)


@pytest.mark.parametrize("gap_s", [30.0, 7200.0])
def test_fix_ends_dead_reckoning(gap_s):
    state, _ = after_fixes(fix(0.0))
    state = predict(replace(state, dead_reckoning=DEAD_RECKONING), gap_s, (0.0, 0.0))
    assert state.dead_reckoning is DEAD_RECKONING
    assert update(state, fix(gap_s), 60.0)[0].dead_reckoning is None


def test_short_jump_is_rejected_and_ignored_afterwards():
    state, accepted = after_fixes(
        *(fix(t) for t in range(5)), *(fix(t, 10_000.0) for t in range(5, 20)), fix(20.0, 1.0)
    )
    assert accepted == [True] * 5 + [False] * 15 + [True]
    assert abs(north_m(state)) < 2.0
    assert state.witnesses == 0


def test_scattered_positions_are_never_accepted():
    _, accepted = after_fixes(fix(0.0), *(fix(t, 10_000.0 * (t % 2 + 1) * (t % 3 + 1)) for t in range(1, 200)))
    assert not any(accepted[1:])


INVALID_POSITIONS = ((math.nan, 2.0), (9.0, 2.0), (0.0, 0.0), (-0.0, 0.0), (math.pi / 2, 2.0))


@pytest.mark.parametrize("state", [PositionState(), after_fixes(fix(0.0))[0]], ids=["first fix", "later fix"])
def test_invalid_fixes_are_ignored(state):
    for sample in (fix(1.0, kind=FixType.NONE), *(PositionSample(1.0, FixType.FIX_3D, *p) for p in INVALID_POSITIONS)):
        assert update(state, sample, 60.0) == (state, False), sample


samples = st.builds(
    PositionSample, st.floats(), st.sampled_from(FixType), st.none() | st.floats(), st.none() | st.floats()
)


@given(st.lists(samples, max_size=20))
def test_position_is_always_valid(fixes):
    state, _ = after_fixes(*fixes)
    assert abs(state.latitude_rad) <= math.pi / 2
    assert abs(state.longitude_rad) <= math.pi + 1e-9


@pytest.mark.parametrize(
    ("gap_s", "off_m", "is_accepted"),
    [
        (0.0, 49.9, True),
        (0.0, 50.1, False),
        (10.0, 89.9, True),
        (10.0, 90.1, False),
        (-10.0, 49.9, True),
        (-10.0, 50.1, False),
    ],
)
@pytest.mark.parametrize("axis", ["latitude", "longitude"])
def test_fix_farther_than_50_m_and_4_m_s_is_a_jump(gap_s, off_m, is_accepted, axis):
    first = PositionSample(100.0, FixType.FIX_3D, 0.6, -2.0)
    changes = (off_m / EARTH_RADIUS_M, 0.0) if axis == "latitude" else (0.0, off_m / EARTH_RADIUS_M / math.cos(0.6))
    sample = PositionSample(100.0 + gap_s, FixType.FIX_3D, 0.6 + changes[0], -2.0 + changes[1])
    state, _ = after_fixes(first)
    jumped, accepted = update(state, sample, 60.0)
    assert accepted is is_accepted
    if not accepted:
        assert jumped == replace(state, suspect=sample, witnesses=1)


@pytest.mark.parametrize(
    ("jump_s", "times_s", "accepted_at_s"),
    [(0.0, range(1, 9), 4.0), (5.0, range(1, 9), 6.0), (5.1, range(1, 9), 7.0), (0.0, (1, 20, 30, 40), 40.0)],
)
def test_jump_needs_the_time_and_three_more_fixes_that_agree(jump_s, times_s, accepted_at_s):
    fixes = [fix(float(t_s), 10_000.0) for t_s in times_s]
    state, accepted = after_fixes(fix(0.0), *fixes, jump_s=jump_s)
    (first,) = [sample for sample, is_accepted in zip(fixes, accepted[1:], strict=True) if is_accepted][:1]
    assert first.t_s == accepted_at_s
    assert state.begun == first


@pytest.mark.parametrize(("gap_s", "gain"), [(0.0, 0.0), (60.0, 1.0 - math.exp(-6.0)), (60.1, 1.0), (-0.1, 1.0)])
def test_position_is_smoothed_over_10_s_and_restarts_after_a_gap_of_a_minute(gap_s, gain):
    first, sample = fix(100.0), fix(100.0 + gap_s, 20.0)
    state = replace(after_fixes(first)[0], t_s=130.0, suspect=sample, witnesses=2)
    updated, _ = update(state, sample, 60.0)
    assert north_m(updated) == pytest.approx(20.0 * gain, abs=1e-6)
    t_s = 160.1 if gap_s > 60.0 else 130.0
    assert updated == PositionState(t_s, updated.latitude_rad, updated.longitude_rad, sample, begun=first)


@pytest.mark.parametrize(
    ("first", "current", "is_wrong"),
    [
        (fix(0.0), fix(1800.0), True),
        (fix(0.0), fix(1800.1), False),
        (None, fix(10.0), False),
        (fix(0.0), None, False),
    ],
)
def test_jump_within_half_an_hour_proves_the_first_fix_wrong(first, current, is_wrong):
    states = PositionState(begun=first), PositionState(begun=current)
    assert position.find_wrong_first_fix(*states) == (first if is_wrong else None)
    assert position.find_wrong_first_fix(states[0], states[0]) is None


@pytest.mark.parametrize(("off_m", "distance_m"), [(49.9, None), (50.1, 50.1)])
def test_jump_is_farther_than_50_m_from_the_estimate(off_m, distance_m):
    state = replace(after_fixes(fix(0.0))[0], suspect=fix(1.0))
    expected = None if distance_m is None else pytest.approx(distance_m)
    assert accepted_jump_m(state, fix(10.0, off_m)) == expected
    assert accepted_jump_m(replace(state, fix=None), fix(10.0, off_m)) is None


def test_prediction_needs_a_position_and_moves_in_both_directions():
    state = after_fixes(fix(10.0))[0]
    moved = predict(state, 20.0, (0.5, -0.3))
    place = position.Place(0.6, 2.0).at_offset(5.0, -3.0)
    assert moved == replace(state, t_s=20.0, latitude_rad=place.latitude_rad, longitude_rad=place.longitude_rad)
    for unchanged, now_s in ((state, 10.0), (state, 9.0), (PositionState(), 5.0)):
        assert predict(unchanged, now_s, (0.5, 0.5)) is unchanged
    state = PositionState(dead_reckoning=DEAD_RECKONING, latitude_rad=0.6)
    assert north_m(predict(state, 10.0, (0.5, 0.0))) == pytest.approx(5.0)


def test_time_since_the_fix_and_utc():
    state = predict(after_fixes(replace(fix(10.0), utc_s=1000.0))[0], 25.0, (0.0, 0.0))
    assert (position.time_since_fix_s(state), position.utc_s(state, 30.0)) == (15.0, 1020.0)
    begun = replace(DEAD_RECKONING, begun_s=5.0)
    assert position.time_since_fix_s(PositionState(t_s=25.0, dead_reckoning=begun)) == 20.0
    assert position.time_since_fix_s(PositionState(t_s=25.0)) == 0.0
    for without in (PositionState(), after_fixes(fix(10.0))[0]):
        assert position.utc_s(without, 30.0) is None


@pytest.mark.parametrize("changes", [{"latitude_rad": None}, {"longitude_rad": None}, {"t_s": math.inf}])
def test_sample_without_a_coordinate_or_time_is_no_position(changes):
    assert position.has_valid_position(fix(1.0))
    assert not position.has_valid_position(replace(fix(1.0), **changes))


@pytest.mark.parametrize(("off_m", "is_witness"), [(89.9, True), (90.1, False)])
def test_fix_that_the_boat_can_reach_from_the_suspect_confirms_the_jump(off_m, is_witness):
    suspect, sample = fix(100.0, 10_000.0), fix(110.0, 10_000.0 + off_m)
    state = replace(after_fixes(fix(0.0))[0], suspect=suspect, witnesses=1)
    expected = replace(state, witnesses=2) if is_witness else replace(state, suspect=sample, witnesses=1)
    assert update(state, sample, 60.0) == (expected, False)
