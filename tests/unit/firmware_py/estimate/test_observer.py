import math
import random

import pytest
from msgspec.structs import replace

from firmware_py.common.angles import wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import HeadingSample, NorthReference
from firmware_py.estimate import fixed_gain
from firmware_py.estimate.observer import HeadingState, ObserverSettings, correct, predict, update
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

SETTINGS = ObserverSettings.of(ParameterSet())


def sample(t_s, heading_rad, reference=NorthReference.TRUE):
    return HeadingSample(t_s, heading_rad % (2 * math.pi), reference)


def test_first_sample_starts_the_observer():
    state = update(SETTINGS, HeadingState(), [sample(1.0, 2.0)], 0.0, 1.0)
    assert state.heading_rad == pytest.approx(2.0)
    assert state.yaw_rate_rad_s == 0.0
    assert state.is_fresh(2.0, SETTINGS.timeout_s)
    assert not state.is_fresh(2.1, SETTINGS.timeout_s)


def test_observer_follows_a_noisy_turn_through_north_with_irregular_samples():
    rng, state = random.Random(2), HeadingState()
    heading_rad, rate_rad_s, t_s = 5.5, 0.0, 0.0
    heading_errors_rad, rate_errors_rad_s = [], []
    for _ in range(1500):
        step_s = rng.choice([0.05, 0.1, 0.15])
        t_s += step_s
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, 0.4, step_s, 0.049, 4.0, 17.0, 0.0)
        noisy = sample(t_s, heading_rad + rng.gauss(0.0, math.radians(0.3)))
        state = update(SETTINGS, state, [noisy], 0.4, t_s)
        heading_errors_rad.append(abs(wrap_pi(state.heading_rad - heading_rad)))
        rate_errors_rad_s.append(abs(state.yaw_rate_rad_s - rate_rad_s))
    assert math.degrees(max(heading_errors_rad[300:])) < 0.8
    assert math.degrees(max(rate_errors_rad_s[300:])) < 0.4


def test_prediction_is_that_of_the_model_and_stable_at_any_interval():
    state, heading_rad, rate_rad_s = HeadingState(0.0, 1.0, 0.02, 0.0), 1.0, 0.02
    for _ in range(100):
        model = (OCEAN_RAMBLER.turning_ability_1_s, 4.0, 0.0, 0.0)
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, 0.2, 0.01, *model)
    predicted = predict(SETTINGS, state, 1.0, 0.2)
    assert predicted.heading_rad == pytest.approx(heading_rad, abs=1e-6)
    assert predicted.yaw_rate_rad_s == pytest.approx(rate_rad_s, abs=1e-6)
    fast_model = replace(SETTINGS, model=SETTINGS.model._replace(turning_lag_s=0.05))
    assert abs(predict(fast_model, state, 100.0, 0.2).yaw_rate_rad_s) < 0.05


def test_gap_restarts_the_observer_with_yaw_rate_0():
    state = update(SETTINGS, HeadingState(), [sample(0.0, 0.0)], 0.0, 0.0)
    state = update(SETTINGS, state, [sample(30.0, 3.0)], 0.0, 30.0)
    assert state.heading_rad == pytest.approx(3.0)
    assert state.yaw_rate_rad_s == 0.0


@pytest.mark.parametrize(("t_s", "heading_rad"), [(0.1, math.nan), (0.1, math.inf), (math.nan, 1.0)])
def test_samples_that_are_not_finite_are_ignored(t_s, heading_rad):
    state = update(SETTINGS, HeadingState(), [sample(0.0, 1.0)], 0.0, 0.0)
    assert correct(SETTINGS, state, HeadingSample(t_s, heading_rad, NorthReference.TRUE), 0.0) == state


def test_two_samples_at_the_same_time_give_a_finite_yaw_rate():
    state = update(SETTINGS, HeadingState(), [sample(0.0, 1.0), sample(0.0, 1.5)], 0.0, 0.1)
    assert math.isfinite(state.yaw_rate_rad_s)


@pytest.mark.parametrize("late_s", [0.0, 0.05])
def test_update_predicts_with_the_rudder_and_corrects_with_the_time_since_the_last_sample(late_s):
    settings = replace(SETTINGS, tau_s=2.0, timeout_s=1.0)
    state = HeadingState(10.2 + late_s, 1.0, 0.02, 10.0)
    measured = replace(sample(10.3, 1.05), roll_rad=0.1, pitch_rad=0.2)
    heading_rad, rate_rad_s = fixed_gain.predict(
        1.0, 0.02, 0.3, 0.1 - late_s, math.exp((late_s - 0.1) / 4.0), 0.049, 4.0
    )
    limit_rad_s = 10.0 * 0.049 * math.radians(30.0) + math.radians(5.0)
    expected = fixed_gain.correct(heading_rad, rate_rad_s, 1.05, 0.3, math.exp(-0.15), limit_rad_s)
    result = correct(settings, state, measured, 0.3)
    assert (result.heading_rad, result.yaw_rate_rad_s) == pytest.approx(expected)
    assert (result.t_s, result.sample_t_s, result.roll_rad, result.pitch_rad) == (10.3, 10.3, 0.1, 0.2)
    later = update(settings, state, [measured], 0.3, 10.5)
    assert later == predict(settings, result, 10.5, 0.3)
    assert update(settings, result, [], 0.3, 11.4) is result  # the time-out has passed
    assert predict(settings, result, 10.3, 0.3) is result
