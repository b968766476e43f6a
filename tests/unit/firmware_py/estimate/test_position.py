import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import EARTH_RADIUS_M
from firmware_py.common.records import FixType, PositionSample
from firmware_py.estimate import water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning
from firmware_py.estimate.position import PositionState, accepted_jump_m, distance_from_estimate_m, predict, update

DEAD_RECKONING = DeadReckoning(water_results.DeadReckoning(0.0, 0.0, 0.5, 0.0, (0.0,) * 10), 0.0)


def fix(t_s, north_m=0.0, kind=FixType.FIX_3D):
    return PositionSample(t_s, kind, 0.6 + north_m / EARTH_RADIUS_M, 2.0)


def north_m(state):
    return (state.latitude_rad - 0.6) * EARTH_RADIUS_M


def after_fixes(*fixes, jump_s=60.0):
    """Return the state after fixes, and whether each was accepted."""
    state, accepted = PositionState(), []
    for sample in fixes:
        state, is_accepted = update(predict(state, sample.t_s, (0.0, 0.0)), sample, jump_s)
        accepted.append(is_accepted)
    return state, accepted


def test_first_fix_sets_the_position_and_later_fixes_are_smoothed():
    state, _ = after_fixes(fix(0.0))
    assert north_m(state) == pytest.approx(0.0, abs=1e-6)
    state, _ = after_fixes(fix(0.0), fix(1.0, 10.0))
    assert north_m(state) == pytest.approx(10.0 * (1.0 - math.exp(-0.1)), abs=1e-6)


def test_position_is_predicted_between_fixes_and_restarts_after_a_minute():
    state, _ = after_fixes(fix(0.0))
    assert north_m(predict(state, 10.0, (0.5, 0.0))) == pytest.approx(5.0, abs=1e-6)
    predicted = predict(state, 7200.0, (0.5, 0.0))
    assert north_m(predicted) == pytest.approx(3600.0, abs=1e-3)
    assert distance_from_estimate_m(predicted, fix(7200.0, 3000.0)) == pytest.approx(600.0, abs=1e-3)
    restarted, _ = update(predicted, fix(7200.0, 3000.0), 60.0)
    assert north_m(restarted) == pytest.approx(3000.0, abs=1e-3)


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


def test_lasting_jump_is_accepted_after_the_jump_time():
    state, accepted = after_fixes(fix(0.0), *(fix(t, 10_000.0) for t in range(1, 80)))
    assert accepted.index(True, 1) == pytest.approx(61, abs=2)
    assert north_m(state) == pytest.approx(10_000.0, abs=1.0)


def test_scattered_positions_are_never_accepted():
    _, accepted = after_fixes(fix(0.0), *(fix(t, 10_000.0 * (t % 2 + 1) * (t % 3 + 1)) for t in range(1, 200)))
    assert not any(accepted[1:])


def test_distant_fix_is_accepted_after_a_long_gap():
    _, accepted = after_fixes(fix(0.0), fix(5000.0, 10_000.0))
    assert accepted == [True, True]


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


def test_only_an_accepted_jump_has_a_distance():
    jumped, _ = after_fixes(fix(0.0), *(fix(t, 200.0) for t in range(1, 30)))
    assert accepted_jump_m(jumped, fix(45.0, 200.0)) == pytest.approx(200.0, abs=1.0)
    assert accepted_jump_m(jumped, fix(30.0, 40.0)) is None  # back at the former position
    steady, _ = after_fixes(*(fix(t) for t in range(5)))
    assert accepted_jump_m(steady, fix(40.0, 150.0)) is None  # no jump: reachable in the time without fixes
    assert accepted_jump_m(PositionState(), fix(0.0)) is None
