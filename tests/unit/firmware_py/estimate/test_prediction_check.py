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
HORIZON_S = 30.0

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


def test_filter_that_is_consistent_again_is_accepted():
    boat = Boat(2)
    assert boat.sail(0.5) == 0.0
    assert boat.sail(1.0, with_too_small_diffusion(100.0)) > 0.0
    assert boat.check.is_rejected
    boat.sail(0.5)
    assert not boat.check.is_rejected
    assert boat.sail(1.0) == 0.0


def with_comparison(check, difference_rad):
    """Return the check after a horizon, at whose end the filter differs from the prediction by difference_rad."""
    motion = check.motion
    for step in range(1, round(HORIZON_S) + 1):
        t_s = check.begun_s + HORIZON_S if step == round(HORIZON_S) else check.begun_s + step
        predicted = heading_model.predict(check.motion, LEVELS, OCEAN_RAMBLER, 0.0, 1.0)
        motion = Motion(predicted.heading_rad + difference_rad, p00=radians(1.0) ** 2)
        check = prediction_check.update(check, motion, LEVELS, OCEAN_RAMBLER, 0.0, t_s, 1.0)
        if check.begun_s == t_s:
            break
    return check


def test_a_single_error_or_few_comparisons_do_not_reject_the_filter():
    check = prediction_check.begin(Motion(p00=radians(1.0) ** 2), 0.0)
    for number in range(9):
        check = with_comparison(check, radians(120.0))
        assert check.comparisons == number + 1.0
        assert not check.is_rejected
    assert with_comparison(check, radians(120.0)).is_rejected
    check = prediction_check.begin(Motion(p00=radians(1.0) ** 2), 0.0)
    for _ in range(20):
        check = with_comparison(check, 0.0)
    assert not with_comparison(check, radians(120.0)).is_rejected


@pytest.mark.parametrize(("turn_deg", "is_rejected"), [(45.0, False), (0.0, True)])
def test_error_of_a_fifth_of_a_turn_does_not_reject_the_filter(turn_deg, is_rejected):
    check, m = prediction_check.begin(Motion(), 0.0), Motion()
    for number in range(1, 21):
        check = check._replace(motion=Motion(radians(9.0)), from_rad=radians(9.0 - turn_deg))
        check = prediction_check.update(check, m, LEVELS, OCEAN_RAMBLER, 0.0, number * HORIZON_S, 1e-3)
    assert check.is_rejected is is_rejected


def test_gap_starts_another_prediction_and_keeps_the_result():
    check = PredictionCheck(Motion(), 100.0, 0.0, 5.0, 15.0, True)
    motion = Motion(1.0, p00=0.1)
    updated = prediction_check.update(check, motion, LEVELS, OCEAN_RAMBLER, 0.0, 140.0, 40.0)
    assert updated == PredictionCheck(motion, 140.0, 1.0, 5.0, 15.0, True)
    assert prediction_check.update(check, motion, LEVELS, OCEAN_RAMBLER, 0.0, 100.0, 0.0) is check
