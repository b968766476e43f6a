"""The written-out arithmetic against matrices, and the model against the K-T equation."""

import math
import random

import numpy as np
import pytest

from firmware_py.estimate import kalman
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

MODEL = OCEAN_RAMBLER
N = kalman.STATES
X = (1.2, 0.01, 0.05, 1.1, 0.02, 0.1, -0.2, 0.7, 1.1, 0.1, 0.5, 0.03, 0.1, -0.2, 0.3, 0.1, -0.2, 0.4)


def covariance(seed=1):
    root = np.random.default_rng(seed).standard_normal((N, N + 3))
    return root @ root.T / (N + 3)


def transition_of(x, rudder_rad, step_s):
    return kalman.Transition(
        kalman.turn(x, rudder_rad, step_s, MODEL),
        kalman.response(0.4, kalman.FLOAT_DAMPING, step_s),
        kalman.response(1.1, kalman.DAMPING, step_s),
        math.exp(-step_s / kalman.BIAS_MEMORY_S),
    )


def derivative(x, index, change, rudder_rad, step_s):
    """The new heading and yaw rate by a state, by central differences."""
    ends = []
    for sign in (1.0, -1.0):
        moved = list(x)
        moved[index] += sign * change
        turn = kalman.turn(tuple(moved), rudder_rad, step_s, MODEL)
        ends.append((turn.heading_rad, turn.yaw_rate_rad_s))
    return [(high - low) / (2.0 * change) for high, low in zip(*ends, strict=True)]


@pytest.mark.parametrize("step_s", [0.02, 0.1, 0.5])
@pytest.mark.parametrize("rudder_rad", [-0.4, 0.0, 0.3])
def test_the_derivatives_are_those_of_the_model(rudder_rad, step_s):
    turn = kalman.turn(X, rudder_rad, step_s, MODEL)
    by_heading = {
        kalman.RATE: (turn.reach_s, turn.by_rate),
        kalman.BIAS: (turn.share_s * turn.by_bias, turn.by_bias),
        kalman.SPEED: (turn.share_s * turn.by_speed, turn.by_speed),
        kalman.FACTOR: (turn.share_s * turn.by_factor, turn.by_factor),
    }
    for index, (heading, rate) in by_heading.items():
        expected = derivative(X, index, 1e-6, rudder_rad, step_s)
        # The derivative by the speed is of the first order in the step: it only has to point the right way well.
        near = 0.15 if index == kalman.SPEED else 0.01
        assert rate == pytest.approx(expected[1], rel=near, abs=1e-6)
        assert heading == pytest.approx(expected[0], rel=0.6, abs=2e-4 * step_s)


def test_it_turns_as_the_equation_does():
    x, heading, rate = X, X[0], X[1]
    ratio = X[kalman.SPEED] / 0.4
    for _ in range(200):
        turn = kalman.turn(x, 0.3, 0.05, MODEL)
        x = (turn.heading_rad, turn.yaw_rate_rad_s, *x[2:])
        heading, rate = rk4_step(
            heading, rate, 0.3, 0.05, 0.049 * ratio * X[kalman.FACTOR], 4.0 / ratio, 17.0 / ratio**2, X[2]
        )
    assert x[0] == pytest.approx(heading, abs=2e-3)
    assert x[1] == pytest.approx(rate, rel=1e-3)


def derivative_of(transition):
    """Return the derivative of a step as a matrix."""
    return kalman.carry(np.eye(N, kalman.COLUMNS), kalman.derivative(transition))[:, :N]


@pytest.mark.parametrize("step_s", [0.03, 0.1, 1.0])
def test_the_columns_are_carried_as_the_states_are(step_s):
    """By central differences, but for the derivatives of the turn itself, which are judged above."""
    transition = transition_of(X, 0.2, step_s)
    turn, f = transition.turn, derivative_of(transition)
    for column in set(range(N)) - {kalman.RATE, kalman.BIAS, kalman.SPEED, kalman.FACTOR}:
        ends = []
        for sign in (1.0, -1.0):
            moved = list(X)
            moved[column] += sign * 1e-4
            ends.append(np.array(kalman.advance(tuple(moved), transition_of(tuple(moved), 0.2, step_s))))
        np.testing.assert_allclose(f[:, column], (ends[0] - ends[1]) / 2e-4, atol=1e-9)
    for column, by_rate in ((1, turn.by_rate), (2, turn.by_bias), (7, turn.by_speed), (8, turn.by_factor)):
        by_heading = turn.reach_s if column == kalman.RATE else turn.share_s * by_rate
        assert f[kalman.HEADING, column] == pytest.approx(by_heading)
        assert f[kalman.RATE, column] == pytest.approx(by_rate)
        # The float sees the glider through the middle of its way.
        np.testing.assert_allclose(
            f[kalman.FLOAT : kalman.NORTH, column],
            0.5 * by_heading * f[kalman.FLOAT : kalman.NORTH, kalman.HEADING], atol=1e-15,
        )  # fmt: skip


