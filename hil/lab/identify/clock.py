"""Times as other loggers write them: ISO 8601, times of the day, and those of NMEA without a colon."""

from __future__ import annotations

import math
from datetime import UTC, datetime, time

import numpy as np

from hil.lab.identify.recording import Floats

DAY_S = 86400.0
MINUTE_JUMP = 40.0  # from 59 to 100, at the end of a minute that is written hhmmss


def seconds_of(texts: list[str]) -> Floats:
    """Return seconds of times as ISO 8601 writes them, from the first one; NaN for what is none."""
    try:
        moments = [datetime.fromisoformat(text.strip()) for text in texts]
        zoned = [moment if moment.tzinfo else moment.replace(tzinfo=UTC) for moment in moments]
        return np.array([(moment - zoned[0]).total_seconds() for moment in zoned])
    except ValueError:
        return _past_midnight(np.array([number_of(text) if ":" not in text else _time_of_day(text) for text in texts]))


def seconds_of_nmea(times: Floats) -> Floats | None:
    """Return seconds of times of the day as NMEA writes them, hhmmss.ss; None where they may well be seconds.

    Seconds pass from 60 to 99 in every hundred; these never do, and jump there.
    """
    if not np.all((times >= 0.0) & (times < 240000.0)):
        return None
    minutes = times // 100.0
    rest = times - 100.0 * minutes
    clock = (minutes % 100.0 < 60.0) & (rest < 60.0)
    steps, crossed = np.diff(times), np.diff(minutes) != 0.0
    if not clock.all() or not crossed.any() or not 0.0 < float(np.median(steps)) < MINUTE_JUMP:
        return None
    if np.any(np.abs(steps[crossed]) < MINUTE_JUMP):
        return None
    return _past_midnight(3600.0 * (minutes // 100.0) + 60.0 * (minutes % 100.0) + rest)


def number_of(text: str) -> float:
    """Return a number, NaN for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _past_midnight(times: Floats) -> Floats:
    midnights = np.cumsum(np.diff(times, prepend=times[0]) < -0.5 * DAY_S)
    return np.asarray(times + DAY_S * midnights)


def _time_of_day(text: str) -> float:
    try:
        moment = time.fromisoformat(text.strip())
    except ValueError:
        return math.nan
    return moment.hour * 3600.0 + moment.minute * 60.0 + moment.second + moment.microsecond * 1e-6
