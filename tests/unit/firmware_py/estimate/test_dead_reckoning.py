"""Dead reckoning in a tick: start, velocity and growth of the error."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.estimate import dead_reckoning, water, water_filter, water_results
from firmware_py.estimate.dead_reckoning import DeadReckoning

NO_ERROR = (0.0,) * 10
WATER = water_results.DeadReckoning(0.1, -0.05, 0.5, 0.03, NO_ERROR)
AT_FIX = DeadReckoning(WATER, 100.0)


def test_dead_reckoning_starts_with_guidance_values_and_filter_covariance():
    state = water.initial_state(0.1, 0.2, 0.6)
    assert dead_reckoning.begin(state, 7.0).water[:3] == (0.1, 0.2, 0.6)
    state, _, _ = water.take_position(state, 1.0, 0.6, 2.0)
    state = water.update(state, 1.0)._replace(slow=water.Expected(0.3, 0.4, 0.5))
    started = dead_reckoning.begin(state, 7.0)
    assert started.water[:3] == (0.3, 0.4, 0.5)
    assert started.begun_s == 7.0
    assert started.water.covariance == water_filter.water_at(state.filter, 7.0).covariance
    assert started.water.covariance[0] > 0.0


def test_velocity_is_that_by_heading_speed_leeway_and_current():
    state, (north_m_s, east_m_s) = dead_reckoning.advance(AT_FIX, 0.3, 1500.0, is_under_way=True)
    assert north_m_s == pytest.approx(0.1 + 0.5 * math.cos(0.3) - 0.03 * math.sin(0.3))
    assert east_m_s == pytest.approx(-0.05 + 0.5 * math.sin(0.3) + 0.03 * math.cos(0.3))
    assert state.water.cosine_s == pytest.approx(1500.0 * math.cos(0.3))


def test_standard_deviation_includes_a_tidal_current():
    """The current is a rotary tide of 0.3 m/s, and is assumed to be constant for two hours."""
    phases = [water_results.TIDE_RAD_S * (second + 0.5) for second in range(7200)]
    error_m = math.hypot(sum(0.3 * (math.cos(p) - 1.0) for p in phases), sum(0.3 * math.sin(p) for p in phases))
    states = [DeadReckoning(WATER._replace(current_north_m_s=0.0, current_east_m_s=c), 0.0) for c in (0.0, 0.3)]
    weak_m, strong_m = (
        dead_reckoning.standard_deviation_m(replace(state, water=state.water._replace(sideways_m_s=0.0)), 7200.0)
        for state in states
    )
    assert strong_m**2 - weak_m**2 == pytest.approx(0.5 * error_m**2, rel=1e-3)
    assert error_m > 900.0


def test_standard_deviation_grows_with_time_from_that_of_a_fix():
    sds_m = [dead_reckoning.standard_deviation_m(AT_FIX, t_s) for t_s in (0.0, 60.0, 600.0, 3600.0, 86_400.0)]
    assert sds_m[0] == water_results.FIX_SD_M
    assert sds_m == sorted(sds_m)
    assert sds_m[1] < 10.0


def test_without_heading_position_drifts_with_the_current_and_is_uncertain():
    state, velocity_m_s = dead_reckoning.advance(AT_FIX, None, 200.0, is_under_way=True)
    assert velocity_m_s == (0.1, -0.05)
    assert state.water.blind_m == pytest.approx(200.0 * math.hypot(0.5, 0.03))
    assert dead_reckoning.standard_deviation_m(state, 200.0) > 100.0


def test_disarmed_position_stays_and_its_error_grows_with_the_largest_speed():
    state, velocity_m_s = dead_reckoning.advance(AT_FIX, 1.0, 200.0, is_under_way=False)
    assert velocity_m_s == (0.0, 0.0)
    blind_m = 200.0 * (0.5 + math.hypot(0.1, 0.05))
    assert state == replace(AT_FIX, water=WATER._replace(blind_m=pytest.approx(blind_m)))


def test_time_without_heading_moves_the_position_by_the_current():
    state, drift_m = dead_reckoning.advance_without_heading(AT_FIX, 20.0)
    assert drift_m == pytest.approx((2.0, -1.0))
    assert (state.begun_s, state.water.blind_m) == (80.0, pytest.approx(20.0 * math.hypot(0.5, 0.03)))
    state, drift_m = dead_reckoning.advance_without_heading(AT_FIX, None)
    assert drift_m == (0.0, 0.0)
    assert dead_reckoning.standard_deviation_m(state, 40.0) == pytest.approx(1e5, rel=1e-3)
