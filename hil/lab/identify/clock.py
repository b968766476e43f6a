"""Parses times: ISO 8601 and similar dates, times of the day, NMEA hhmmss, and counts since 1970."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, time

import numpy as np

from hil.lab.identify.recording import Floats

DAY_S = 86400.0
SINCE_1970 = (1e-9, 1e-6, 1e-3)
YEARS_S = (9e8, 5e9)  # of a time since 1970: from 1998 to 2128
COARSE = 2  # rows with the same time; the median row, where the clock is coarse
MINUTE_JUMP = 40.0  # from 59 to 100 at the end of a minute written as hhmmss


def seconds_of(texts: list[str]) -> Floats:
    """Return seconds since the first of ISO 8601 times or times of the day; NaN for other text."""
    try:
        moments = [datetime.fromisoformat(_as_iso(text.strip())) for text in texts]
        zoned = [moment if moment.tzinfo else moment.replace(tzinfo=UTC) for moment in moments]
        return np.array([(moment - zoned[0]).total_seconds() for moment in zoned])
    except ValueError:
        return _past_midnight(np.array([number_of(text) if ":" not in text else _time_of_day(text) for text in texts]))


def seconds_of_nmea(times: Floats) -> Floats | None:
    """Return seconds of times of the day written as hhmmss.ss, None if they may be plain seconds.

    In every hundred, plain seconds take values from 60 to 99; hhmmss never does.
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


def unit_since_1970(times: Floats) -> float:
    """Return the unit of times since 1970 that are finer than seconds, otherwise 1."""
    first, last = float(times[0]), float(times[-1])
    units = [unit for unit in SINCE_1970 if all(YEARS_S[0] < unit * one < YEARS_S[1] for one in (first, last))]
    return units[0] if units else 1.0


def spread_evenly(times: Floats) -> Floats | None:
    """Return coarse times, which several rows share, spread evenly up to the next time.

    None where no rows share a time, or only a few do, which is another fault.
    """
    steps = np.diff(times)
    first = np.flatnonzero(np.concatenate(([True], steps != 0.0)))
    counts = np.diff(np.append(first, times.size))
    if np.any(steps < 0.0) or first.size < 2 or float(np.median(np.repeat(counts, counts))) < COARSE:
        return None
    spans = np.diff(times[first])
    last = float(np.median(spans / counts[:-1])) * counts[-1]
    # The first and the last time may have been cut: they hold fewer rows, which lie at its end and its beginning.
    share = np.arange(times.size) - np.repeat(first, counts)
    each = np.append(spans, last) / counts
    each[0] = min(each[0], last / counts[-1])
    spread = np.repeat(times[first], counts) + share * np.repeat(each, counts)
    spread[: counts[0]] += spans[0] - each[0] * counts[0]
    return np.asarray(spread)


def number_of(text: str) -> float:
    """Return a number, NaN for other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _as_iso(text: str) -> str:
    """Return a similar date as ISO 8601; with slashes, only a date that begins with the year is unambiguous."""
    text = re.sub(r"^(\d{4})/(\d\d?)/(\d\d?)", r"\1-\2-\3", re.sub(r"\s*(UTC|GMT)$", "Z", text))
    text = re.sub(r"^(\d\d?)\.(\d\d?)\.(\d{4})", r"\3-\2-\1", text)
    return re.sub(r"-(\d)(?=[-T ])", r"-0\1", re.sub(r"(?<=:\d\d),(?=\d)", ".", text))


def _past_midnight(times: Floats) -> Floats:
    midnights = np.cumsum(np.diff(times, prepend=times[0]) < -0.5 * DAY_S)
    return np.asarray(times + DAY_S * midnights)


def _time_of_day(text: str) -> float:
    """Return seconds of the day; a date before it is ignored, since midnight shows in the times."""
    plain = re.sub(r"^\d\d?([/-])\d\d?\1\d{4}[ T]+", "", text.strip())
    half = re.search(r"\s*([ap])\.?m\.?$", plain, re.IGNORECASE)
    try:
        moment = time.fromisoformat(re.sub(r"^(?=\d:)", "0", plain[: half.start()] if half is not None else plain))
    except ValueError:
        return math.nan
    if half is not None:
        moment = moment.replace(hour=moment.hour % 12 + 12 * (half[1].lower() == "p"))
    return moment.hour * 3600.0 + moment.minute * 60.0 + moment.second + moment.microsecond * 1e-6
