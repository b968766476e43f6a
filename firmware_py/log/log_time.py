"""Calendar time of logs whose process started before the computer's clock was set."""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_py.common.calendar import LAST_UTC_S, is_possible
from firmware_py.log.dataflash import Buffer, Parser

_TIME_TOLERANCE_S = 1.0
_FIRST_UTC_S = 1.0e9  # 2001: no receiver sends an earlier time


def utc_offset_s(buffer: Buffer) -> float | None:
    """Return UTC minus process time from the first dated fix of a log; None without one."""
    for file_format, offset in Parser(buffer):
        if file_format.name == "FIX":
            fix = dict(zip(file_format.labels, file_format.unpack(buffer, offset), strict=True))
            utc_s, t_s = fix.get("Utc"), fix.get("T")
            if not (isinstance(utc_s, float) and isinstance(t_s, float)):  # another version, or damaged
                continue
            if _FIRST_UTC_S < utc_s < LAST_UTC_S and math.isfinite(t_s):
                return utc_s - t_s
    return None


def corrected_utc_s(utc_s: Sequence[float], t_s: Sequence[float], span_s: Sequence[float]) -> list[float]:
    """Return the UTC of rows; the clock offset at the end of each run is applied to the whole run.

    `utc_s` is the calendar clock, `t_s` the time since the start of the run and `span_s` the duration of each row, in
    the order of writing. Within a run, `t_s` is continuous, but the calendar clock may start at a wrong date such as
    1970 and be set minutes later. Rows of a run without a possible calendar time are unchanged.
    """
    corrected_s = [float(value) for value in utc_s]
    offset_s: float | None = None
    for index in reversed(range(len(corrected_s))):
        if offset_s is None and is_possible(corrected_s[index]):
            offset_s = corrected_s[index] - t_s[index]
        if offset_s is not None:
            corrected_s[index] = offset_s + t_s[index]
        if index and t_s[index] - span_s[index] < t_s[index - 1] - _TIME_TOLERANCE_S:  # a new run, which starts at 0
            offset_s = None
    return corrected_s
