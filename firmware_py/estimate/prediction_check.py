"""Check of the heading filter at run time: compares its predictions with later estimates. Numeric core.

Innovations are not sufficient: a filter that has learned a wrong noise may have consistent innovations and a heading
error of five of its standard deviations (sea trials; docs/explanation/estimation.md). So every HORIZON_S a prediction
starts at the state of the filter, uses the measured rudder without the compass, and is compared with the filter
HORIZON_S later. For a consistent filter the difference e has the variance P_predicted - P_filter (the estimates are
orthogonal: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4),
so the mean of e^2 / variance is 1. The variance includes an error of MODEL_SHARE of each turn, because speed and K are
not known better.

The mean over about MEMORY_COMPARISONS comparisons (10 minutes) has a standard deviation of 0.32 for Gaussian errors.
Null hypothesis: the filter is consistent. It is rejected if the mean exceeds REJECTION_LIMIT; the probability of that
is 1e-8 for 20 independent comparisons of a consistent filter. It is accepted again below ACCEPTANCE_LIMIT.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.estimate import heading_model
from firmware_py.estimate.heading_model import Motion, NoiseLevels
from firmware_py.model.kt import KtModel

HORIZON_S: Final = 30.0
MEMORY_COMPARISONS: Final = 20.0
MAX_SQUARE: Final = 25.0  # limits the weight of a single comparison, for example in a gust
MIN_SD_RAD: Final = radians(0.5)  # error of the compass, which the filter may follow exactly
MODEL_SHARE: Final = 0.2  # relative accuracy of an identified K, and of the speed before it is estimated
REJECTION_LIMIT, ACCEPTANCE_LIMIT = 3.5, 2.0
MIN_COMPARISONS: Final = 10.0  # before the first decision


class PredictionCheck(NamedTuple):
    """Prediction in progress with its start time and start heading; mean square, and number of comparisons in it.

    `is_rejected`: the filter's standard deviations are too small for the errors that occurred.
    """

    motion: Motion = Motion()
    begun_s: float = math.nan
    from_rad: float = 0.0
    mean_square: float = 1.0
    comparisons: float = 0.0
    is_rejected: bool = False


def begin(m: Motion, t_s: float) -> PredictionCheck:
    """Return the check at the start of its first prediction."""
    return PredictionCheck(m, t_s, m.heading_rad, 1.0, 0.0, False)


def restart(check: PredictionCheck, m: Motion, t_s: float) -> PredictionCheck:
    """Return the check with a prediction that starts at t_s, as after a gap; the mean square stays the same."""
    return PredictionCheck(m, t_s, m.heading_rad, check.mean_square, check.comparisons, check.is_rejected)


def update(
    check: PredictionCheck,
    m: Motion,
    levels: NoiseLevels,
    model: KtModel,
    rudder_rad: float,
    t_s: float,
    step_s: float,
) -> PredictionCheck:
    """Return the check after the filter's new state m at t_s, step_s after the previous one."""
    if not 0.0 < step_s < HORIZON_S:
        return restart(check, m, t_s) if step_s > 0.0 else check
    predicted = heading_model.predict(check.motion, levels, model, rudder_rad, step_s)
    if t_s - check.begun_s < HORIZON_S:
        return PredictionCheck(
            predicted, check.begun_s, check.from_rad, check.mean_square, check.comparisons, check.is_rejected
        )
    turn_sd_rad = MODEL_SHARE * (predicted.heading_rad - check.from_rad)
    variance = max(predicted.p00 - m.p00, 0.0) + MIN_SD_RAD * MIN_SD_RAD + turn_sd_rad * turn_sd_rad
    difference_rad = wrap_pi(m.heading_rad - predicted.heading_rad)
    square = min(difference_rad * difference_rad / variance, MAX_SQUARE)
    count = min(check.comparisons + 1.0, MEMORY_COMPARISONS)
    mean_square = check.mean_square + (square - check.mean_square) / count
    limit = ACCEPTANCE_LIMIT if check.is_rejected else REJECTION_LIMIT
    return PredictionCheck(m, t_s, m.heading_rad, mean_square, count, count >= MIN_COMPARISONS and mean_square > limit)


def sd_inflation(check: PredictionCheck) -> float:
    """Return the factor on the standard deviations of the filter; 1 unless the filter is rejected."""
    return math.sqrt(check.mean_square) if check.is_rejected else 1.0
