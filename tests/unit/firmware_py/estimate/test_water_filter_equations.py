"""Water filter, compared with a plain Kalman filter that has matrix exponentials."""

import math
from functools import cache

import numpy as np
import pytest

from firmware_py.estimate import water_filter
from firmware_py.estimate.water_filter import begin, correct, take_heading, water_at
from support.heading_recording import discretize

# `begin`: time, position [m], speed and its standard deviation, current north and east and its standard deviation,
# sideways speed and its standard deviation [m/s].
N, UPPER = 7, np.triu_indices(4)
MEMORY_S = 30.0  # of the speed deviation
# Speed deviation [m/s], walk of the current [m/s/sqrt(s)], drift [m/sqrt(s)] and noise of the position [m].
PRIOR = np.log([0.1, 0.0004, 0.15, 0.3])
PRIOR_INFORMATION = np.array([0.7, 0.7, 1.0, 1.0]) ** -2.0
MIN_LEVELS, MAX_LEVELS = np.log([0.01, 0.0001, 0.001, 0.02]), np.log([0.5, 0.005, 1.0, 20.0])


@cache
def discrete_model(step_s, cosine, sine):
    """Return transition and noise covariance of a step with sigma = 1 and no other noise."""
    rates = np.array([[-1.0 / MEMORY_S, 0.0, 0.0], [cosine, 0.0, 0.0], [sine, 0.0, 0.0]])
    small_transition, small_noise = discretize(rates, np.diag([2.0 / MEMORY_S, 0.0, 0.0]), step_s)
    transition, noise, places = np.eye(N), np.zeros((N, N)), np.ix_([0, 5, 6], [0, 5, 6])
    transition[places], noise[places] = small_transition, small_noise
    transition[5:, 1:5] = step_s * np.array([[cosine, -sine, 1.0, 0.0], [sine, cosine, 0.0, 1.0]])
    return transition, noise


def predict_part(x, p, levels, step_s, cosine, sine):
    """Return mean and covariance after a step with constant cosine and sine; the slow walks are added at its end."""
    sigma, walk, drift, _ = np.exp(levels)
    transition, noise = discrete_model(step_s, cosine, sine)
    walks = step_s * np.array([0.0, 0.001, 0.0005, walk, walk, drift, drift]) ** 2
    return transition @ x, transition @ p @ transition.T + sigma**2 * noise + np.diag(walks)


