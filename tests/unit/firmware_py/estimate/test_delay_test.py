"""Delay test on boats that differ only in the delay of the rudder; the filter has the true model."""

import math

import numpy as np
import pytest

from firmware_py.common.angles import radians
from firmware_py.estimate import delay_test, heading_filter, heading_model
from firmware_py.estimate.delay_test import DelayTest
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.model.kt import OCEAN_RAMBLER

STEP_S, GAIN = 0.5, 1.5
LEVELS = NoiseLevels(
    math.log(radians(1.0) ** 2), math.log(radians(2.0)), math.log(5.0), math.log(0.2), math.log(radians(0.3)),
    math.log(radians(0.05)),
)  # fmt: skip


class Boat:
    """A boat that a proportional controller steers north, and its filter with the true noise levels."""

    def __init__(self, delay_s, seed):
        self.rng, self.truth = np.random.default_rng(seed), Motion()
        self.delayed_rad = [0.0] * round(delay_s / STEP_S)
        self.filter = heading_filter.begin(0.0, 0.0)._replace(begun_s=-heading_filter.CANDIDATE_PHASE_S, levels=LEVELS)
        self.test, self.t_s, self.log_ratio_sum = DelayTest(self.filter.motion), 0.0, 0.0

    def sail(self, seconds, is_measured=True):
        """Simulate a time and return the sum of the log-likelihood ratios."""
        for draws in self.rng.standard_normal((round(seconds / STEP_S), 2)):
            self.t_s += STEP_S
            rudder_rad = -GAIN * self.filter.motion.heading_rad
            self.delayed_rad.append(rudder_rad)
            heading_rad, rate_rad_s = heading_model.extrapolate(
                self.truth, OCEAN_RAMBLER, self.delayed_rad.pop(0), STEP_S
            )
            heading_rad += radians(math.sqrt(STEP_S)) * draws[0]
            self.truth = self.truth._replace(heading_rad=heading_rad, yaw_rate_rad_s=rate_rad_s)
            compass_rad = heading_rad + radians(0.3) * draws[1]
            angle_rad, previous = rudder_rad if is_measured else math.nan, self.filter
            self.filter = heading_filter.update(previous, OCEAN_RAMBLER, self.t_s, compass_rad, angle_rad)
            self.filter = self.filter._replace(levels=LEVELS)
            self.test = delay_test.begin_tick(self.test)
            self.test = delay_test.update(self.test, previous, self.filter, OCEAN_RAMBLER, angle_rad, compass_rad)
            self.log_ratio_sum += self.test.log_ratio
        return self.log_ratio_sum


@pytest.mark.parametrize("seed", range(1, 4))
def test_delay_is_detected_without_a_commanded_turn(seed):
    assert Boat(12.0, seed).sail(1500.0) > 25.0
    assert Boat(0.0, seed).sail(600.0) < 0.0


def test_ratio_is_zero_without_a_measured_rudder():
    boat = Boat(12.0, 1)
    assert boat.sail(300.0, is_measured=False) == 0.0
    assert boat.test.motion == boat.filter.motion


def test_ratio_does_not_change_in_the_first_minute_or_after_a_restart():
    boat = Boat(12.0, 1)
    boat.sail(60.0)
    restarted = heading_filter.begin(boat.t_s + 700.0, 1.0)
    test = delay_test.update(boat.test, boat.filter, restarted, OCEAN_RAMBLER, 0.1, 1.0)
    assert (test.motion, test.log_ratio) == (restarted.motion, boat.test.log_ratio)
    young = boat.filter._replace(begun_s=boat.t_s - 1.0)
    test = delay_test.update(boat.test, young, young._replace(t_s=boat.t_s + 1.0), OCEAN_RAMBLER, 0.1, 1.0)
    assert (test.motion, test.log_ratio) == (young.motion, boat.test.log_ratio)


@pytest.mark.parametrize("rudder_rad", [math.nan, math.inf, 1e300])
def test_first_heading_and_impossible_rudder_keep_the_state_finite(rudder_rad):
    first = heading_filter.begin(1.0, 2.0)
    test = delay_test.update(DelayTest(), heading_filter.not_started(), first, OCEAN_RAMBLER, rudder_rad, 2.0)
    assert test == delay_test.with_motion(DelayTest(), first.motion)


@pytest.mark.parametrize(
    ("age_s", "rudder_rad", "is_compared"),
    [(60.0, 0.3, True), (59.9, 0.3, False), (600.0, math.pi, True), (600.0, 3.15, False), (600.0, -3.15, False)],
)
def test_rudder_passes_three_lags_of_4_s_before_it_turns_the_delayed_filter(age_s, rudder_rad, is_compared):
    previous = heading_filter.begin(100.0, 1.0)._replace(levels=LEVELS, begun_s=101.0 - age_s)
    updated = heading_filter.update(previous, OCEAN_RAMBLER, 101.0, 1.01, rudder_rad)
    motion = previous.motion._replace(heading_rad=0.5, yaw_rate_rad_s=0.02)
    test = DelayTest(motion, 0.1, -0.2, 0.25, 3.0)
    result = delay_test.update(test, previous, updated, OCEAN_RAMBLER, rudder_rad, 1.01)
    decay, lags = math.exp(-1.0 / 4.0), (0.1, -0.2, 0.25)
    if abs(rudder_rad) > math.pi:
        assert result == test._replace(motion=updated.motion)
        return
    inputs = (rudder_rad, 0.1, -0.2)
    expected = [source + decay * (lag - source) for source, lag in zip(inputs, lags, strict=True)]
    assert result[1:4] == pytest.approx(expected)
    assert delay_test.begin_tick(result) == result._replace(log_ratio=0.0)
    predicted = heading_model.predict(motion, LEVELS, OCEAN_RAMBLER, expected[2], 1.0)
    corrected, innovation_rad, variance = heading_model.correct(predicted, LEVELS, 1.01)
    if not is_compared:
        assert (result.motion, result.log_ratio) == (updated.motion, 3.0)
        return
    assert result.motion == pytest.approx(corrected)
    ratio = heading_model.log_likelihood(innovation_rad, variance)
    ratio -= heading_model.log_likelihood(updated.innovation_rad, updated.innovation_sd_rad**2)
    assert result.log_ratio == pytest.approx(3.0 + ratio)
    assert abs(ratio) > 0.1
    assert delay_test.update(result, previous, previous, OCEAN_RAMBLER, 0.1, 1.0) is result


def test_delayed_filter_that_is_not_valid_continues_from_the_other():
    previous = heading_filter.begin(100.0, 1.0)._replace(levels=LEVELS, begun_s=0.0)
    updated = heading_filter.update(previous, OCEAN_RAMBLER, 101.0, 1.01, 0.1)
    test = DelayTest(previous.motion._replace(p00=math.nan), log_ratio=2.0)
    result = delay_test.update(test, previous, updated, OCEAN_RAMBLER, 0.1, 1.01)
    assert (result.motion, result.log_ratio) == (updated.motion, 2.0)
