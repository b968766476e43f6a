"""Sequential test for a delayed yaw response to the rudder. Numeric core.

A second heading filter differs from the first in one point: the rudder acts DELAY_S later (three first-order lags of
DELAY_S / 3). Null hypothesis: the rudder acts without this delay. Each heading gives a log-likelihood ratio:

    log p(heading | delayed) - log p(heading | not delayed)

safety/oscillation.py sums these ratios for a sequential test (Wald, Sequential Analysis, 1947; a sum with a lower bound
is Page's test, 1954). The prediction errors of the filter with the true model are white, also in a closed loop where
the rudder follows the heading (Ljung, System Identification, 1999, section 13.4: the direct method). So the test needs
no commanded turn, and does not mistake disturbances for a delay.
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
    """State of the delayed filter, outputs of the three lags of its rudder, and log-likelihood ratio of this tick."""

    motion: Motion = Motion()
    first_rad: float = 0.0
    second_rad: float = 0.0
    third_rad: float = 0.0
    log_ratio: float = 0.0


def begin_tick(test: DelayTest) -> DelayTest:
    """Return the test at the start of a tick, with a log-likelihood ratio of 0."""
    return DelayTest(test.motion, test.first_rad, test.second_rad, test.third_rad, 0.0)


def with_motion(test: DelayTest, motion: Motion) -> DelayTest:
    """Return the test with the delayed filter at the state of the other; used while they cannot be compared."""
    return DelayTest(motion, test.first_rad, test.second_rad, test.third_rad, test.log_ratio)


def take_rate(
    test: DelayTest, yaw_rate_rad_s: float, noise_variance: float, innovation_rad_s: float, variance: float
) -> DelayTest:
    """Return the test updated with a gyroscope's yaw rate, whose innovation in the other filter has this variance."""
    motion, delayed_rad_s, delayed_variance = heading_model.correct_rate(test.motion, yaw_rate_rad_s, noise_variance)
    not_delayed = heading_model.log_likelihood(innovation_rad_s, variance)
    log_ratio = test.log_ratio + heading_model.log_likelihood(delayed_rad_s, delayed_variance) - not_delayed
    return DelayTest(motion, test.first_rad, test.second_rad, test.third_rad, log_ratio)


def update(
    test: DelayTest,
    previous: HeadingFilter,
    updated: HeadingFilter,
    model: KtModel,
    rudder_rad: float,
    heading_rad: float,
) -> DelayTest:
    """Return the test updated with the heading that has changed the filter from `previous` to `updated`.

    The ratio stays the same while the rudder angle is not measured (NaN), and in the first minute, when the filter
    chooses its noise levels.
    """
    step_s = updated.t_s - previous.t_s
    if step_s <= 0.0:
        return test
    if math.isnan(step_s) or not abs(rudder_rad) <= PI:
        return with_motion(test, updated.motion)
    decay = decay_over(step_s, DELAY_S / 3.0)
    third_rad = test.second_rad + decay * (test.third_rad - test.second_rad)
    second_rad = test.first_rad + decay * (test.second_rad - test.first_rad)
    first_rad = rudder_rad + decay * (test.first_rad - rudder_rad)
    motion = heading_model.predict(test.motion, previous.levels, model, third_rad, step_s)
    motion, innovation_rad, innovation_variance = heading_model.correct(motion, previous.levels, heading_rad)
    is_learning = (
        updated.begun_s != previous.begun_s or updated.t_s - updated.begun_s < heading_filter.CANDIDATE_PHASE_S
    )
    if is_learning or not heading_model.is_valid(motion):
        return DelayTest(updated.motion, first_rad, second_rad, third_rad, test.log_ratio)
    not_delayed = heading_model.log_likelihood(
        updated.innovation_rad, updated.innovation_sd_rad * updated.innovation_sd_rad
    )
    delayed = heading_model.log_likelihood(innovation_rad, innovation_variance)
    return DelayTest(motion, first_rad, second_rad, third_rad, test.log_ratio + delayed - not_delayed)
