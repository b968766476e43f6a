"""Time without samples after which a source is lost, learned from the intervals of its samples.

One parameter then serves a compass of 1 Hz and one of 50 Hz: it is the shortest time-out, and applies to every source
that is fast enough. A slower source may miss one sample, but not two.

Numeric core: functions over floats, which the laboratory compiles as they stand (hil/lab/numeric_core.py); NaN is
absence.
"""

from __future__ import annotations

import math
from typing import Final

MISSED: Final = 2.5  # intervals: one sample may be lost on the way, two may not
SLOWEST: Final = 2.0  # time-outs: a longer interval is a gap, and counts as this
FORGOTTEN: Final = 0.125  # part of the interval at each sample, so that a gap is soon forgotten


def learn_interval_s(interval_s: float, step_s: float, shortest_s: float) -> float:
    """Return the longest recent interval after a sample that came step_s after the one before.

    An interval of NaN is not known yet, a step of NaN is that of the first sample. The longest and not the mean,
    because several sentences of one burst are several samples. Samples that were read together do not count: otherwise
    an adapter that passes on a second's worth at a time would be lost each second.
    """
    if math.isnan(step_s):
        return interval_s
    before_s = shortest_s if math.isnan(interval_s) else interval_s
    if step_s <= 0.0:
        return before_s
    slowest_s, least_s = SLOWEST * shortest_s, (1.0 - FORGOTTEN) * before_s
    counted_s = step_s if step_s < slowest_s else slowest_s
    return counted_s if counted_s > least_s else least_s


def timeout_s(interval_s: float, shortest_s: float) -> float:
    """Return the time-out of a source of this interval (NaN: not known): 1 to 5 times `shortest_s`."""
    slowest_s = SLOWEST * shortest_s
    known_s = shortest_s if math.isnan(interval_s) else interval_s if interval_s < slowest_s else slowest_s
    silent_s = MISSED * known_s
    return silent_s if silent_s > shortest_s else shortest_s