@pytest.mark.parametrize("step_s", [0.03, 0.1, 1.0])
def test_the_covariance_is_carried_as_matrices_carry_it(step_s):
    p, slopes = covariance(), np.random.default_rng(3).standard_normal((N, 2))
    transition = transition_of(X, 0.2, step_s)
    f = derivative_of(transition)
    noise = np.linspace(0.1, 1.1, kalman.WAVE)
    motions = ((0.3, 0.04, 0.5), (0.6, -0.1, 0.7), (0.8, 0.2, 0.9))
    q = np.diag([*noise, *(gain for angle, _, rate in motions for gain in (angle, rate))])
    for place, (_, both, _) in zip(range(kalman.WAVE, N, 2), motions, strict=True):
        q[place, place + 1] = q[place + 1, place] = both
    after = kalman.predict(np.concatenate((p, slopes), 1), transition, tuple(noise), motions)
    after, carried = after[:, :N], after[:, N:]
    np.testing.assert_allclose(after, f @ p @ f.T + q, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(carried, f @ slopes, rtol=1e-12, atol=1e-13)
    assert np.array_equal(after, after.T)


def test_the_rudder_bias_forgets_its_way_back_to_its_mean():
    x = X
    for _ in range(500):
        x = kalman.advance(x, transition_of(x, 0.2, 0.1))
    left = (x[kalman.BIAS] - x[kalman.BIAS_MEAN]) / (X[kalman.BIAS] - X[kalman.BIAS_MEAN])
    assert left == pytest.approx(math.exp(-50.0 / kalman.BIAS_MEMORY_S))
    assert x[kalman.BIAS_MEAN] == X[kalman.BIAS_MEAN]
    # Noise of 0.08 deg^2/s, learned as such, is a spread of 2 deg for ever.
    keep, variance = math.exp(-0.1 / kalman.BIAS_MEMORY_S), 0.0
    for _ in range(10000):
        variance = keep * keep * variance + 0.1 * 0.08
    assert math.sqrt(variance) == pytest.approx(2.0, rel=1e-3)


def test_the_sums_have_one_order_on_every_machine():
    """A library may add in any order: what is carried must be the plain sum from left to right, to the last bit."""
    p = covariance(5)
    transition = transition_of(X, 0.2, 0.1)
    by, f = kalman.derivative(transition), derivative_of(transition)
    turning = by[0][..., 0].T
    after = kalman.carry(np.concatenate((p, p[:, :2]), 1), by)[:, :N]
    middles = []
    for column in range(N):
        for row in range(4):
            total = turning[row, 0] * p[0, column]
            for number, place in enumerate((1, 2, 7, 8, 11), 1):
                total += turning[row, number] * p[place, column]
            if row < kalman.FLOAT:
                assert after[row, column] == total
        middles.append(total)
    for column, middle in enumerate(middles):
        behind, rate = p[kalman.FLOAT, column] - middle, p[kalman.FLOAT_RATE, column]
        by = transition.follow
        assert after[kalman.FLOAT, column] == by[0] * behind + by[1] * rate + middle
        assert after[kalman.FLOAT_RATE, column] == by[2] * behind + by[3] * rate
    for row in range(kalman.WAVE, N):
        first = row - (row - kalman.WAVE) % 2
        for column in range(N):
            assert after[row, column] == f[row, first] * p[first, column] + f[row, first + 1] * p[first + 1, column]


def test_a_measurement_is_corrected_for_as_matrices_do_it():
    p, rng = covariance(2), random.Random(4)
    p, slopes = 0.5 * (p + p.T), np.random.default_rng(3).standard_normal((N, 2))
    for _ in range(20):
        h = np.array([rng.gauss(0.0, 1.0) for _ in range(N)])
        shown, slope = p @ h, h @ slopes
        variance = float(h @ shown) + 0.3
        measured = kalman.Measured(np.concatenate((shown, slope)), variance)
        x, after = kalman.correct(X, np.concatenate((p, slopes), 1), measured, 0.7, variance)
        after, left = after[:, :N], after[:, N:]
        np.testing.assert_allclose(x, np.array(X) + shown / variance * 0.7, rtol=1e-12)
        np.testing.assert_allclose(after, p - np.outer(shown, shown) / variance, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(left, slopes - np.outer(shown, slope) / variance, rtol=1e-10, atol=1e-12)
        assert np.array_equal(after, after.T)
        p, slopes = after, left


@pytest.mark.parametrize("omega", [0.5, 1.0, 3.0])
def test_the_wave_process_is_stationary_over_steps_of_any_length(omega):
    spread = 0.2
    power = 4.0 * kalman.DAMPING * omega**3 * spread**2
    for step_s in (0.05, 0.1, 1.0):
        a = np.reshape(kalman.response(omega, kalman.DAMPING, step_s), (2, 2))
        angle, both, rate = kalman.wave_noise(kalman.response(omega, kalman.DAMPING, step_s), omega, power)
        stationary = np.diag([spread**2, spread**2 * omega**2])
        np.testing.assert_allclose(
            a @ stationary @ a.T + np.array([[angle, both], [both, rate]]), stationary, atol=1e-12
        )
        assert np.all(np.linalg.eigvalsh([[angle, both], [both, rate]]) > 0.0)
    # Two half steps are a whole one.
    half = np.reshape(kalman.response(omega, kalman.DAMPING, 0.4), (2, 2))
    np.testing.assert_allclose(half @ half, np.reshape(kalman.response(omega, kalman.DAMPING, 0.8), (2, 2)), atol=1e-12)
