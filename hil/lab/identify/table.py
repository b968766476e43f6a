"""Convert the cells of a table to numbers; missing cells are NaN, invalid numbers are errors."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from datetime import UTC, datetime, time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import radians
from hil.errors import UsageError
from hil.lab.identify.columns import Column
from hil.lab.identify.recording import Floats

DAY_S = 86400.0
EPOCH_UNITS_S = (1e-9, 1e-6, 1e-3)
EPOCH_RANGE_S = (9e8, 5e9)  # plausible times since 1970: from 1998 to 2128
MIN_ROWS_PER_TIME = 2  # a clock is coarse if the median number of rows per time is at least this
MINUTE_JUMP = 40.0  # step of hhmmss at the end of a minute, from 59 to 100, minus a second


def parse_times(texts: list[str]) -> Floats:
    """Convert ISO 8601 times or times of the day to seconds since the first time; NaN for other text."""
    try:
        moments = [datetime.fromisoformat(_as_iso(text.strip())) for text in texts]
        zoned = [moment if moment.tzinfo else moment.replace(tzinfo=UTC) for moment in moments]
        return np.array([(moment - zoned[0]).total_seconds() for moment in zoned])
    except ValueError:
        return _unwrap_midnight(
            np.array([parse_number(text) if ":" not in text else _time_of_day(text) for text in texts])
        )


def parse_nmea_times(times: Floats) -> Floats | None:
    """Return seconds of times of the day written as hhmmss.ss, None if they may be plain seconds.

    Plain seconds have values from 60 to 99 in every hundred; hhmmss does not.
    """
    if not np.all((times >= 0.0) & (times < 240000.0)):
        return None
    minutes = times // 100.0
    seconds = times - 100.0 * minutes
    is_clock_time = (minutes % 100.0 < 60.0) & (seconds < 60.0)
    steps, is_next_minute = np.diff(times), np.diff(minutes) != 0.0
    if not is_clock_time.all() or not is_next_minute.any() or not 0.0 < float(np.median(steps)) < MINUTE_JUMP:
        return None
    if np.any(np.abs(steps[is_next_minute]) < MINUTE_JUMP):
        return None
    return _unwrap_midnight(3600.0 * (minutes // 100.0) + 60.0 * (minutes % 100.0) + seconds)


def epoch_unit(times: Floats) -> float:
    """Return the unit in seconds of times since 1970 in ms, us or ns; 1 for all other times."""
    first, last = float(times[0]), float(times[-1])
    units = [
        unit
        for unit in EPOCH_UNITS_S
        if all(EPOCH_RANGE_S[0] < unit * time_value < EPOCH_RANGE_S[1] for time_value in (first, last))
    ]
    return units[0] if units else 1.0


def spread_shared_times(times: Floats) -> Floats | None:
    """Spread the rows that share a coarse time evenly up to the next time.

    Returns None if no rows, or only a few, have the same time.
    """
    steps = np.diff(times)
    first = np.flatnonzero(np.concatenate(([True], steps != 0.0)))
    counts = np.diff(np.append(first, times.size))
    if np.any(steps < 0.0) or first.size < 2 or float(np.median(np.repeat(counts, counts))) < MIN_ROWS_PER_TIME:
        return None
    spans = np.diff(times[first])
    last = float(np.median(spans / counts[:-1])) * counts[-1]
    # The first time may lack rows at the beginning of its interval, the last time at the end.
    index_in_group = np.arange(times.size) - np.repeat(first, counts)
    interval_s = np.append(spans, last) / counts
    interval_s[0] = min(interval_s[0], last / counts[-1])
    spread = np.repeat(times[first], counts) + index_in_group * np.repeat(interval_s, counts)
    spread[: counts[0]] += spans[0] - interval_s[0] * counts[0]
    return np.asarray(spread)


def parse_number(text: str) -> float:
    """Return a number, NaN for other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _as_iso(text: str) -> str:
    """Convert similar dates to ISO 8601; with slashes, only a date that starts with the year is unambiguous."""
    text = re.sub(r"^(\d{4})/(\d\d?)/(\d\d?)", r"\1-\2-\3", re.sub(r"\s*(UTC|GMT)$", "Z", text))
    text = re.sub(r"^(\d\d?)\.(\d\d?)\.(\d{4})", r"\3-\2-\1", text)
    return re.sub(r"-(\d)(?=[-T ])", r"-0\1", re.sub(r"(?<=:\d\d),(?=\d)", ".", text))


