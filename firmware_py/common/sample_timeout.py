"""Timeout of a source of samples, adapted to the intervals of its samples.

One parameter, the minimum timeout, is suitable for a compass of 1 Hz and one of 50 Hz. A slower source may miss one
sample, but not two.

Numeric core: functions over floats, which the lab compiles unchanged (hil/lab/numeric_core.py); NaN means
absent.
"""

from __future__ import annotations

import math
from typing import Final

MISSED_INTERVALS: Final = 2.5  # timeout in intervals: one sample may be lost
MAX_INTERVAL_TIMEOUTS: Final = 2.0  # maximum interval in minimum timeouts; longer ones are gaps
INTERVAL_DECAY: Final = 0.125  # decrease of the interval at each sample, so that a gap has no lasting effect


def learn_interval_s(interval_s: float, step_s: float, min_timeout_s: float) -> float:
    """Return the longest recent interval after a sample that came step_s after the previous one.

    `interval_s` is NaN before the second sample, `step_s` at the first. The maximum is used instead of the mean,
    because the sentences of one burst are several samples. Samples that were read together do not count: the
    source would otherwise time out each second if an adapter delivers its samples in bursts of one second.
    """
    if math.isnan(step_s):
        return interval_s
    previous_interval_s = min_timeout_s if math.isnan(interval_s) else interval_s
    if step_s <= 0.0:
        return previous_interval_s
    max_interval_s, min_interval_s = MAX_INTERVAL_TIMEOUTS * min_timeout_s, (1.0 - INTERVAL_DECAY) * previous_interval_s
    counted_s = step_s if step_s < max_interval_s else max_interval_s
    return counted_s if counted_s > min_interval_s else min_interval_s


def timeout_s(interval_s: float, min_timeout_s: float) -> float:
    """Return the timeout for an interval (NaN: unknown): 1 to 5 times `min_timeout_s`."""
    max_interval_s = MAX_INTERVAL_TIMEOUTS * min_timeout_s
    limited_interval_s = (
        min_timeout_s if math.isnan(interval_s) else interval_s if interval_s < max_interval_s else max_interval_s
    )
    silent_s = MISSED_INTERVALS * limited_interval_s
    return silent_s if silent_s > min_timeout_s else min_timeout_s