def predict_blind(x, p, levels, step_s):
    """Return mean and covariance after a step without a heading: the way is as long as the speed, in any direction."""
    x, p, (sigma, walk, _, _), keep = x.copy(), p.copy(), np.exp(levels), math.exp(-step_s / MEMORY_S)
    way = 0.5 * ((x[0] + x[1]) ** 2 + p[0, 0] + p[1, 1] + p[2, 2])
    x[5:] += step_s * x[3:5]
    p[5:, :5] = p[:5, 5:] = 0.0
    p[5, 5] += step_s**2 * (way + p[3, 3])
    p[6, 6] += step_s**2 * (way + p[4, 4])
    decay = np.diag([keep, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    noise = [sigma**2 * (1.0 - keep**2), *(step_s * np.array([0.001, 0.0005, walk, walk]) ** 2), 0.0, 0.0]
    return decay @ x, decay @ p @ decay + np.diag(noise)


class PlainFilter:
    """The water filter by the equations of the module's text, with matrices."""

    def __init__(self, mean, sds):
        self.x, self.p = [np.array(mean)] * 5, [np.diag(np.square(sds))] * 5
        self.levels, self.information = PRIOR.copy(), PRIOR_INFORMATION.copy()
        self.t_s, self.refused_t_s, self.restarts = 0.0, math.nan, 0
        self.vector_s, self.known_s = np.zeros(2), 0.0

    def take_heading(self, heading_rad, step_s):
        if math.isfinite(heading_rad):
            self.vector_s = self.vector_s + step_s * np.array([math.cos(heading_rad), math.sin(heading_rad)])
            self.known_s += step_s

    def predict(self, number, levels, step_s):
        x, p = self.x[number], self.p[number]
        if self.known_s < 0.9 * step_s:
            return predict_blind(x, p, levels, min(step_s, 86400.0))
        rest_s, part_s = step_s, max(30.0, step_s / 20.0)
        while rest_s > 0.0:
            x, p = predict_part(x, p, levels, min(part_s, rest_s), *map(float, self.vector_s / self.known_s))
            rest_s -= part_s
        return x, p

    def correct(self, t_s, position_m):
        step_s, likelihoods = t_s - self.t_s, np.zeros(5)
        if step_s < 4.5:
            return
        offsets = 0.02 * np.vstack([np.zeros(4), np.eye(4)])
        predicted = [self.predict(number, self.levels + offsets[number], step_s) for number in range(5)]
        x, p = predicted[0]
        error_m = position_m - x[5:]
        gate = error_m @ np.linalg.solve(p[5:, 5:] + (math.exp(2.0 * self.levels[3]) + 9.0) * np.eye(2), error_m)
        if gate >= 25.0 and not t_s - self.refused_t_s >= 30.0:
            self.refused_t_s = t_s if math.isnan(self.refused_t_s) else self.refused_t_s
            return
        for number, (x, p) in enumerate(predicted):
            if gate >= 25.0:
                x[5:], p[5:, :], p[:, 5:] = position_m, 0.0, 0.0
                p[5, 5] = p[6, 6] = 9.0
            else:
                noise_m2 = math.exp(2.0 * (self.levels + offsets[number])[3])
                x, p, likelihoods[number] = self.update(x, p, noise_m2, position_m)  # noqa: PLW2901
            self.x[number], self.p[number] = x, p
        self.restarts += gate >= 25.0
        if gate < 25.0 and self.known_s >= 0.9 * step_s:
            self.learn(min(step_s / 3600.0, 1.0), likelihoods)
        self.t_s, self.vector_s, self.known_s, self.refused_t_s = t_s, np.zeros(2), 0.0, math.nan

    def update(self, x, p, noise_m2, position_m):
        innovation_m, covariance = position_m - x[5:], p[5:, 5:] + noise_m2 * np.eye(2)
        square = innovation_m @ np.linalg.solve(covariance, innovation_m)
        likelihood = -0.5 * math.log(np.linalg.det(covariance)) - 0.5 * square
        if square > 9.0:  # Huber: linear beyond the limit, and a larger noise
            likelihood += 0.5 * square - 3.0 * math.sqrt(square) + 4.5
            covariance += 0.5 * np.trace(covariance) * (math.sqrt(square / 9.0) - 1.0) * np.eye(2)
        gain = p[:, 5:] @ np.linalg.inv(covariance)
        return x + gain @ innovation_m, p - gain @ p[5:, :], likelihood

    def learn(self, forgotten, likelihoods):
        score = (likelihoods[1:] - likelihoods[0]) / 0.02
        self.information += score**2 + forgotten * (PRIOR_INFORMATION - self.information)
        change = (score + forgotten * PRIOR_INFORMATION * (PRIOR - self.levels)) / self.information
        self.levels = np.clip(self.levels + np.clip(change, -0.2, 0.2), MIN_LEVELS, MAX_LEVELS)


def sailed(positions=240, seed=4):
    """Yield filter and plain filter after each position of a passage with turns, gaps, jumps and unknown headings."""
    state = begin(0.0, 2.0, -1.0, 0.4, 0.3, 0.05, -0.1, 0.25, 0.02, 0.1)
    plain = PlainFilter((0.0, 0.4, 0.02, 0.05, -0.1, 2.0, -1.0), (0.1, 0.3, 0.1, 0.25, 0.25, 0.3, 0.3))
    rng, t_s, place_m, heading_rad = np.random.default_rng(seed), 0.0, np.array([2.0, -1.0]), 0.5
    for number in range(positions):
        step_s = {60: 29.0, 90: 30.5, 120: 700.0, 239: 1e5}.get(number, float(rng.uniform(4.0, 6.0)))
        heading_rad += 0.02 + 1.5 * (number % 60 == 0)
        known = 0.0 if number in {180, 181, 239} else 0.85 if number == 183 else 0.95 if number == 185 else 1.0
        for part in (0.4, 0.6):
            t_s += part * step_s
            angle_rad = heading_rad + 0.3 * part
            for other in (state, plain):
                if other is state and known:
                    state = take_heading(state, angle_rad, known * part * step_s)
                elif known:
                    plain.take_heading(angle_rad, known * part * step_s)
        speed_m_s = 0.5 + 0.1 * math.sin(number / 7.0)
        place_m = place_m + step_s * (speed_m_s * np.array([math.cos(heading_rad), math.sin(heading_rad)]) + 0.1)
        jump_m = 200.0 if 150 <= number < 162 else 4.0 if number % 9 == 0 else 0.0
        measured_m = place_m + jump_m + 0.4 * rng.standard_normal(2)
        state = correct(state, t_s, *map(float, measured_m))
        plain.correct(t_s, measured_m)
        yield number, state, plain


def test_filter_agrees_with_the_plain_filter():
    for number, state, plain in sailed():
        assert state.t_s == plain.t_s
        assert state.refused_t_s == pytest.approx(plain.refused_t_s, nan_ok=True)
        assert state.means == pytest.approx(np.array(plain.x), rel=1e-6, abs=1e-6)
        if number % 10 == 0 or number > 230:
            scale = np.sqrt(np.einsum("ijj->ij", np.array(plain.p)))
            error = (state.covariances - np.array(plain.p)) / (scale[:, :, None] * scale[:, None, :])
            assert np.abs(error).max() < 1e-5
        assert state.levels == pytest.approx(plain.levels, rel=1e-6)
        assert state.information == pytest.approx(plain.information, rel=1e-5)
    assert plain.restarts == 2
    assert np.abs(plain.levels - PRIOR).max() > 0.3


@pytest.mark.parametrize(("square", "is_used"), [(24.99, True), (25.01, False)])
def test_position_beyond_5_standard_deviations_is_rejected(square, is_used):
    state = take_heading(begin(0.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1), 0.0, 5.0)
    x, p = predict_part(state.means[0], state.covariances[0], PRIOR, 5.0, 1.0, 0.0)
    updated = correct(state, 5.0, float(x[5]), float(x[6]) + math.sqrt(square * (p[6, 6] + 0.3**2 + 9.0)))
    assert math.isnan(updated.refused_t_s) is is_used
    for first_s, is_restart in ((-24.9, False), (-25.0, True)):  # 30 s after the first rejected position
        later = correct(state._replace(refused_t_s=first_s), 5.0, 500.0, 0.0)
        assert (later.t_s == 5.0) is is_restart


@pytest.mark.parametrize(("bounds", "sign"), [(MIN_LEVELS, -1.0), (MAX_LEVELS, 1.0)])
def test_levels_stay_within_their_bounds(bounds, sign):
    levels, information = bounds - 0.001 * sign, np.ones(4)
    water_filter.learn(levels, information, np.array([0.0, *[sign * 9.0] * 4]), 5.0)
    assert levels == pytest.approx(bounds, abs=1e-12)


def test_impossible_positions_and_times_are_ignored():
    state = begin(0.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    for t_s, north_m, east_m in ((4.4, 0.0, 0.0), (math.inf, 0.0, 0.0), (5.0, math.inf, 0.0), (5.0, 0.0, math.nan)):
        assert correct(state, t_s, north_m, east_m) is state
    for heading_rad, step_s in ((math.nan, 1.0), (math.inf, 1.0), (1.0, 0.0), (1.0, -1.0), (1.0, 86400.0)):
        assert take_heading(state, heading_rad, step_s) is state
    assert correct(state, 4.5, 0.0, 0.0).t_s == 4.5
    assert take_heading(state, 1.0, 86399.0).known_s == 86399.0
    assert all(map(math.isnan, water_filter.mean_heading(state, 0.0)))


def test_determinant_of_the_innovation_stays_positive():
    singular = np.zeros((N, N))
    singular[5:, 5:] = 1e8
    square, determinant = water_filter.squared_distance(np.zeros(N), singular, 1.0, 1.0, 0.0)
    assert (square, determinant) == (0.0, 1e-8)


def draw_filter(seed=1):
    """Return a filter with a full covariance at 100 s, its mean and covariance."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, N + 2)) * np.array([[0.1], [0.05], [0.03], [0.06], [0.06], [0.5], [0.5]])
    mean, covariance = np.array([0.05, 0.4, 0.06, 0.2, -0.15, 30.0, -10.0]), 0.2 * root @ root.T
    plain = begin(100.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    return plain._replace(means=np.array([mean] * 5), covariances=np.array([covariance] * 5)), mean, covariance


@pytest.mark.parametrize(("age_s", "step_s"), [(-50.0, 0.0), (0.0, 0.0), (40.0, 40.0), (2e5, 86400.0)])
def test_water_at_a_time_is_that_of_the_model(age_s, step_s):
    state, mean, p = draw_filter()
    mean, p = predict_blind(mean, p, PRIOR, step_s)
    water, (s, u, v, north, east), order = water_at(state, 100.0 + age_s), mean[:5], [3, 4, 1, 2]
    speed = np.array([1.0, 1.0, 0, 0, 0, 0, 0])
    leeway = np.array([0.0, -v, u, 0, 0, 0, 0]) / (u * u + v * v)
    variances = (speed @ p @ speed, p[1, 1], p[2, 2], min(leeway @ p @ leeway, math.pi**2))
    means = (u + s, u, v, math.atan2(v, u))
    assert water[:8:2] == pytest.approx(means, rel=1e-6)
    assert water[1:9:2] == pytest.approx(np.sqrt(variances), rel=1e-6)
    assert water[8:10] == pytest.approx((north, east))
    assert water.current_sd_m_s == pytest.approx(math.sqrt(np.linalg.eigvalsh(p[3:5, 3:5])[1]), rel=1e-6)
    assert water.covariance == pytest.approx(p[np.ix_(order, order)][UPPER], rel=1e-6)


@pytest.mark.parametrize(("u", "v"), [(0.01, 0.0), (0.03, 0.0)])
def test_leeway_of_a_boat_slower_than_0_02_m_s_is_that_at_this_speed(u, v):
    state, mean, p = draw_filter()
    mean[1:3] = u, v
    expected = math.sqrt(u * u * p[2, 2]) / max(u * u, 0.02**2)
    assert water_at(state._replace(means=np.array([mean] * 5)), 100.0).leeway_sd_rad == pytest.approx(
        min(expected, math.pi)
    )
