"""The written-out arithmetic against matrices, and the model against the K-T equation."""

import random

import numpy as np
import pytest

from firmware_py.estimate import kalman
from firmware_py.model.kt import OCEAN_RAMBLER, rk4_step

MODEL = OCEAN_RAMBLER
X = (1.2, 0.01, 0.05, 0.1, -0.2, 0.1, -0.2, 0.7, 1.1)


def packed(matrix):
    return tuple(matrix[i, j] for i in range(9) for j in range(i, 9))


def unpacked(numbers):
    matrix = np.zeros((9, 9))
    for i in range(9):
        for j in range(i, 9):
            matrix[i, j] = matrix[j, i] = numbers[kalman.covariance_index(i, j)]
    return matrix


def covariance(seed=1):
    root = np.random.default_rng(seed).standard_normal((9, 12))
    return root @ root.T / 12.0


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


@pytest.mark.parametrize("step_s", [0.03, 0.1, 1.0])
def test_the_covariance_is_carried_as_matrices_carry_it(step_s):
    p = covariance()
    turn = kalman.turn(X, 0.2, step_s, MODEL)
    wave = kalman.wave_transition(1.1, step_s)
    f = np.eye(9)
    f[0, 1], f[1, 1] = turn.reach_s, turn.by_rate
    f[1, [2, 7, 8]] = turn.by_bias, turn.by_speed, turn.by_factor
    f[0, [2, 7, 8]] = turn.share_s * f[1, [2, 7, 8]]
    f[3:5, 3:5] = np.reshape(wave, (2, 2))
    noise = (0.1, 0.2, 0.3, 0.04, 0.5, 0.6, 0.7, 0.8)
    q = np.diag([0.0, 0.1, 0.2, 0.3, 0.5, 0.6, 0.6, 0.7, 0.8])
    q[3, 4] = q[4, 3] = 0.04
    got = unpacked(kalman.predict(packed(p), turn, wave, noise))
    np.testing.assert_allclose(got, f @ p @ f.T + q, rtol=1e-12, atol=1e-14)


def test_a_measurement_is_corrected_for_as_matrices_do_it():
    p, rng = covariance(2), random.Random(4)
    for _ in range(20):
        h = np.array([rng.gauss(0.0, 1.0) for _ in range(9)])
        shown = p @ h
        variance = float(h @ shown) + 0.3
        x, after = kalman.correct(X, packed(p), tuple(shown), 0.7, variance)
        np.testing.assert_allclose(x, np.array(X) + shown / variance * 0.7, rtol=1e-12)
        np.testing.assert_allclose(unpacked(after), p - np.outer(shown, shown) / variance, rtol=1e-10, atol=1e-14)
        p = unpacked(after)


@pytest.mark.parametrize("omega", [0.5, 1.0, 3.0])
def test_the_wave_process_is_stationary_over_steps_of_any_length(omega):
    spread = 0.2
    power = 4.0 * kalman.DAMPING * omega**3 * spread**2
    for step_s in (0.05, 0.1, 1.0):
        a = np.reshape(kalman.wave_transition(omega, step_s), (2, 2))
        angle, both, rate = kalman.wave_noise(kalman.wave_transition(omega, step_s), omega, power)
        stationary = np.diag([spread**2, spread**2 * omega**2])
        np.testing.assert_allclose(
            a @ stationary @ a.T + np.array([[angle, both], [both, rate]]), stationary, atol=1e-12
        )
        assert np.all(np.linalg.eigvalsh([[angle, both], [both, rate]]) > 0.0)
    # Two half steps are a whole one.
    half = np.reshape(kalman.wave_transition(omega, 0.4), (2, 2))
    np.testing.assert_allclose(half @ half, np.reshape(kalman.wave_transition(omega, 0.8), (2, 2)), atol=1e-12)
