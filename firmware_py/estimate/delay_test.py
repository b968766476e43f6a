"""Test whether the boat responds late to its rudder. Numeric core.

Beside the heading filter runs a second one that differs in one point: the rudder acts DELAY_S later (three first-order
lags of a third of it each). Null hypothesis: the rudder acts at once. The logarithm of the likelihood ratio of each
heading,

    log p(heading | late) - log p(heading | at once),

is that of a sequential test (Wald, Sequential Analysis, 1947; its sum with a lower bound is Page's test, 1954), which
safety/oscillation.py adds up. The prediction errors of both filters are white for the true one also in a closed loop,
where the rudder follows the heading (Ljung, System Identification, 1999, section 13.4: the direct method), so that the
test needs no commanded turn, and disturbances do not look like a delay.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import PI
from firmware_py.estimate import heading_filter, heading_model
from firmware_py.estimate.heading_filter import HeadingFilter
from firmware_py.estimate.heading_model import Motion
from firmware_py.model.kt import KtModel, decay_over

DELAY_S: Final = 12.0


class DelayTest(NamedTuple):
    """State of the late filter, the three lags of its rudder, and the logarithm of the ratio in this tick."""

    motion: Motion = Motion()
    first_rad: float = 0.0
    second_rad: float = 0.0
    third_rad: float = 0.0
    log_ratio: float = 0.0


def begin_tick(test: DelayTest) -> DelayTest:
    """Return the test at the begin of a tick."""
    return DelayTest(test.motion, test.first_rad, test.second_rad, test.third_rad, 0.0)


def with_motion(test: DelayTest, motion: Motion) -> DelayTest:
    """Return the test with the late filter at the state of the other, where both cannot be compared."""
    return DelayTest(motion, test.first_rad, test.second_rad, test.third_rad, test.log_ratio)


def update(
    test: DelayTest, before: HeadingFilter, after: HeadingFilter, model: KtModel, rudder_rad: float, heading_rad: float
) -> DelayTest:
    """Return the test updated with a heading that has led the filter from `before` to `after`.

    Nothing is compared while the rudder angle is not measured (NaN), and in the first minute, when the filter chooses
    its noise levels.
    """
    step_s = after.t_s - before.t_s
    if step_s <= 0.0:
        return test
    if math.isnan(step_s) or not abs(rudder_rad) <= PI:
        return with_motion(test, after.motion)
    keep = decay_over(step_s, DELAY_S / 3.0)
    third_rad = test.second_rad + keep * (test.third_rad - test.second_rad)
    second_rad = test.first_rad + keep * (test.second_rad - test.first_rad)
    first_rad = rudder_rad + keep * (test.first_rad - rudder_rad)
    motion = heading_model.predict(test.motion, before.levels, model, third_rad, step_s)
    motion, innovation_rad, variance = heading_model.correct(motion, before.levels, heading_rad)
    is_learning = after.begun_s != before.begun_s or after.t_s - after.begun_s < heading_filter.CANDIDATE_PHASE_S
    if is_learning or not heading_model.is_valid(motion):
        return DelayTest(after.motion, first_rad, second_rad, third_rad, test.log_ratio)
    at_once = heading_model.log_likelihood(after.innovation_rad, after.innovation_sd_rad * after.innovation_sd_rad)
    late = heading_model.log_likelihood(innovation_rad, variance)
    return DelayTest(motion, first_rad, second_rad, third_rad, test.log_ratio + late - at_once)