def _unwrap_midnight(times: Floats) -> Floats:
    midnights = np.cumsum(np.diff(times, prepend=times[0]) < -0.5 * DAY_S)
    return np.asarray(times + DAY_S * midnights)


def _time_of_day(text: str) -> float:
    """Return seconds of the day; a preceding date is ignored, since midnight is detected from the times."""
    plain = re.sub(r"^\d\d?([/-])\d\d?\1\d{4}[ T]+", "", text.strip())
    meridiem = re.search(r"\s*([ap])\.?m\.?$", plain, re.IGNORECASE)
    try:
        moment = time.fromisoformat(
            re.sub(r"^(?=\d:)", "0", plain[: meridiem.start()] if meridiem is not None else plain)
        )
    except ValueError:
        return math.nan
    if meridiem is not None:
        moment = moment.replace(hour=moment.hour % 12 + 12 * (meridiem[1].lower() == "p"))
    return moment.hour * 3600.0 + moment.minute * 60.0 + moment.second + moment.microsecond * 1e-6


# column -> largest accepted size, and the remedy for larger values
COLUMN_LIMITS = {
    "time_s": (1e12, "give seconds"),
    "heading_rad": (1e6, "give radians"),
    "yaw_rate_rad_s": (30.0, "give radians per second, not degrees"),
    "speed_m_s": (1000.0, "give metres per second"),
    "sog_m_s": (1000.0, "give metres per second"),
    "cog_rad": (1e6, "give radians, or degrees as cog_deg"),
    "goal_rad": (1e6, "give radians, or degrees as goal_deg"),
    "lat_rad": (radians(90.01), "give degrees as lat_deg, north positive, or radians as lat_rad"),
    "lon_rad": (radians(360.01), "give degrees as lon_deg, east positive, or radians as lon_rad"),
}
# Columns whose limits are in the unit of the column name, and the default unit.
LIMIT_UNITS = {"time_s": 1.0, "lat_rad": radians(1.0), "lon_rad": radians(1.0)}
MILLISECOND_S, MIN_MILLISECONDS = 1e-3, 20.0
MAX_INTERVAL_S = 10.0  # maximum interval of the rows if the time has no unit
MAX_LINES_BELOW = 20  # maximum number of lines below the table
# Texts of missing values.
MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "nat", "-", "--", "---", "?", "*"))
TIME_REMEDY = "give seconds, or times as 2026-05-31 23:59:59.5 or 23:59:59.5"

