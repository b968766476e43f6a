"""Dead reckoning in a tick: start, velocity and growth of the error."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.estimate import dead_reckoning, water, water_filter, water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning

SURE = (0.0,) * 10
KNOWN = water_results.DeadReckoning(0.1, -0.05, 0.5, 0.03, SURE)
BEGUN = DeadReckoning(KNOWN, 100.0)


def test_it_starts_from_the_guidance_values_and_the_filter_covariance():
    state = water.initial_state(0.1, 0.2, 0.6)
    begun = dead_reckoning.begin(state, 7.0)
    assert (begun.water.current_north_m_s, begun.water.current_east_m_s, begun.water.speed_m_s) == (0.1, 0.2, 0.6)
    state, _, _ = water.take_position(state, 1.0, 0.6, 2.0)
    state = water.update(state, 1.0)._replace(slow=water.Expected(0.3, 0.4, 0.5))
    begun = dead_reckoning.begin(state, 7.0)
    assert (begun.water.current_north_m_s, begun.water.current_east_m_s, begun.water.speed_m_s) == (0.3, 0.4, 0.5)
    assert begun.begun_s == 7.0
    assert begun.water.covariance == water_filter.water_at(state.filter, 7.0).covariance
    assert begun.water.covariance[0] > 0.0


def test_the_velocity_follows_from_heading_speed_leeway_and_current():
    state, (north_m_s, east_m_s) = dead_reckoning.advance(BEGUN, 0.3, 1500.0, under_way=True)
    assert north_m_s == pytest.approx(0.1 + 0.5 * math.cos(0.3) - 0.03 * math.sin(0.3))
    assert east_m_s == pytest.approx(-0.05 + 0.5 * math.sin(0.3) + 0.03 * math.cos(0.3))
    assert state.water.cosine_s == pytest.approx(1500.0 * math.cos(0.3))


def test_the_error_includes_a_current_that_is_all_tide():
    """A rotary tide of 0.3 m/s, assumed constant for two hours."""
    off_m = north_m = east_m = 0.0
    for second in range(7200):
        phase = water_results.TIDE_RAD_S * (second + 0.5)
        north_m, east_m = north_m + 0.3 * (math.cos(phase) - 1.0), east_m + 0.3 * math.sin(phase)
    off_m = math.hypot(north_m, east_m)
    weak_m, strong_m = (
        dead_reckoning.standard_deviation_m(
            DeadReckoning(water_results.DeadReckoning(0.0, c, 0.5, 0.0, SURE), 0.0), 7200.0
        )
        for c in (0.0, 0.3)
    )
    assert strong_m**2 - weak_m**2 == pytest.approx(0.5 * off_m**2, rel=1e-3)
    assert off_m > 900.0


def test_the_error_grows_with_time_from_that_of_a_fix():
    spreads_m = [
        dead_reckoning.standard_deviation_m(BEGUN, lasted_s) for lasted_s in (0.0, 60.0, 600.0, 3600.0, 86_400.0)
    ]
    assert spreads_m[0] == water_results.FIX_SD_M
    assert spreads_m == sorted(spreads_m)
    assert spreads_m[1] < 10.0


def test_without_a_heading_the_position_drifts_and_the_way_is_uncertain():
    state, velocity_m_s = dead_reckoning.advance(BEGUN, None, 200.0, under_way=True)
    assert velocity_m_s == (0.1, -0.05)
    assert state.water.blind_m == pytest.approx(200.0 * math.hypot(0.5, 0.03))
    assert dead_reckoning.standard_deviation_m(state, 200.0) > 100.0


def test_disarmed_the_position_stays_and_its_error_grows_with_the_largest_speed():
    state, velocity_m_s = dead_reckoning.advance(BEGUN, 1.0, 200.0, under_way=False)
    assert velocity_m_s == (0.0, 0.0)
    blind_m = 200.0 * (0.5 + math.hypot(0.1, 0.05))
    assert state == replace(BEGUN, water=KNOWN._replace(blind_m=pytest.approx(blind_m)))


def test_a_gap_without_dead_reckoning_moves_the_position_by_the_current():
    state, moved_m = dead_reckoning.advanced(BEGUN, 20.0)
    assert moved_m == pytest.approx((2.0, -1.0))
    assert (state.begun_s, state.water.blind_m) == (80.0, pytest.approx(20.0 * math.hypot(0.5, 0.03)))
    anywhere, moved_m = dead_reckoning.advanced(BEGUN, None)
    assert moved_m == (0.0, 0.0)
    assert dead_reckoning.standard_deviation_m(anywhere, 40.0) >= dead_reckoning.UNUSABLE_SD_M
