"""Results of the water filter, compared with numerical derivatives and a table of the verdict on the current."""

import math

import numpy as np
import pytest

from firmware_py.estimate.water_filter import Water, begin, water_at
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

# `begin`: time, position [m], speed and its standard deviation, current north and east and its standard deviation,
# sideways speed and its standard deviation [m/s].
N, UPPER = 7, np.triu_indices(4)
MEMORY_S = 30.0  # of the speed deviation


def draw_filter(seed=1):
    """Return a filter with a full covariance at 100 s, its mean and covariance."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((N, N + 2)) * np.array([[0.1], [0.05], [0.03], [0.06], [0.06], [0.5], [0.5]])
    mean, covariance = np.array([0.05, 0.4, 0.06, 0.2, -0.15, 30.0, -10.0]), 0.2 * root @ root.T
    plain = begin(100.0, 0.0, 0.0, 0.4, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    return plain._replace(means=np.array([mean] * 5), covariances=np.array([covariance] * 5)), mean, covariance


def water_of(north, east, u, v, p, s=0.05):
    """Return an estimate with this current, speed, sideways speed and covariance (4, 4)."""
    return Water(u + s, 0.0, u, 0.0, v, 0.0, 0.0, 0.0, north, east, 0.0, tuple(map(float, p[UPPER])))


def derivatives(function, values):
    """Return the derivatives of a function of several numbers."""
    steps = 1e-6 * np.eye(len(values))
    return np.array([(function(*(values + step)) - function(*(values - step))) / 2e-6 for step in steps])


def draw_covariance(seed=2):
    root = 0.05 * np.random.default_rng(seed).standard_normal((4, 6))
    return root @ root.T


@pytest.mark.parametrize("values", [(0.3, -0.2, 0.4, 0.1), (-0.5, 0.1, 0.2, -0.05)])
def test_excess_of_the_current_has_the_variance_of_its_derivatives(values):
    p = draw_covariance()
    gradient = derivatives(lambda n, e, u, v: math.hypot(n, e) - math.hypot(u, v), np.array(values))
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


def verdict_at(verdict=TURNED, age_s=0.0, heading=0.0, excess_sds=2.4, north=-1.0):
    """Return the verdict at 100 s + age_s; the boat has sailed on one heading [rad] at 0.5 m/s since the last position.

    `north`: direction of the current, 1 north or -1 south.
    """
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
    assert tuple(verdict_at(**options)) == pytest.approx(expected, nan_ok=True)


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
    # A stored record without a covariance: 0.3 m/s for current and speed, 0.1 m/s for the sideways speed.
    assert DeadReckoning().covariance == pytest.approx(np.diag([0.3**2, 0.3**2, 0.3**2, 0.1**2])[UPPER])


def track_along(seed, excess_sds, duration_s=20.0):
    """Return filter and track whose speed exceeds the estimate by some standard deviations, and the results."""
    state, mean, p = draw_filter(seed)
    order, values = [3, 4, 1, 2], mean[[3, 4, 1, 2]]
    p = p[np.ix_(order, order)]
    noise = (2.0 * 0.3**2 / duration_s + 0.15**2) / duration_s
    direction = np.array([math.cos(2.2), math.sin(2.2)])

    def speeds(n, e, u, v, velocity_m_s):
        return math.hypot(velocity_m_s[0] - n, velocity_m_s[1] - e) - math.hypot(u, v)

    def heading(n, e, u, v, velocity_m_s):
        return math.atan2(velocity_m_s[1] - e, velocity_m_s[0] - n) - math.atan2(v, u)

    def velocity_at(excess_m_s):
        return values[:2] + (math.hypot(*values[2:]) + excess_m_s) * direction

    gradient = derivatives(lambda *x: speeds(*x, velocity_at(0.0)), values)
    excess_m_s = excess_sds * math.sqrt(gradient @ p @ gradient + noise + 0.1**2)
    velocity_m_s = velocity_at(excess_m_s)
    gradient = derivatives(lambda *x: heading(*x, velocity_m_s), values)
    sd_rad = math.sqrt(gradient @ p @ gradient + noise / (math.hypot(*values[2:]) + excess_m_s) ** 2)
    return (state, 100.0, *map(float, velocity_m_s * duration_s), duration_s), (heading(*values, velocity_m_s), sd_rad)


@pytest.mark.parametrize("excess_sds", [0.0, 2.0, -1.0, 2.999])
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_heading_from_the_track_has_the_variance_of_its_derivatives(seed, excess_sds):
    track, expected = track_along(seed, excess_sds)
    assert heading_from_track(*track) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_track_with_another_speed_gives_no_heading(seed):
    track, _ = track_along(seed, 3.001)
    assert all(map(math.isnan, heading_from_track(*track)))


@pytest.mark.parametrize(
    ("speed_m_s", "north_m", "east_m", "duration_s", "is_known"),
    [
        (0.5, 10.0, 0.0, 20.0, True),
        (0.5, 0.25, 0.0, 0.5, True),
        (0.5, math.inf, 0.0, 20.0, False),
        (0.5, 0.0, math.inf, 20.0, False),
        (0.5, math.nan, 0.0, 20.0, False),
        (0.5, 10.0, 0.0, 0.0, False),
        (0.5, 10.0, 0.0, -20.0, False),
        (0.021, 0.42, 0.0, 20.0, True),
        (0.02, 0.42, 0.0, 20.0, False),
        (0.021, 0.4, 0.0, 20.0, False),
    ],
)
def test_track_needs_a_duration_and_speeds_of_2_cm_s(speed_m_s, north_m, east_m, duration_s, is_known):
    state = begin(100.0, 0.0, 0.0, speed_m_s, 0.3, 0.0, 0.0, 0.3, 0.0, 0.1)
    results = heading_from_track(state, 100.0, north_m, east_m, duration_s)
    assert [math.isnan(result) for result in results] == [not is_known] * 2
