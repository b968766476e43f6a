import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate import water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState, leap_m, off_m, predict, update

DEAD_RECKONING = DeadReckoning(water_results.DeadReckoning(0.0, 0.0, 0.5, 0.0, (0.0,) * 10), 0.0)


def fix(t_s, north_m=0.0, kind=FixType.FIX_3D):
    return PositionSample(t_s, kind, 0.6 + north_m / EARTH_RADIUS_M, 2.0)


def north_m(state):
    return (state.latitude_rad - 0.6) * EARTH_RADIUS_M


def told(*fixes, jump_s=60.0):
    state, believed = PositionState(), []
    for sample in fixes:
        state, good = update(predict(state, sample.t_s, (0.0, 0.0)), sample, jump_s)
        believed.append(good)
    return state, believed


def test_the_first_fix_is_taken_whole_and_others_pull_gently():
    state, _ = told(fix(0.0))
    assert north_m(state) == pytest.approx(0.0, abs=1e-6)
    state, _ = told(fix(0.0), fix(1.0, 10.0))
    assert north_m(state) == pytest.approx(10.0 * (1.0 - math.exp(-0.1)), abs=1e-6)


def test_between_fixes_it_goes_with_her_and_begins_anew_at_a_fix_after_a_minute_without():
    state, _ = told(fix(0.0))
    assert north_m(predict(state, 10.0, (0.5, 0.0))) == pytest.approx(5.0, abs=1e-6)
    far = predict(state, 7200.0, (0.5, 0.0))
    assert north_m(far) == pytest.approx(3600.0, abs=1e-3)
    assert off_m(far, fix(7200.0, 3000.0)) == pytest.approx(600.0, abs=1e-3)
    again, _ = update(far, fix(7200.0, 3000.0), 60.0)
    assert north_m(again) == pytest.approx(3000.0, abs=1e-3)


@pytest.mark.parametrize("silent_s", [30.0, 7200.0])
def test_a_fix_ends_the_reckoning(silent_s):
    state, _ = told(fix(0.0))
    state = predict(replace(state, dead_reckoning=DEAD_RECKONING), silent_s, (0.0, 0.0))
    assert state.dead_reckoning is DEAD_RECKONING
    assert update(state, fix(silent_s), 60.0)[0].dead_reckoning is None


def test_a_jump_is_held_back_and_forgotten_when_it_goes():
    state, believed = told(*(fix(t) for t in range(5)), *(fix(t, 10_000.0) for t in range(5, 20)), fix(20.0, 1.0))
    assert believed == [True] * 5 + [False] * 15 + [True]
    assert abs(north_m(state)) < 2.0
    assert state.witnesses == 0


def test_a_jump_that_lasts_is_believed_in_the_end():
    state, believed = told(fix(0.0), *(fix(t, 10_000.0) for t in range(1, 80)))
    assert believed.index(True, 1) == pytest.approx(61, abs=2)
    assert north_m(state) == pytest.approx(10_000.0, abs=1.0)


def test_positions_all_over_the_place_are_never_believed():
    _, believed = told(fix(0.0), *(fix(t, 10_000.0 * (t % 2 + 1) * (t % 3 + 1)) for t in range(1, 200)))
    assert not any(believed[1:])


def test_after_a_long_silence_far_off_is_possible():
    _, believed = told(fix(0.0), fix(5000.0, 10_000.0))
    assert believed == [True, True]


def test_no_fix_and_no_number_are_nothing():
    state = told(fix(0.0))[0]
    for sample in (fix(1.0, kind=FixType.NONE), PositionSample(1.0, FixType.FIX_3D, math.nan, 2.0), fix(1.0, math.nan)):
        assert update(state, sample, 60.0) == (state, False)
    for latitude_rad, longitude_rad in ((9.0, 2.0), (0.0, 0.0), (-0.0, 0.0), (math.pi / 2, 2.0)):
        sample = PositionSample(1.0, FixType.FIX_3D, latitude_rad, longitude_rad)
        assert update(state, sample, 60.0) == (state, False)
        assert update(PositionState(), sample, 60.0) == (PositionState(), False)


samples = st.builds(
    PositionSample, st.floats(), st.sampled_from(FixType), st.none() | st.floats(), st.none() | st.floats()
)


@given(st.lists(samples, max_size=20))
def test_whatever_comes_the_place_is_on_earth(found):
    state, _ = told(*found)
    assert abs(state.latitude_rad) <= math.pi / 2
    assert abs(state.longitude_rad) <= math.pi + 1e-9


def test_a_jump_is_told_when_it_is_believed_and_not_when_it_was_none():
    held, _ = told(fix(0.0), *(fix(t, 200.0) for t in range(1, 30)))
    assert leap_m(held, fix(45.0, 200.0)) == pytest.approx(200.0, abs=1.0)
    assert leap_m(held, fix(30.0, 40.0)) is None  # back where she was
    sound, _ = told(*(fix(t) for t in range(5)))
    assert leap_m(sound, fix(40.0, 150.0)) is None  # no jump: she may have sailed there in the dark
    assert leap_m(PositionState(), fix(0.0)) is None
