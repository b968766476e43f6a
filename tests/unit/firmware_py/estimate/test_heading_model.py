"""Kalman filter of the heading, compared with matrix exponentials and textbook formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_filter import MAX_LEVELS, MIN_LEVELS, PRIOR
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.model.kt import KtModel, rk4_step
from support.heading_recording import discretize

N = 5
UPPER = np.triu_indices(N)
MODEL = KtModel(0.049, 4.0, 17.0, 0.0, 0.4)
LINEAR = KtModel(0.049, 4.0, 0.0, 0.0, 0.4)
STEPS_S = (0.02, 0.1, 0.5, 3.0, 60.0)


def motion_of(state, covariance) -> Motion:
    return Motion(*map(float, state), *map(float, np.asarray(covariance)[UPPER]))


def state_of(motion: Motion):
    return np.array(motion[:N])


def covariance_of(motion: Motion):
    upper = np.zeros((N, N))
    upper[UPPER] = motion[N:]
    return upper + np.triu(upper, 1).T


def draw_state(seed: int) -> tuple[Motion, NoiseLevels, float]:
    """Draw a state with a full covariance, noise levels within their bounds, and a rudder angle."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, N + 2)) * np.array([[0.1], [0.02], [0.2], [0.1], [0.2]])
    levels = NoiseLevels(*(rng.uniform(low, high) for low, high in zip(MIN_LEVELS, MAX_LEVELS, strict=True)))
    state = rng.uniform(-1.0, 1.0, N) * (3.0, 0.05, 0.3, 0.3, 0.3)
    return motion_of(state, root @ root.T), levels, float(rng.uniform(-0.5, 0.5))


def matrices(levels: NoiseLevels, model: KtModel):
    """Return drift and noise matrices in continuous time."""
    diffusion, wave_sd, period_s, damping, _, walk = np.exp(levels)
    ability, lag_s, omega = model.turning_ability_1_s, model.turning_lag_s, 2.0 * math.pi / period_s
    drift, noise = np.zeros((N, N)), np.zeros((N, N))
    drift[0, 1] = 1.0
    drift[1, 1:3] = -1.0 / lag_s, -ability / lag_s
    drift[3, 4] = 1.0
    drift[4, 3:] = -omega * omega, -2.0 * damping * omega
    noise[1, 1] = diffusion / lag_s**2
    noise[2, 2] = walk**2
    noise[4, 4] = 4.0 * damping * omega**3 * wave_sd**2
    return drift, noise


def discrete_model(levels: NoiseLevels, model: KtModel, step_s: float):
    """Return transition and noise covariance of a step; the walk of the bias is added at its end."""
    drift, noise = matrices(levels, model)
    walk, noise[2, 2] = noise[2, 2], 0.0
    transition, covariance = discretize(drift, noise, step_s)
    covariance[2, 2] = walk * step_s
    return transition, covariance


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize("seed", range(5))
def test_predict_is_the_exact_solution_of_the_linear_model(seed, step_s):
    motion, levels, rudder_rad = draw_state(seed)
    transition, noise = discrete_model(levels, LINEAR, step_s)
    # The rudder acts as a bias of the opposite sign.
    relative = state_of(motion) - (0.0, 0.0, rudder_rad, 0.0, 0.0)
    expected = transition @ relative + (0.0, 0.0, rudder_rad, 0.0, 0.0)
    predicted = heading_model.predict(motion, levels, LINEAR, rudder_rad, step_s)
    assert state_of(predicted) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    covariance = transition @ covariance_of(motion) @ transition.T + noise
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert (np.abs(covariance_of(predicted) - covariance) <= 1e-9 * scale).all()


def test_bias_walk_within_a_sampling_interval_is_negligible():
    exact, levels = motion_of(np.zeros(N), np.zeros((N, N))), PRIOR
    for step_s, tolerance in ((0.1, 1e-6), (0.5, 1e-4), (2.0, 1e-3), (60.0, 0.2)):
        noise = np.diag(discretize(*matrices(levels, LINEAR), step_s)[1])
        predicted = heading_model.predict(exact, levels, LINEAR, 0.0, step_s)
        assert predicted.p00 == pytest.approx(noise[0], rel=tolerance)
        assert predicted.p11 == pytest.approx(noise[1], rel=tolerance)


