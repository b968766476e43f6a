"""Water filter and its results, compared with matrix exponentials, Kalman filter and numerical derivatives."""

import math
from functools import cache

import numpy as np
import pytest

from firmware_py.estimate import water_filter
from firmware_py.estimate.water_filter import Water, begin, correct, take_heading, water_at
from firmware_py.estimate.water_results import (
    CurrentVerdict,
    DeadReckoning,
    advance_dead_reckoning,
    begin_dead_reckoning,
    current_excess,
    dead_reckoning_sd,
    heading_from_track,
    judge_current,
    over_ground,
)
from support.heading_recording import discretize

N, UPPER = 7, np.triu_indices(4)
MEMORY_S = 30.0  # of the speed deviation
# Speed deviation [m/s], walk of the current [m/s/sqrt(s)], drift [m/sqrt(s)] and noise of the position [m].
PRIOR = np.log([0.1, 0.0004, 0.15, 0.3])
PRIOR_INFORMATION = np.array([0.7, 0.7, 1.0, 1.0]) ** -2.0
MIN_LEVELS, MAX_LEVELS = np.log([0.01, 0.0001, 0.001, 0.02]), np.log([0.5, 0.005, 1.0, 20.0])


@cache
def discrete_model(step_s, cosine, sine):
    """Return transition and noise covariance of a step with sigma = 1 and no other noise."""
    rates, noise = np.zeros((N, N)), np.zeros((N, N))
    rates[0, 0], noise[0, 0] = -1.0 / MEMORY_S, 2.0 / MEMORY_S
    rates[5, :5], rates[6, :5] = (cosine, cosine, -sine, 1.0, 0.0), (sine, sine, cosine, 0.0, 1.0)
    return discretize(rates, noise, step_s)


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
        step_s = {60: 29.0, 90: 31.0, 120: 700.0, 239: 1e5}.get(number, float(rng.uniform(4.0, 6.0)))
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


@pytest.mark.parametrize(("square", "is_used"), [(24.5, True), (25.5, False)])
def test_position_beyond_5_standard_deviations_is_rejected(square, is_used):
    state = take_heading(begin(0.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1), 0.0, 5.0)
    x, p = predict_part(state.means[0], state.covariances[0], PRIOR, 5.0, 1.0, 0.0)
    updated = correct(state, 5.0, float(x[5]), float(x[6]) + math.sqrt(square * (p[6, 6] + 0.3**2 + 9.0)))
    assert math.isnan(updated.refused_t_s) is is_used


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
    assert take_heading(state, 1.0, 86399.0).known_s == 86399.0


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


def water_of(north, east, u, v, p, s=0.05):
    """Return an estimate with this current, speed, sideways speed and covariance (4, 4)."""
    return Water(u + s, 0.0, u, 0.0, v, 0.0, 0.0, 0.0, north, east, 0.0, tuple(map(float, p[UPPER])))


def slopes(function, values):
    """Return the derivatives of a function of several numbers."""
    steps = 1e-6 * np.eye(len(values))
    return np.array([(function(*(values + step)) - function(*(values - step))) / 2e-6 for step in steps])


def draw_covariance(seed=2):
    root = 0.05 * np.random.default_rng(seed).standard_normal((4, 6))
    return root @ root.T


@pytest.mark.parametrize("values", [(0.3, -0.2, 0.4, 0.1), (-0.5, 0.1, 0.2, -0.05)])
def test_excess_of_the_current_has_the_variance_of_its_derivatives(values):
    p = draw_covariance()
    gradient = slopes(lambda n, e, u, v: math.hypot(n, e) - math.hypot(u, v), np.array(values))
    excess_m_s, sd_m_s = current_excess(water_of(*values, p))
    assert excess_m_s == pytest.approx(math.hypot(*values[:2]) - math.hypot(*values[2:]))
    assert sd_m_s == pytest.approx(math.sqrt(gradient @ p @ gradient), rel=1e-6)
    # Without current and speed the direction is not defined, and the derivatives are limited.
    assert current_excess(water_of(0.0, 0.01, 0.0, 0.01, p))[1] == pytest.approx(
        math.sqrt(0.25 * (p[1, 1] + p[3, 3] - 2.0 * p[1, 3]))
    )


