"""The cells of a table as numbers: what is missing is NaN, what is no number or not believed is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import radians
from hil.errors import UsageError
from hil.lab.identify.clock import number_of, seconds_of, seconds_of_nmea, unit_since_1970
from hil.lab.identify.columns import Column
from hil.lab.identify.recording import Floats

# column -> largest size that is believed, and what to do about a larger one
BELIEVED = {
    "time_s": (1e12, "give seconds"),
    "heading_rad": (1e6, "give radians"),
    "yaw_rate_rad_s": (30.0, "give radians a second, not degrees"),
    "speed_m_s": (1000.0, "give metres a second"),
    "sog_m_s": (1000.0, "give metres a second"),
    "cog_rad": (1e6, "give radians, or degrees as cog_deg"),
    "goal_rad": (1e6, "give radians, or degrees as goal_deg"),
    "lat_rad": (radians(90.01), "give degrees as lat_deg, north positive, or radians as lat_rad"),
    "lon_rad": (radians(360.01), "give degrees as lon_deg, east positive, or radians as lon_rad"),
}
# Columns whose sizes are believed in the unit that their name says, and the usual one where it says none.
NAMED = {"time_s": 1.0, "lat_rad": radians(1.0), "lon_rad": radians(1.0)}
MILLISECOND_S, LEAST_MILLISECONDS = 1e-3, 20.0
LONGEST_INTERVAL_S = 10.0  # between rows, where the unit of the time is guessed: too long for a manoeuvre
MOST_LINES_BELOW = 20  # of a table, that are no rows of it
# How loggers write that there is nothing.
MISSING = frozenset(("", "nan", "na", "n/a", "#n/a", "null", "none", "nil", "nat", "-", "--", "---", "?", "*"))
TIMES = "give seconds, or times as 2026-05-31 23:59:59.5 or 23:59:59.5"

Raw = dict[str, Floats | None]


@dataclass(frozen=True, slots=True)
class Table:
    """A table under way: the numbers of its lines, and its columns."""

    path: Path
    numbers: list[int]
    places: dict[str, Column]
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    whole_milliseconds: bool = True  # seconds that are whole and far apart are taken for milliseconds

    def unit(self, name: str, usual: float) -> float:
        """Return the size of a column's unit, the usual one where its name says none."""
        return self.places[name].unit if self.places[name].known else usual

    def column(self, name: str, texts: list[str]) -> Floats | None:
        """Return the numbers of a column, None when it is empty throughout."""
        try:
            values = np.array(texts, dtype=np.float64)
        except ValueError:
            values = np.array([number_of(text) for text in texts])
        missing = np.isnan(values)
        if missing.any():
            missing &= np.array([text.strip().lower() in MISSING for text in texts])
            if missing.all():
                return None
        if name == "time_s":
            values = self._clock(values, texts, missing)
        # Those of a yaw rate's size are looked at once its unit is known.
        self.check(name, np.where(missing | (np.isfinite(values) & (name == "yaw_rate_rad_s")), 0.0, values), texts)
        return values

    def check(self, name: str, values: Floats | None, texts: list[str] | None = None) -> None:
        """Refuse values that are no numbers or not believed."""
        if values is None:
            return
        most, remedy = BELIEVED.get(name, (math.inf, ""))
        most /= self.unit(name, NAMED[name]) if name in NAMED else 1.0
        wrong = np.flatnonzero(~(np.abs(values) <= most) | ~np.isfinite(values))
        if wrong.size == 0:
            return
        at, shown = int(wrong[0]), self.places[name].shown
        where = f"{self.path}:{self.numbers[at]}"
        text = f"{values[at]:g}" if texts is None else texts[at].strip()
        more = f" (and {wrong.size - 1} more like it)" if wrong.size > 1 else ""
        if not np.isfinite(values[at]):
            said = f"{text[:30]!r} is not a finite number"
            if name == "time_s":
                raise UsageError(f"{where}: {shown} {text[:30]!r} is no time{more}; {TIMES}")
            raise UsageError(f"{where}: {shown} {said}{more}; remove the row, or empty the whole column if it may be")
        raise UsageError(f"{where}: {shown} {text[:30]} is beyond {most:g}{more}; {remedy}")

    def _clock(self, times: Floats, texts: list[str], missing: NDArray[np.bool_]) -> Floats:
        """Return seconds of times however they are written; refuse those that are too far apart to be seconds.

        missing: rows without a time, to which those below the last one are added.
        """
        column = self.places["time_s"]
        wanted = np.flatnonzero(~missing)
        below = _below(times, wanted, texts)
        missing[wanted[wanted.size - below :]] = True
        wanted = wanted[: wanted.size - below]
        times = times.copy()
        if np.isnan(times[wanted]).any():
            times[wanted] = seconds_of([texts[row] for row in wanted.tolist()])
            return times
        seconds = seconds_of_nmea(times[wanted])
        if seconds is not None and column.known:
            raise UsageError(
                f"{self.path}: {column.shown} jumps by 40 at every full minute: these are times of the "
                "day as hhmmss; name the column utc, or give seconds"
            )
        if seconds is not None:
            self.notes.append(f"column {column.shown} holds times of the day as hhmmss")
            times[wanted] = seconds
        elif self.whole_milliseconds and column.known and column.unit == 1.0 and _in_milliseconds(times[wanted]):
            times *= MILLISECOND_S
            self.warnings.append(
                f"column {column.shown} counts by {float(np.median(np.diff(times[wanted]))) / MILLISECOND_S:g} from "
                "row to row, in whole numbers: taken for milliseconds"
            )
        elif not column.known:
            unit = unit_since_1970(times[wanted])
            times *= unit
            if unit != 1.0:
                self.notes.append(f"column {column.shown} counts from 1970 in units of {unit:g} s")
            self._check_interval(times[wanted])
        return times

    def _check_interval(self, times: Floats) -> None:
        """Refuse times whose name says no unit and that are too far apart to be seconds."""
        usual, shown = float(np.median(np.diff(times))), self.places["time_s"].shown
        if usual >= LONGEST_INTERVAL_S:
            raise UsageError(
                f"{self.path}: the rows are {usual:g} apart in {shown}, whose name says no unit: are these "
                "milliseconds? name the column time_ms, time_us, or time_s"
            )


def _in_milliseconds(times: Floats) -> bool:
    """Return whether times that are named seconds are whole numbers so far apart that they are milliseconds."""
    steps = np.diff(times)
    return steps.size > 0 and float(np.median(steps)) >= LEAST_MILLISECONDS and bool(np.all(times == np.round(times)))


def _below(times: Floats, wanted: NDArray[np.intp], texts: list[str]) -> int:
    """Return how many of the last rows have words for a time, as a line of totals below a table."""
    for count, row in enumerate(wanted[::-1][: MOST_LINES_BELOW + 1].tolist()):
        if not math.isnan(float(times[row])) or any(character.isdigit() for character in texts[row]):
            return count
    return 0