@pytest.mark.parametrize("step_s", [0.1, 0.5, 2.0])
def test_covariance_follows_the_derivatives_of_the_cubic_model(step_s):
    motion, levels, rudder_rad = draw_state(1)
    transition = np.empty((N, N))
    for column in range(N):
        ends = []
        for sign in (1.0, -1.0):
            state = state_of(motion)
            state[column] += sign * 1e-5
            shifted_motion = motion_of(state, covariance_of(motion))
            ends.append(state_of(heading_model.predict(shifted_motion, levels, MODEL, rudder_rad, step_s)))
        transition[:, column] = (ends[0] - ends[1]) / 2e-5
    noise = discrete_model(levels, LINEAR, step_s)[1]
    expected = transition @ covariance_of(motion) @ transition.T + noise
    covariance = covariance_of(heading_model.predict(motion, levels, MODEL, rudder_rad, step_s))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(covariance - expected) <= 1e-6 * scale).all()


def test_predict_in_short_steps_follows_the_cubic_equation():
    motion, levels, _ = draw_state(2)
    heading_rad, rate_rad_s = motion.heading_rad, motion.yaw_rate_rad_s
    for _ in range(600):
        motion = heading_model.predict(motion, levels, MODEL, 0.4, 0.05)
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, 0.4, 0.05, *MODEL[:3], motion.bias_rad)
    assert motion.heading_rad == pytest.approx(heading_rad, abs=2e-3)
    assert motion.yaw_rate_rad_s == pytest.approx(rate_rad_s, abs=1e-5)


def test_without_headings_wave_variances_stay_and_the_heading_diffuses():
    levels = PRIOR
    motion = heading_model.begin(0.5, levels)
    initial, steps = motion, 2000
    for _ in range(steps):
        motion = heading_model.predict(motion, levels, LINEAR, 0.0, 1.0)
    assert (motion.p33, motion.p44) == pytest.approx((initial.p33, initial.p44), rel=1e-9)
    assert motion.p34 == pytest.approx(0.0, abs=1e-9 * math.sqrt(motion.p33 * motion.p44))
    exact = motion_of(state_of(initial), np.zeros((N, N)))
    for _ in range(steps):
        exact = heading_model.predict(exact, levels._replace(bias_walk=-40.0), LINEAR, 0.0, 1.0)
    # The yaw rate starts at 0, so that diffusion is missing for 1.5 lags.
    expected = math.exp(levels.diffusion) * (steps - 1.5 * LINEAR.turning_lag_s)
    assert exact.p00 == pytest.approx(expected, rel=1e-3)


def corrected(sensor, motion, levels, measured):
    """Return the measurement row and noise variance of a sensor, and the results of the update with its value."""
    if sensor == "compass":
        result = heading_model.correct(motion, levels, measured)
        return (1.0, 0.0, 0.0, 1.0, 0.0), math.exp(2.0 * levels.compass_noise), result
    if sensor == "rate":
        return (0.0, 1.0, 0.0, 0.0, 1.0), 0.003, heading_model.correct_rate(motion, measured, 0.003)
    return (1.0, 0.0, 0.0, 0.0, 0.0), 0.05**2, (heading_model.correct_course(motion, measured, 0.05), None, None)


@pytest.mark.parametrize("sensor", ["compass", "rate", "course"])
@pytest.mark.parametrize("sds", [2.0, -3.4, 3.6, -5.0])
@pytest.mark.parametrize("seed", range(3))
def test_correction_equals_the_kalman_filter_update_with_less_weight_for_outliers(seed, sds, sensor):
    """Beyond 3.46 standard deviations, the variance is raised until its square is 12."""
    motion, levels, _ = draw_state(seed)
    measurement, noise, _ = corrected(sensor, motion, levels, 0.0)
    measurement, covariance = np.array(measurement), covariance_of(motion)
    variance = measurement @ covariance @ measurement + noise
    innovation = sds * math.sqrt(variance)
    turns_rad = 0.0 if sensor == "rate" else 2.0 * math.pi * (seed - 1)
    measured = measurement @ state_of(motion) + innovation + turns_rad
    _, _, (updated, *results) = corrected(sensor, motion, levels, float(measured))
    if sensor != "course":
        assert results == pytest.approx((innovation, variance), rel=1e-9)
    cross, weight_variance = covariance @ measurement, max(variance, innovation**2 / 12.0)
    assert state_of(updated) == pytest.approx(state_of(motion) + cross * innovation / weight_variance, rel=1e-9)
    assert covariance_of(updated) == pytest.approx(
        covariance - np.outer(cross, cross) / weight_variance, rel=1e-6, abs=1e-12
    )


