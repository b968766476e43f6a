"""Dead reckoning: where it takes her, and whether it errs as it says."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from firmware_py.estimate import kalman, reckoning
from firmware_py.estimate.reckoning import Reckoning
from firmware_py.estimate.wave_filter_state import WaveFilterState, start

KNOWN = (0.1, -0.05, 0.5, 0.06)  # current north and east, speed, leeway
SLACK = (0.0, 0.0, 0.5, 0.06)
SDS = (0.04, 0.03, 0.05, 0.08)
CORRELATED = np.array(((1.0, 0.3, -0.6, 0.2), (0.3, 1.0, 0.1, -0.5), (-0.6, 0.1, 1.0, 0.0), (0.2, -0.5, 0.0, 1.0)))
LEGS = ((0.3, 1500.0), (2.4, 900.0))  # heading and for how long


def begun(known=KNOWN, covariance=None):
    given = np.zeros((4, 4)) if covariance is None else np.asarray(covariance)
    return Reckoning(*known, tuple(given[np.triu_indices(4)].tolist()), 100.0)


def sailed(state, legs=LEGS):
    north_m = east_m = 0.0
    for heading_rad, seconds in legs:
        state, (north_m_s, east_m_s) = reckoning.sail(state, heading_rad, seconds, under_way=True)
        north_m, east_m = north_m + seconds * north_m_s, east_m + seconds * east_m_s
    return state, north_m, east_m


def test_it_begins_with_the_water_that_was_steered_by_and_what_the_filter_knows_of_it():
    waves = start(WaveFilterState(expected_water=(0.1, 0.2, 0.6)), 0.0, 1.0)
    state = reckoning.begin(waves, (0.3, 0.4, 0.5), 7.0)
    assert (state.current_north_m_s, state.current_east_m_s, state.speed_m_s, state.begun_s) == (0.3, 0.4, 0.5, 7.0)
    assert state.covariance[0] == waves.covariance(kalman.NORTH, kalman.NORTH) > 0.0
    assert state.covariance[7] == waves.covariance(kalman.SPEED, kalman.SPEED)
    assert state.covariance[9] == waves.covariance(kalman.LEEWAY, kalman.LEEWAY)
    assert reckoning.begin(waves, None, 7.0).speed_m_s == 0.6
    assert reckoning.begin(WaveFilterState(), None, 7.0) is None


def test_she_goes_by_heading_leeway_speed_and_current():
    _, north_m, east_m = sailed(begun())
    assert north_m == pytest.approx(2400 * 0.1 + 750 * math.cos(0.36) + 450 * math.cos(2.46))
    assert east_m == pytest.approx(-2400 * 0.05 + 750 * math.sin(0.36) + 450 * math.sin(2.46))


def test_it_errs_as_it_says():
    covariance = CORRELATED * np.outer(SDS, SDS)
    rng = np.random.default_rng(5)
    off_m = []
    state, north_m, east_m = sailed(begun(SLACK, covariance))
    for wrong in rng.multivariate_normal(np.zeros(4), covariance, 2000):
        _, true_north_m, true_east_m = sailed(begun(np.add(SLACK, wrong)))
        off_m.append((true_north_m - north_m, true_east_m - east_m))
    found_m2 = np.linalg.eigvalsh(np.cov(np.transpose(off_m)))[-1]
    unseen_m2 = reckoning.spread_m(begun(SLACK), 2400.0) ** 2
    assert reckoning.spread_m(state, 2400.0) ** 2 - unseen_m2 == pytest.approx(found_m2, rel=0.1)


def test_on_one_heading_the_sum_of_speed_and_current_stays_known():
    covariance = np.zeros((4, 4))
    covariance[np.ix_((0, 2), (0, 2))] = ((0.01, -0.01), (-0.01, 0.01))
    ahead, _, _ = sailed(begun((0.0, 0.0, 0.5, 0.0), covariance), ((0.0, 1800.0),))
    back, _, _ = sailed(begun((0.0, 0.0, 0.5, 0.0), covariance), ((math.pi, 1800.0),))
    nothing_m = reckoning.spread_m(begun((0.0, 0.0, 0.5, 0.0)), 1800.0)
    assert reckoning.spread_m(ahead, 1800.0) == pytest.approx(nothing_m)
    assert reckoning.spread_m(back, 1800.0) == pytest.approx(math.hypot(nothing_m, 2 * 0.1 * 1800.0))


def test_all_of_the_current_may_be_a_tide_that_turns():
    """A rotary tide of 0.3 m/s taken for a steady current, added up for two hours."""
    times_s = np.arange(7200) + 0.5
    turned = 0.3 * (np.exp(1j * reckoning.TIDE_RAD_S * times_s) - 1.0)
    off_m = abs(turned.sum())
    weak_m, strong_m = (reckoning.spread_m(begun((0.0, c, 0.5, 0.0)), 7200.0) for c in (0.0, 0.3))
    assert strong_m**2 - weak_m**2 == pytest.approx(0.5 * off_m**2, rel=1e-3)
    assert off_m > 900.0


def test_it_grows_with_time_and_begins_as_good_as_a_fix():
    spreads_m = [reckoning.spread_m(begun(), lasted_s) for lasted_s in (0.0, 60.0, 600.0, 3600.0, 86_400.0)]
    assert spreads_m[0] == reckoning.FIX_SD_M
    assert spreads_m == sorted(spreads_m)
    assert spreads_m[1] < 10.0


def test_without_a_heading_she_goes_with_the_water_and_may_have_sailed_anywhere():
    state, velocity_m_s = reckoning.sail(begun(), None, 200.0, under_way=True)
    assert velocity_m_s == (0.1, -0.05)
    assert state.blind_m == pytest.approx(100.0)
    assert reckoning.spread_m(state, 200.0) > 100.0


def test_disarmed_the_place_stands_and_grows_as_uncertain_as_if_she_had_sailed():
    state, velocity_m_s = reckoning.sail(begun(), 1.0, 200.0, under_way=False)
    assert velocity_m_s == (0.0, 0.0)
    assert state == replace(begun(), blind_m=pytest.approx(200.0 * (0.5 + math.hypot(0.1, 0.05))))
