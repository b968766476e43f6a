"""The calendar time of logs whose process began before the computer knew the time."""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_py.common.calendar import LAST_UTC_S, is_possible
from firmware_py.log.dataflash import Buffer, Parser

_SLACK_S = 1.0
_FIRST_UTC_S = 1.0e9  # 2001: an earlier time is not from a receiver


def utc_shift_s(buffer: Buffer) -> float | None:
    """Return UTC less the time of the process, by the first dated fix of a log; None without one."""
    for found, at in Parser(buffer):
        if found.name == "FIX":
            fix = dict(zip(found.labels, found.unpack(buffer, at), strict=True))
            utc_s, t_s = fix.get("Utc"), fix.get("T")
            if not (isinstance(utc_s, float) and isinstance(t_s, float)):  # of another version, or damaged
                continue
            if _FIRST_UTC_S < utc_s < LAST_UTC_S and math.isfinite(t_s):
                return utc_s - t_s
    return None


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