def test_first_state_has_the_wave_yaw_and_initial_standard_deviations():
    """Heading 18 deg, yaw rate 3 deg/s, rudder bias 12.8 deg; the wave is that of the levels."""
    levels = NoiseLevels(0.0, math.log(0.1), math.log(4.0), 0.0, 0.0, 0.0)
    motion = heading_model.begin(0.7, levels)
    assert state_of(motion) == pytest.approx([0.7, 0.0, 0.0, 0.0, 0.0])
    sds = (math.radians(18.0), math.radians(3.0), math.radians(12.8), 0.1, 0.1 * math.pi / 2.0)
    assert covariance_of(motion) == pytest.approx(np.diag(np.square(sds)), rel=1e-9)


@pytest.mark.parametrize("step_s", [3.0, 60.0])
def test_unstable_cubic_term_is_predicted_by_the_tangent_of_the_equation(step_s):
    """With c = alpha r0^2, r + c r = (1 + 3 c) r - 2 c r0 near r0: a linear model with K and T divided by 1 + 3 c."""
    motion, levels, rudder_rad = draw_state(1)
    motion = motion._replace(yaw_rate_rad_s=0.3)
    cubic = 17.0 * 0.3**2
    divisor, offset_rad = 1.0 + 3.0 * cubic, 2.0 * cubic * 0.3 / 0.049
    tangent = KtModel(0.049 / divisor, 4.0 / divisor, 0.0, 0.0, 0.4)
    linear_levels = levels._replace(diffusion=levels.diffusion - 2.0 * math.log(divisor))
    expected = heading_model.predict(motion, linear_levels, tangent, rudder_rad + offset_rad, step_s)
    assert heading_model.predict(motion, levels, MODEL, rudder_rad, step_s) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("step_s", [0.5, 60.0])
@pytest.mark.parametrize("seed", range(3))
def test_extrapolation_is_the_prediction_without_covariance(seed, step_s):
    motion, levels, rudder_rad = draw_state(seed)
    predicted = heading_model.predict(motion, levels, MODEL, rudder_rad, step_s)
    assert heading_model.extrapolate(motion, MODEL, rudder_rad, step_s) == pytest.approx(predicted[:2], rel=1e-12)


@given(
    st.integers(0, 1000),
    st.lists(
        st.tuples(st.sampled_from((0.02, 0.1, 0.5, 1.0, 5.0, 60.0)), st.floats(-7.0, 7.0), st.floats(-0.6, 0.6)),
        min_size=1,
        max_size=40,
    ),
)
def test_covariance_stays_positive_definite(seed, samples):
    _, levels, _ = draw_state(seed)
    motion = heading_model.begin(0.0, levels)
    for step_s, heading_rad, rudder_rad in samples:
        motion = heading_model.predict(motion, levels, LINEAR, rudder_rad, step_s)
        motion, _, variance = heading_model.correct(motion, levels, heading_rad)
        assert variance > 0.0
        assert heading_model.is_valid(motion)
        deviations = np.sqrt(np.diag(covariance_of(motion)))
        assert np.linalg.eigvalsh(covariance_of(motion) / np.outer(deviations, deviations)).min() > -1e-6


def test_log_likelihood_is_that_of_a_normal_distribution_up_to_the_outlier_limit():
    for innovation_rad, variance in ((0.01, 1e-4), (-0.2, 0.01), (0.0, 3.0)):
        density = math.exp(-0.5 * innovation_rad**2 / variance) / math.sqrt(2.0 * math.pi * variance)
        result = heading_model.log_likelihood(innovation_rad, variance) - 0.5 * math.log(2.0 * math.pi)
        assert result == pytest.approx(math.log(density), abs=1e-12)
    at_limit = heading_model.log_likelihood(math.sqrt(12.0), 1.0)
    assert at_limit == pytest.approx(-6.0) == heading_model.log_likelihood(9.0, 1.0)


def test_unexplained_turn_raises_the_variances_of_yaw_rate_and_bias_only():
    motion = draw_state(3)[0]
    result = heading_model.with_unexplained_turn(motion)
    difference = covariance_of(result) - covariance_of(motion)
    expected = np.diag([0.0, radians(2.0) ** 2, radians(20.0) ** 2, 0.0, 0.0])
    assert difference == pytest.approx(expected, abs=1e-15)
    assert state_of(result) == pytest.approx(state_of(motion))


def test_is_valid_needs_finite_values_and_positive_variances():
    motion, variances = draw_state(4)[0], ("p00", "p11", "p22", "p33", "p44")
    assert heading_model.is_valid(motion)
    for name in (*Motion._fields[:N], *variances):
        for value in (math.nan, math.inf, -math.inf, *((0.0,) if name in variances else ())):
            assert not heading_model.is_valid(motion._replace(**{name: value})), (name, value)
