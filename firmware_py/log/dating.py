"""When the rows of the thin log were, of runs that began before the computer knew the time."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_py.common.calendar import is_possible

_SLACK_S = 1.0


def dated(utc_s: Sequence[float], t_s: Sequence[float], span_s: Sequence[float]) -> list[float]:
    """Return when rows were, by the clock that the last row of each run has; what no clock knew stays as it is.

    A row has what the calendar clock said, the time of its run, and how long it was; rows are in the order in which
    they were written. Within a run time goes on evenly, whereas the clock is set: by a receiver after minutes, on a
    computer that begins at 1970, or at some day in spring, with each start.
    """
    found = [float(value) for value in utc_s]
    offset_s: float | None = None
    for place in reversed(range(len(found))):
        if offset_s is None and is_possible(found[place]):
            offset_s = found[place] - t_s[place]
        if offset_s is not None:
            found[place] = offset_s + t_s[place]
        if place and t_s[place] - span_s[place] < t_s[place - 1] - _SLACK_S:  # another run, which began at 0
            offset_s = None
    return found