def test_velocity_over_ground_is_the_sum_of_speed_leeway_and_current():
    water, cosine, sine = water_of(0.1, -0.2, 0.4, 0.06, np.eye(4)), math.cos(2.0), math.sin(2.0)
    expected = (0.1 + 0.45 * cosine - 0.06 * sine, -0.2 + 0.45 * sine + 0.06 * cosine)
    assert over_ground(water, 2.0) == pytest.approx(expected)
    assert over_ground(water, math.nan) == (0.1, -0.2)


TURNED, NOT_TURNED = CurrentVerdict(98.0, 118.0, 0.0, 1.0, 0.0, 1.0), CurrentVerdict(98.0, 118.0, 0.0, 1.0, 0.0, 0.0)
STRONG = CurrentVerdict(98.0, 118.0, 1.0, 1.0, 0.0, 1.0)


def judged(verdict=TURNED, age_s=0.0, heading=0.0, excess_sds=2.4, north=-1.0):
    """Return the verdict at 100 s + age_s; the boat has sailed on one heading at 0.5 m/s since the last position."""
    state = begin(100.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)._replace(known_s=150.0)
    state = state._replace(cosine_s=150.0 * math.cos(heading), sine_s=150.0 * math.sin(heading))
    sd_m_s = 0.5 / abs(excess_sds)
    current_m_s = 0.5 + math.copysign(0.5, excess_sds)
    p = np.diag([sd_m_s**2, 0.0, 0.0, 0.0])
    return judge_current(verdict, state, water_of(north * current_m_s, 0.0, 0.5, 0.0, p), 100.0 + age_s)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, (100.0, 0.0, 1.0, 1.0, 0.0, 1.0)),
        ({"excess_sds": 2.3}, (100.0, 0.0, 0.0, 1.0, 0.0, 1.0)),
        ({"verdict": NOT_TURNED}, (100.0, 0.0, 1.0, 1.0, 0.0, 0.0)),  # against the heading
        ({"verdict": NOT_TURNED, "north": 1.0}, (100.0, 0.0, 0.0, 1.0, 0.0, 0.0)),
        ({"verdict": NOT_TURNED, "north": 1.0, "heading": 0.55}, (100.0, 0.0, 0.0, 1.0, 0.0, 0.0)),
        ({"verdict": NOT_TURNED, "north": 1.0, "heading": -0.56}, (100.0, 0.0, 1.0, 1.0, 0.0, 1.0)),
        ({"verdict": STRONG}, (100.0, 0.0, 1.0, 1.0, 0.0, 1.0)),
        ({"verdict": STRONG, "excess_sds": -0.1}, (100.0, 0.0, 0.0, 1.0, 0.0, 1.0)),
        ({"verdict": NOT_TURNED._replace(against_s=117.9)}, (100.0, 119.9, 0.0, 1.0, 0.0, 0.0)),
        ({"verdict": NOT_TURNED._replace(t_s=101.0)}, (100.0, 118.0, 0.0, 1.0, 0.0, 0.0)),
        ({"verdict": CurrentVerdict(), "heading": -0.5}, (100.0, 0.0, 0.0, math.cos(0.5), -math.sin(0.5), 0.0)),
        ({"age_s": 120.0, "excess_sds": 1.0}, (220.0, 0.0, 0.0, 1.0, 0.0, 1.0)),
        ({"age_s": 120.1}, (math.nan, 0.0, 0.0, 1.0, 0.0, 1.0)),
        ({"age_s": -0.1}, (math.nan, 0.0, 0.0, 1.0, 0.0, 1.0)),
    ],
)
def test_verdict_needs_an_observable_excess_of_2_33_standard_deviations_for_2_min(options, expected):
    assert tuple(judged(**options)) == pytest.approx(expected, nan_ok=True)


