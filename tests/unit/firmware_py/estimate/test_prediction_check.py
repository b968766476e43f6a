"""Prediction check: a consistent filter is not rejected for hours; an over-confident one is, until it is consistent.

Boat and filter have the same model (heading_model.py), so that the filter with the true levels is consistent.
"""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.estimate import heading_model, prediction_check
from firmware_py.estimate.heading_model import STATES, Motion, NoiseLevels
from firmware_py.estimate.prediction_check import PredictionCheck
from firmware_py.model.kt import OCEAN_RAMBLER

ACCEPTANCE_LIMIT = 2.0
STEP_S = 1.0
LEVELS = NoiseLevels(
    math.log(radians(1.0) ** 2), math.log(radians(2.0)), math.log(5.0), math.log(0.2), math.log(radians(0.3)),
    math.log(radians(0.05)),
)  # fmt: skip


class Boat:
    """A boat that moves like the model with LEVELS, and a Kalman filter with the same or other levels."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.truth = Motion()
        self.filter = heading_model.begin(0.0, LEVELS)
        self.check = prediction_check.begin(self.filter, 0.0)
        self.t_s, self.squares = 0.0, []

    def sail(self, hours, levels=LEVELS):
        """Simulate hours, and return the time for which the check rejected the filter [s]."""
        rejected_s = 0.0
        for draws in self.rng.standard_normal((round(3600.0 * hours / STEP_S), STATES + 1)):
            self.t_s += STEP_S
            rudder_rad = radians(10.0) * math.sin(self.t_s / 40.0)
            self.truth = move_truth(self.truth, rudder_rad, draws[:STATES])
            compass_rad = self.truth.heading_rad + self.truth.wave_rad + radians(0.3) * draws[STATES]
            predicted = heading_model.predict(self.filter, levels, OCEAN_RAMBLER, rudder_rad, STEP_S)
            self.filter, _, _ = heading_model.correct(predicted, levels, compass_rad)
            self.check = prediction_check.update(
                self.check, self.filter, levels, OCEAN_RAMBLER, rudder_rad, self.t_s, STEP_S
            )
            self.squares.append(wrap_pi(self.filter.heading_rad - self.truth.heading_rad) ** 2 / self.filter.p00)
            rejected_s += STEP_S * self.check.is_rejected
        return rejected_s


def move_truth(truth, rudder_rad, draws):
    """Return the true state after a step; its covariance is that of the noise, because it starts at 0."""
    predicted = heading_model.predict(truth, LEVELS, OCEAN_RAMBLER, rudder_rad, STEP_S)
    root = np.zeros((STATES, STATES))
    root[np.triu_indices(STATES)] = predicted[STATES:]
    return Motion(*(np.array(predicted[:STATES]) + np.linalg.cholesky(root.T) @ draws))


def with_too_small_diffusion(factor):
    return LEVELS._replace(diffusion=LEVELS.diffusion - math.log(factor))


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(2, 10))])
def test_a_consistent_filter_is_never_rejected(seed):
    boat = Boat(seed)
    assert boat.sail(3.0) == 0.0
    assert 0.8 < np.mean(boat.squares) < 1.2  # the filter is consistent
    assert prediction_check.sd_inflation(boat.check) == 1.0


@pytest.mark.parametrize("factor", [10.0, *(pytest.param(factor, marks=pytest.mark.proof) for factor in (30.0, 100.0))])
def test_filter_with_too_small_diffusion_is_rejected_and_its_deviation_grows(factor):
    boat = Boat(1)
    rejected_s = boat.sail(2.0, with_too_small_diffusion(factor))
    assert np.mean(boat.squares) > 2.0  # the filter is over-confident
    assert rejected_s > 1800.0
    assert prediction_check.sd_inflation(boat.check) > math.sqrt(ACCEPTANCE_LIMIT)


@pytest.mark.parametrize(
    ("square", "before", "count", "was_rejected", "is_rejected"),
    [
        (4.0, 3.0, 14.0, False, False),
        (40.0, 3.0, 14.0, False, True),  # a square counts as at most 25
        (40.0, 2.15625, 16.0, False, False),  # a mean of exactly 3.5
        (3.5, 3.51, 25.0, False, True),
        (3.4, 3.49, 25.0, False, False),
        (2.0, 2.02, 25.0, True, True),
        (1.9, 1.99, 25.0, True, False),
        (9.0, 9.0, 8.0, False, False),
        (9.0, 9.0, 9.0, False, True),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_mean_square_of_the_comparisons_decides_on_the_rejection(
    square, before, count, was_rejected, is_rejected, sign
):
    """A comparison after 30 s; variance: of the prediction, of a compass error of 0.5 deg, of a fifth of the turn."""
    check = PredictionCheck(Motion(0.5, p00=0.004), 70.0, 0.2, before, count, was_rejected)
    for m_variance, variance in ((0.001, 0.003), (0.005, 0.0)):
        variance += radians(0.5) ** 2 + (0.2 * 0.3) ** 2  # noqa: PLW2901
        m = Motion(0.5 + sign * math.sqrt(square * variance), p00=m_variance)
        updated = prediction_check.update(check, m, LEVELS, OCEAN_RAMBLER, 0.0, 100.0, 1e-9)
        number = min(count + 1.0, 20.0)
        mean_square = before + (min(square, 25.0) - before) / number
        assert updated == PredictionCheck(m, 100.0, m.heading_rad, pytest.approx(mean_square), number, is_rejected)
    assert prediction_check.sd_inflation(updated) == (math.sqrt(updated.mean_square) if is_rejected else 1.0)


@pytest.mark.parametrize(
    ("begun_s", "step_s", "begins_again"),
    [(70.1, 29.9, False), (60.0, 30.0, True), (90.0, 0.0, False), (90.0, -1.0, False)],
)
def test_prediction_continues_with_the_rudder_for_half_a_minute(begun_s, step_s, begins_again):
    check, m = PredictionCheck(Motion(0.5, 0.01, p00=0.004), begun_s, 0.2, 2.0, 5.0), Motion(0.6)
    updated = prediction_check.update(check, m, LEVELS, OCEAN_RAMBLER, 0.3, 100.0, step_s)
    if begins_again:
        assert updated == check._replace(motion=m, begun_s=100.0, from_rad=0.6)
    elif step_s <= 0.0:
        assert updated is check
    else:
        expected = heading_model.predict(check.motion, LEVELS, OCEAN_RAMBLER, 0.3, step_s)
        assert updated == check._replace(motion=expected)
    assert prediction_check.begin(m, 3.0) == PredictionCheck(m, 3.0, 0.6, 1.0, 0.0)


def test_gap_starts_another_prediction_and_keeps_the_result():
    check = PredictionCheck(Motion(), 100.0, 0.0, 5.0, 15.0, True)
    motion = Motion(1.0, p00=0.1)
    updated = prediction_check.update(check, motion, LEVELS, OCEAN_RAMBLER, 0.0, 140.0, 40.0)
    assert updated == PredictionCheck(motion, 140.0, 1.0, 5.0, 15.0, True)
    assert prediction_check.update(check, motion, LEVELS, OCEAN_RAMBLER, 0.0, 100.0, 0.0) is check