Raw = dict[str, Floats | None]


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the line number of each row, and the columns by quantity."""

    path: Path
    line_numbers: list[int]
    columns: dict[str, Column]
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    detects_milliseconds: bool = True  # whole seconds with large intervals are assumed to be milliseconds

    def unit(self, name: str, default: float) -> float:
        """Return the size of a column's unit; `default` if the name has no unit."""
        return self.columns[name].unit if self.columns[name].has_unit else default

    def column(self, name: str, texts: list[str]) -> Floats | None:
        """Return the numbers of a column, None for an empty column."""
        try:
            values = np.array(texts, dtype=np.float64)
        except ValueError:
            values = np.array([parse_number(text) for text in texts])
        missing = np.isnan(values)
        if missing.any():
            missing &= np.array([text.strip().lower() in MISSING for text in texts])
            if missing.all():
                return None
        if name == "time_s":
            values = self._clock(values, texts, missing)
        # Yaw rates are checked when their unit is known.
        self.check(name, np.where(missing | (np.isfinite(values) & (name == "yaw_rate_rad_s")), 0.0, values), texts)
        return values

    def check(self, name: str, values: Floats | None, texts: list[str] | None = None) -> None:
        """Raise UsageError for values that are not finite or too large."""
        if values is None:
            return
        limit, remedy = COLUMN_LIMITS.get(name, (math.inf, ""))
        limit /= self.unit(name, LIMIT_UNITS[name]) if name in LIMIT_UNITS else 1.0
        invalid = np.flatnonzero(~(np.abs(values) <= limit) | ~np.isfinite(values))
        if invalid.size == 0:
            return
        first, label = int(invalid[0]), self.columns[name].label
        where = f"{self.path}:{self.line_numbers[first]}"
        text = f"{values[first]:g}" if texts is None else texts[first].strip()
        count_text = f" (and {invalid.size - 1} more like it)" if invalid.size > 1 else ""
        if not np.isfinite(values[first]):
            problem = f"{text[:30]!r} is not a finite number"
            if name == "time_s":
                raise UsageError(f"{where}: {label} {text[:30]!r} is not a time{count_text}; {TIME_REMEDY}")
            raise UsageError(f"{where}: {label} {problem}{count_text}; remove the row, or empty an optional column")
        raise UsageError(f"{where}: {label} {text[:30]} is beyond {limit:g}{count_text}; {remedy}")

    def _clock(self, times: Floats, texts: list[str], missing: NDArray[np.bool_]) -> Floats:
        """Return times in seconds; raise UsageError for intervals that are too large for seconds.

        `missing` marks the rows without a time; this function also marks the lines below the table.
        """
        column = self.columns["time_s"]
        timed_rows = np.flatnonzero(~missing)
        footer_rows = _count_footer_rows(times, timed_rows, texts)
        missing[timed_rows[timed_rows.size - footer_rows :]] = True
        timed_rows = timed_rows[: timed_rows.size - footer_rows]
        times = times.copy()
        if np.isnan(times[timed_rows]).any():
            times[timed_rows] = parse_times([texts[row] for row in timed_rows.tolist()])
            return times
        seconds = parse_nmea_times(times[timed_rows])
        if seconds is not None and column.has_unit:
            raise UsageError(
                f"{self.path}: {column.label} jumps by 40 at every full minute, so it contains times of the "
                "day as hhmmss; name the column utc, or give seconds"
            )
        if seconds is not None:
            self.notes.append(f"column {column.label} contains times of the day as hhmmss")
            times[timed_rows] = seconds
        elif (
            self.detects_milliseconds and column.has_unit and column.unit == 1.0 and _in_milliseconds(times[timed_rows])
        ):
            times *= MILLISECOND_S
            self.warnings.append(
                f"column {column.label} increases by {float(np.median(np.diff(times[timed_rows]))) / MILLISECOND_S:g} "
                "from row to row, in whole numbers: milliseconds assumed"
            )
        elif not column.has_unit:
            unit = epoch_unit(times[timed_rows])
            times *= unit
            if unit != 1.0:
                self.notes.append(f"column {column.label} counts from 1970 in units of {unit:g} s")
            self._check_interval(times[timed_rows])
        return times

    def _check_interval(self, times: Floats) -> None:
        """Raise UsageError for times without unit whose intervals are too large for seconds."""
        interval, label = float(np.median(np.diff(times))), self.columns["time_s"].label
        if interval >= MAX_INTERVAL_S:
            raise UsageError(
                f"{self.path}: the rows are {interval:g} apart in {label}, which has no unit; name the column time_ms, "
                "time_us or time_s"
            )


def _in_milliseconds(times: Floats) -> bool:
    """Return whether times named seconds are whole numbers with intervals of milliseconds."""
    steps = np.diff(times)
    return steps.size > 0 and float(np.median(steps)) >= MIN_MILLISECONDS and bool(np.all(times == np.round(times)))


def _count_footer_rows(times: Floats, timed_rows: NDArray[np.intp], texts: list[str]) -> int:
    """Return the number of rows at the end without a time, such as a line of totals."""
    for count, row in enumerate(timed_rows[::-1][: MAX_LINES_BELOW + 1].tolist()):
        if not math.isnan(float(times[row])) or any(character.isdigit() for character in texts[row]):
            return count
    return 0