def test_dead_reckoning_has_the_variance_of_all_its_errors():
    state, mean, _ = draw_filter()
    started = begin_dead_reckoning(state, 130.0)
    assert started[:4] == pytest.approx((*mean[3:5], *mean[1:3]))
    assert started.covariance == water_at(state, 130.0).covariance
    assert started[5:] == pytest.approx((0.0004**2, 2.0 * 0.1**2 * MEMORY_S + 0.15**2, 0.0, 0.0, 0.0))
    on_way, north_m_s, east_m_s = advance_dead_reckoning(started, 0.8, 300.0)
    _, _, u, v = started[:4]
    assert north_m_s == pytest.approx(mean[3] + u * math.cos(0.8) - v * math.sin(0.8))
    assert east_m_s == pytest.approx(mean[4] + u * math.sin(0.8) + v * math.cos(0.8))
    on_way, *drift_m_s = advance_dead_reckoning(on_way, math.nan, 40.0)
    assert drift_m_s == pytest.approx(mean[3:5])
    a, b, blind_m, t = 300.0 * math.cos(0.8), 300.0 * math.sin(0.8), 40.0 * math.hypot(u, v), 340.0
    assert on_way[:7] == started[:7]
    assert on_way[7:] == pytest.approx((a, b, blind_m))
    p, jacobian = np.zeros((4, 4)), np.array([[t, 0.0, a, -b], [0.0, t, b, a]])
    p[UPPER] = started.covariance
    p += np.triu(p, 1).T
    variance = np.linalg.eigvalsh(jacobian @ p @ jacobian.T)[1] + started.way_m2_s * t + 5.0**2 + blind_m**2
    variance += (0.0004**2 * t**2 + 0.001**2 * (a * a + b * b)) * t / 3.0
    phase = 2.0 * math.pi * t / (12.42 * 3600.0)
    tide_m = np.hypot(*mean[3:5]) * t / phase * math.hypot(phase - math.sin(phase), 1.0 - math.cos(phase))
    assert dead_reckoning_sd(on_way, t) == pytest.approx(math.sqrt(variance + 0.5 * tide_m**2), rel=1e-4)
    assert dead_reckoning_sd(started, 1e6) == dead_reckoning_sd(started, 86400.0)
    assert dead_reckoning_sd(started, -1.0) == 5.0
    without_record = dead_reckoning_sd(DeadReckoning(), 1000.0)  # 0.3 m/s of current
    assert without_record == pytest.approx(math.hypot(300.0, 5.0), rel=1e-6)


def track_along(seed, excess_sds, duration_s=20.0):
    """Return filter and track whose speed exceeds the estimate by some standard deviations, and the results."""
    state, mean, p = draw_filter(seed)
    order, values = [3, 4, 1, 2], mean[[3, 4, 1, 2]]
    p = p[np.ix_(order, order)]
    noise = (2.0 * 0.3**2 / duration_s + 0.15**2) / duration_s
    direction = np.array([math.cos(2.2), math.sin(2.2)])

    def speeds(n, e, u, v, way):
        return math.hypot(way[0] - n, way[1] - e) - math.hypot(u, v)

    def heading(n, e, u, v, way):
        return math.atan2(way[1] - e, way[0] - n) - math.atan2(v, u)

    def way_at(excess_m_s):
        return values[:2] + (math.hypot(*values[2:]) + excess_m_s) * direction

    gradient = slopes(lambda *x: speeds(*x, way_at(0.0)), values)
    excess_m_s = excess_sds * math.sqrt(gradient @ p @ gradient + noise + 0.1**2)
    way = way_at(excess_m_s)
    gradient = slopes(lambda *x: heading(*x, way), values)
    sd_rad = math.sqrt(gradient @ p @ gradient + noise / (math.hypot(*values[2:]) + excess_m_s) ** 2)
    return (state, 100.0, *map(float, way * duration_s), duration_s), (heading(*values, way), sd_rad)


@pytest.mark.parametrize("excess_sds", [0.0, 2.0, -1.0, 2.9])
def test_heading_from_the_track_has_the_variance_of_its_derivatives(excess_sds):
    track, expected = track_along(5, excess_sds)
    assert heading_from_track(*track) == pytest.approx(expected, rel=1e-5)


def test_track_with_another_speed_gives_no_heading():
    track, _ = track_along(5, 3.1)
    assert all(map(math.isnan, heading_from_track(*track)))


@pytest.mark.parametrize(
    ("speed_m_s", "north_m", "east_m", "duration_s", "is_known"),
    [
        (0.5, 10.0, 0.0, 20.0, True),
        (0.5, math.inf, 0.0, 20.0, False),
        (0.5, 0.0, math.inf, 20.0, False),
        (0.5, math.nan, 0.0, 20.0, False),
        (0.5, 10.0, 0.0, 0.0, False),
        (0.5, 10.0, 0.0, -20.0, False),
        (0.021, 0.42, 0.0, 20.0, True),
        (0.019, 0.42, 0.0, 20.0, False),
        (0.021, 0.38, 0.0, 20.0, False),
    ],
)
def test_track_needs_a_duration_and_speeds_of_2_cm_s(speed_m_s, north_m, east_m, duration_s, is_known):
    state = begin(100.0, 0.0, 0.0, speed_m_s, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    results = heading_from_track(state, 100.0, north_m, east_m, duration_s)
    assert [math.isnan(result) for result in results] == [not is_known] * 2
