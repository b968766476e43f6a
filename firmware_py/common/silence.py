"""After what silence a source of samples is lost: learned from how far apart its samples come.

A compass of 1 Hz and one of 50 Hz are judged by the same parameter: it is the shortest time-out, and counts for every
source that is quick enough. One that is not may miss one sample, and not two.
"""

from __future__ import annotations

from typing import Final

MISSED: Final = 2.5  # intervals: one sample may be lost on the way, two may not
SLOWEST: Final = 2.0  # time-outs: samples farther apart than this are taken for a gap and teach no more
FORGOTTEN: Final = 0.125  # part of the interval at each sample, so that a gap is soon forgotten


def learn_interval_s(interval_s: float | None, step_s: float, shortest_s: float) -> float:
    """Return the longest interval of late after a sample that came step_s after the one before.

    None: none is known yet. The longest and not the mean, because several sentences of one burst are several samples.
    Those that were read together teach nothing: an adapter that hands on a second's worth at a time would else be
    lost each second.
    """
    before_s = shortest_s if interval_s is None else interval_s
    if step_s <= 0.0:
        return before_s
    slowest_s, least_s = SLOWEST * shortest_s, (1.0 - FORGOTTEN) * before_s
    counted_s = step_s if step_s < slowest_s else slowest_s
    return counted_s if counted_s > least_s else least_s


def timeout_s(interval_s: float | None, shortest_s: float) -> float:
    """Return after what silence a source of this interval is lost, `shortest_s` at least and 5 times that at most."""
    slowest_s = SLOWEST * shortest_s
    known_s = shortest_s if interval_s is None else interval_s if interval_s < slowest_s else slowest_s
    silent_s = MISSED * known_s
    return silent_s if silent_s > shortest_s else shortest_s
