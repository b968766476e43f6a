"""The Kalman filter of the heading against matrix exponentials and textbook formulas."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_filter import MAX_LEVELS, MIN_LEVELS, PRIOR
from firmware_py.estimate.heading_model import OUTLIER_SQUARE, Motion, NoiseLevels
from firmware_py.model.kt import KtModel, rk4_step
from support.heading_recording import discrete

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
    whole = np.zeros((N, N))
    whole[UPPER] = motion[N:]
    return whole + np.triu(whole, 1).T


def drawn(seed: int) -> tuple[Motion, NoiseLevels, float]:
    """Return a random state with a full covariance, noise levels within their bounds, and a rudder angle."""
    numbers = np.random.default_rng(seed)
    root = numbers.standard_normal((N, N + 2)) * np.array([[0.1], [0.02], [0.2], [0.1], [0.2]])
    levels = NoiseLevels(*(numbers.uniform(low, high) for low, high in zip(MIN_LEVELS, MAX_LEVELS, strict=True)))
    state = numbers.uniform(-1.0, 1.0, N) * (3.0, 0.05, 0.3, 0.3, 0.3)
    return motion_of(state, root @ root.T), levels, float(numbers.uniform(-0.5, 0.5))


def matrices(levels: NoiseLevels, model: KtModel):
    """Return drift and noise matrix in continuous time."""
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


def step_of(levels: NoiseLevels, model: KtModel, step_s: float):
    """Return transition and noise covariance of a step, at whose end the rudder bias has walked."""
    drift, noise = matrices(levels, model)
    walk, noise[2, 2] = noise[2, 2], 0.0
    transition, covariance = discrete(drift, noise, step_s)
    covariance[2, 2] = walk * step_s
    return transition, covariance


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize("seed", range(5))
def test_a_step_is_the_exact_solution_of_the_linear_model(seed, step_s):
    motion, levels, rudder_rad = drawn(seed)
    transition, noise = step_of(levels, LINEAR, step_s)
    # The rudder acts as a bias of the other sign.
    shifted = state_of(motion) - (0.0, 0.0, rudder_rad, 0.0, 0.0)
    expected = transition @ shifted + (0.0, 0.0, rudder_rad, 0.0, 0.0)
    after = heading_model.predict(motion, levels, LINEAR, rudder_rad, step_s)
    assert state_of(after) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    covariance = transition @ covariance_of(motion) @ transition.T + noise
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert (np.abs(covariance_of(after) - covariance) <= 1e-9 * scale).all()


def test_the_bias_walk_within_a_sampling_interval_is_negligible():
    certain, levels = motion_of(np.zeros(N), np.zeros((N, N))), PRIOR
    for step_s, part in ((0.1, 1e-6), (0.5, 1e-4), (2.0, 1e-3), (60.0, 0.2)):
        noise = np.diag(discrete(*matrices(levels, LINEAR), step_s)[1])
        after = heading_model.predict(certain, levels, LINEAR, 0.0, step_s)
        assert after.p00 == pytest.approx(noise[0], rel=part)
        assert after.p11 == pytest.approx(noise[1], rel=part)


@pytest.mark.parametrize("step_s", [0.1, 0.5, 2.0])
def test_the_covariance_follows_the_derivatives_of_the_cubic_model(step_s):
    motion, levels, rudder_rad = drawn(1)
    transition = np.empty((N, N))
    for column in range(N):
        ends = []
        for sign in (1.0, -1.0):
            state = state_of(motion)
            state[column] += sign * 1e-5
            moved = motion_of(state, covariance_of(motion))
            ends.append(state_of(heading_model.predict(moved, levels, MODEL, rudder_rad, step_s)))
        transition[:, column] = (ends[0] - ends[1]) / 2e-5
    noise = step_of(levels, LINEAR, step_s)[1]
    expected = transition @ covariance_of(motion) @ transition.T + noise
    after = covariance_of(heading_model.predict(motion, levels, MODEL, rudder_rad, step_s))
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(after - expected) <= 1e-6 * scale).all()


def test_short_steps_follow_the_cubic_equation():
    motion, levels, _ = drawn(2)
    heading_rad, rate_rad_s = motion.heading_rad, motion.yaw_rate_rad_s
    for _ in range(600):
        motion = heading_model.predict(motion, levels, MODEL, 0.4, 0.05)
        heading_rad, rate_rad_s = rk4_step(heading_rad, rate_rad_s, 0.4, 0.05, *MODEL[:3], motion.bias_rad)
    assert motion.heading_rad == pytest.approx(heading_rad, abs=2e-3)
    assert motion.yaw_rate_rad_s == pytest.approx(rate_rad_s, abs=1e-5)


def test_without_headings_the_waves_stay_as_they_are_and_the_heading_diffuses():
    levels = PRIOR
    motion = heading_model.begin(0.5, levels)
    first, times_s = motion, 2000
    for _ in range(times_s):
        motion = heading_model.predict(motion, levels, LINEAR, 0.0, 1.0)
    assert (motion.p33, motion.p44) == pytest.approx((first.p33, first.p44), rel=1e-9)
    assert motion.p34 == pytest.approx(0.0, abs=1e-9 * math.sqrt(motion.p33 * motion.p44))
    certain = motion_of(state_of(first), np.zeros((N, N)))
    for _ in range(times_s):
        certain = heading_model.predict(certain, levels._replace(bias_walk=-40.0), LINEAR, 0.0, 1.0)
    # All but the first lag of the diffusion, with its memory of the yaw rate.
    expected = math.exp(levels.diffusion) * (times_s - 1.5 * LINEAR.turning_lag_s)
    assert certain.p00 == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_correction_is_that_of_the_kalman_filter(seed):
    motion, levels, _ = drawn(seed)
    shows, covariance = np.array([1.0, 0.0, 0.0, 1.0, 0.0]), covariance_of(motion)
    variance = shows @ covariance @ shows + math.exp(2.0 * levels.compass_noise)
    innovation_rad = 2.0 * math.sqrt(variance) * (-1.0) ** seed
    heading_rad = shows @ state_of(motion) + innovation_rad + 2.0 * math.pi * (seed - 2)
    after, found_rad, found_variance = heading_model.correct(motion, levels, heading_rad)
    gain = covariance @ shows / variance
    assert (found_rad, found_variance) == pytest.approx((innovation_rad, variance), rel=1e-9)
    assert state_of(after) == pytest.approx(state_of(motion) + gain * innovation_rad, rel=1e-9)
    assert covariance_of(after) == pytest.approx(covariance - np.outer(gain, gain) * variance, rel=1e-6, abs=1e-12)


def test_the_influence_of_an_outlier_falls_with_its_size():
    motion, levels = heading_model.begin(0.0, PRIOR)._replace(p00=1e-4, p01=1e-5), PRIOR
    variance = heading_model.correct(motion, levels, 0.0)[2]
    limit_rad = math.sqrt(OUTLIER_SQUARE * variance)
    moved = []
    for times in (1.0, 2.0, 4.0, 8.0):
        after, _, _ = heading_model.correct(motion, levels, times * limit_rad)
        moved.append(after.heading_rad)
        assert after.p00 < motion.p00
    assert moved == pytest.approx([moved[0], moved[0] / 2.0, moved[0] / 4.0, moved[0] / 8.0], rel=1e-9)


@given(
    st.integers(0, 1000),
    st.lists(
        st.tuples(st.sampled_from((0.02, 0.1, 0.5, 1.0, 5.0, 60.0)), st.floats(-7.0, 7.0), st.floats(-0.6, 0.6)),
        min_size=1,
        max_size=40,
    ),
)
def test_the_covariance_stays_positive(seed, samples):
    _, levels, _ = drawn(seed)
    motion = heading_model.begin(0.0, levels)
    for step_s, heading_rad, rudder_rad in samples:
        motion = heading_model.predict(motion, levels, LINEAR, rudder_rad, step_s)
        motion, _, variance = heading_model.correct(motion, levels, heading_rad)
        assert variance > 0.0
        assert heading_model.is_valid(motion)
        deviations = np.sqrt(np.diag(covariance_of(motion)))
        assert np.linalg.eigvalsh(covariance_of(motion) / np.outer(deviations, deviations)).min() > -1e-6


def test_the_log_likelihood_is_that_of_a_normal_distribution_up_to_an_outlier():
    for innovation_rad, variance in ((0.01, 1e-4), (-0.2, 0.01), (0.0, 3.0)):
        density = math.exp(-0.5 * innovation_rad**2 / variance) / math.sqrt(2.0 * math.pi * variance)
        found = heading_model.log_likelihood(innovation_rad, variance) - 0.5 * math.log(2.0 * math.pi)
        assert found == pytest.approx(math.log(density), abs=1e-12)
    assert heading_model.log_likelihood(1.0, 1e-4) == heading_model.log_likelihood(2.0, 1e-4)


def test_an_unexplained_turn_opens_yaw_rate_and_bias_alone():
    motion = drawn(3)[0]
    after = heading_model.with_unexplained_turn(motion)
    changed = covariance_of(after) - covariance_of(motion)
    expected = np.diag([0.0, radians(2.0) ** 2, radians(20.0) ** 2, 0.0, 0.0])
    assert changed == pytest.approx(expected, abs=1e-15)
    assert state_of(after) == pytest.approx(state_of(motion))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [*range(N), *(N + np.flatnonzero(UPPER[0] == UPPER[1]))])
def test_numbers_that_are_not_finite_are_not_valid(place, value):
    motion = drawn(4)[0]
    assert heading_model.is_valid(motion)
    assert not heading_model.is_valid(Motion(*(value if i == place else part for i, part in enumerate(motion))))


def test_a_variance_that_is_not_positive_is_not_valid():
    motion = drawn(4)[0]
    for name in ("p00", "p11", "p22", "p33", "p44"):
        assert not heading_model.is_valid(motion._replace(**{name: 0.0}))
