"""Reads the manoeuvre CSV, and refuses with file, line and remedy what is not one.

Columns by name, in any order: time_s, rudder_rad, heading_rad, yaw_rate_rad_s, speed_m_s, or what others call them
(columns.py), with the unit in the name: heading_deg, Rudder [deg], SOG (kn). Of the last three, heading or yaw rate
must be there; a column may be empty throughout. Separated by commas, semicolons, tabs or spaces; with semicolons,
tabs or spaces a number may have a decimal comma. Times are seconds, or as ISO 8601 writes them. Lines that begin
with # and columns of other names are passed over.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from firmware_py.common.angles import degrees, radians
from firmware_py.files.reading import open_regular
from hil.errors import UsageError
from hil.lab.identify import units
from hil.lab.identify.clock import number_of, seconds_of, seconds_of_nmea
from hil.lab.identify.columns import NAMES, Column, columns_of, separator_of
from hil.lab.identify.recording import Floats, Recording

MAY_BE_EMPTY = ("heading_rad", "yaw_rate_rad_s", "speed_m_s")
MOST_ROWS = 20_000_000
MOST_BYTES = 2 << 30
LONGEST_LINE = 1 << 18
RUDDER_UNITS = ("rad", "deg", "any")

# column -> largest size that is believed, and what to do about a larger one
BELIEVED = {
    "time_s": (1e12, "give seconds"),
    "heading_rad": (1e6, "give radians"),
    "yaw_rate_rad_s": (30.0, "give radians a second, not degrees"),
    "speed_m_s": (1000.0, "give metres a second"),
}
LARGEST_COMMAND = 1e6
LARGEST_RUDDER_DEG = 60.0  # of a rudder whose unit is guessed
LONGEST_INTERVAL_S = 10.0  # between rows, where the unit of the time is guessed: nobody logs a manoeuvre so
ANGLES = {1.0: "radians", radians(1.0): "degrees"}
RATES = {1.0: "radians a second", radians(1.0): "degrees a second", radians(1.0) / 60.0: "degrees a minute"}


def read(path: Path, rudder_unit: str = "rad") -> Recording:
    """Read a whole file; UsageError names the line and the remedy.

    rudder_unit: "rad"; "deg" converts; "any" takes the column for a signed command of whatever
    unit, such as the difference of two thrusters, so that K is per that unit.
    """
    try:
        with os.fdopen(open_regular(path, most_bytes=MOST_BYTES), encoding="utf-8-sig", newline="") as file:
            # A line is never read without end; one that is cut here is refused for the length of its field.
            lines = iter(lambda: file.readline(LONGEST_LINE), "")
            separator = separator_of(next((line for line in lines if line.strip() and not line.startswith("#")), ""))
            file.seek(0)
            lines = iter(lambda: file.readline(LONGEST_LINE), "")
            reader = csv.reader(lines, delimiter=separator, skipinitialspace=separator == " ")
            return _read(path, reader, rudder_unit, decimal_comma=separator != ",")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}; give a manoeuvre CSV or an onboard .BIN log") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not text; give a manoeuvre CSV, or an onboard log whose name ends in .BIN") from None


def _read(path: Path, reader: Iterator[list[str]], unit: str, *, decimal_comma: bool) -> Recording:
    lines = _lines(path, reader)
    first = next(lines, None)
    if first is None:
        raise UsageError(f"{path}: empty; the first line must name the columns {','.join(NAMES)}")
    header = first[1]
    places = columns_of(f"{path}:{first[0]}", header)
    numbers: list[int] = []
    texts: list[list[str]] = []
    for number, fields in lines:
        if len(fields) != len(header):
            raise UsageError(
                f"{path}:{number}: {len(fields)} fields under {len(header)} column names; "
                "mend or remove the line (a last line may have been cut)"
            )
        numbers.append(number)
        texts.append([field.replace(",", ".") for field in fields] if decimal_comma else fields)
        if len(texts) > MOST_ROWS:
            raise UsageError(f"{path}: more than {MOST_ROWS} rows; cut the file")
    if len(texts) < 2:
        rows = "one row" if texts else "no rows"
        raise UsageError(f"{path}: {rows} below the column names; record at least a zigzag")
    table = _Table(path, numbers, places)
    raw = {name: table.column(name, [row[column.place] for row in texts]) for name, column in places.items()}
    return _recording(*_once(table, raw), unit)


def _once(table: _Table, raw: dict[str, Floats | None]) -> tuple[_Table, dict[str, Floats | None]]:
    """Leave out rows that are the one before to the last digit, the time included."""
    same = np.all([values[1:] == values[:-1] for values in raw.values() if values is not None], axis=0)
    kept = np.flatnonzero(np.concatenate(([True], ~same)))
    if not same.any() or kept.size < 2:
        return table, raw
    table.notes.append(f"{np.count_nonzero(same)} rows are the one before to the last digit, and left out")
    numbers = [table.numbers[row] for row in kept.tolist()]
    columns = {name: None if values is None else values[kept] for name, values in raw.items()}
    return replace(table, numbers=numbers), columns


def _recording(table: _Table, raw: dict[str, Floats | None], unit: str) -> Recording:
    """Bring columns to seconds, radians and metres a second."""
    path, numbers = table.path, table.numbers
    time_s, rudder, heading, rate = (raw.get(name) for name in NAMES[:4])
    if time_s is None or rudder is None:
        missing = "time_s" if time_s is None else "rudder_rad"
        raise UsageError(f"{path}:{numbers[0]}: column {missing} is empty; it must be filled")
    if heading is None and rate is None:
        raise UsageError(f"{path}:{numbers[0]}: heading_rad and yaw_rate_rad_s are both empty; fill one of them")
    time_s = time_s * table.unit("time_s", 1.0)
    _check_order(path, numbers, time_s)
    unnamed = {name: values for name, values in raw.items() if values is not None and not table.places[name].known}
    in_degrees = units.unnamed_in_degrees(
        unnamed.get("rudder_rad") if unit == "rad" else None, unnamed.get("heading_rad")
    )
    angle = radians(1.0) if in_degrees or unit == "deg" else 1.0
    if unit == "rad" and in_degrees and "rudder_rad" in unnamed:
        _check_degrees(table, rudder)
    taken = dict.fromkeys(NAMES[1:3], ANGLES[angle]) | {"speed_m_s": "metres a second"}
    if unit == "any":
        taken.pop("rudder_rad")
    if heading is not None:
        heading = heading * table.unit("heading_rad", angle)
    if rate is not None:
        usual = angle if heading is None else units.rate_unit(time_s, heading, rate)
        taken["yaw_rate_rad_s"] = RATES[usual]
        rate = rate * table.unit("yaw_rate_rad_s", usual)
    notes = table.notes + [_note(table, name, taken[name]) for name in NAMES if name in unnamed and name in taken]
    speed = raw.get("speed_m_s")
    speed = None if speed is None else speed * table.unit("speed_m_s", 1.0)
    own = table.unit("rudder_rad", angle)
    rudder, more = _rudder(path, numbers, rudder, "deg" if unit == "rad" and own != 1.0 else unit)
    table.check("yaw_rate_rad_s", rate)
    if unit != "any":
        said = all(table.places[name].known for name in table.places if name != "time_s") and own != 1.0
        angles = units.judged(str(path), time_s, heading, rate, speed, degrees=unit == "deg" and not said)
        heading, rate = angles.heading_rad, angles.yaw_rate_rad_s
        more += angles.notes
    return Recording(str(path), time_s, rudder, heading, rate, speed, (*notes, *more))


def _note(table: _Table, name: str, unit: str) -> str:
    return f"column {table.places[name].shown} says no unit: taken for {unit}"


def _lines(path: Path, reader: Iterator[list[str]]) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and fields of every line that says something."""
    number = 0
    while True:
        try:
            fields = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise UsageError(f"{path}:{number + 1}: not a CSV file ({error}); export it anew") from None
        number += 1
        if any(field.strip() for field in fields) and not fields[0].lstrip().startswith("#"):
            yield number, fields


@dataclass(frozen=True, slots=True)
class _Table:
    """A table under way: the numbers of its lines, and its columns."""

    path: Path
    numbers: list[int]
    places: dict[str, Column]
    notes: list[str] = field(default_factory=list)

    def unit(self, name: str, usual: float) -> float:
        """Return the size of a column's unit, the usual one where its name says none."""
        return self.places[name].unit if self.places[name].known else usual

    def column(self, name: str, texts: list[str]) -> Floats | None:
        """Return the numbers of a column, None when it is empty throughout."""
        try:
            values = np.array(texts, dtype=np.float64)
            if name == "time_s":
                values = self._clock(values)
        except ValueError:
            if name in MAY_BE_EMPTY and not any(text.strip() for text in texts):
                return None
            values = seconds_of(texts) if name == "time_s" else np.array([number_of(text) for text in texts])
        self.check(name, values if name != "yaw_rate_rad_s" else np.where(np.isfinite(values), 0.0, values), texts)
        return values

    def check(self, name: str, values: Floats | None, texts: list[str] | None = None) -> None:
        """Refuse values that are no numbers or not believed."""
        if values is None:
            return
        most, remedy = BELIEVED.get(name, (math.inf, ""))
        most /= self.unit(name, 1.0) if name == "time_s" else 1.0
        wrong = np.flatnonzero(~(np.abs(values) <= most) | ~np.isfinite(values))
        if wrong.size == 0:
            return
        at, shown = int(wrong[0]), self.places[name].shown
        where = f"{self.path}:{self.numbers[at]}"
        text = f"{values[at]:g}" if texts is None else texts[at].strip()
        more = f" (and {wrong.size - 1} more like it)" if wrong.size > 1 else ""
        if not np.isfinite(values[at]):
            said = "is empty" if not text else f"{text[:30]!r} is not a finite number"
            raise UsageError(f"{where}: {shown} {said}{more}; remove the row, or empty the whole column if it may be")
        raise UsageError(f"{where}: {shown} {text[:30]} is beyond {most:g}{more}; {remedy}")

    def _clock(self, times: Floats) -> Floats:
        """Return seconds of times that are hhmmss; refuse those whose name says seconds, or that are too far apart."""
        column, seconds = self.places["time_s"], seconds_of_nmea(times)
        if seconds is not None and column.known:
            raise UsageError(
                f"{self.path}: {column.shown} jumps by 40 at every full minute: these are times of the "
                "day as hhmmss; name the column utc, or give seconds"
            )
        if seconds is not None:
            self.notes.append(f"column {column.shown} holds times of the day as hhmmss")
            return seconds
        if not column.known:
            self._check_interval(times)
        return times

    def _check_interval(self, times: Floats) -> None:
        """Refuse times whose name says no unit and that are too far apart to be seconds."""
        usual, shown = float(np.median(np.diff(times))), self.places["time_s"].shown
        if usual >= LONGEST_INTERVAL_S:
            raise UsageError(
                f"{self.path}: the rows are {usual:g} apart in {shown}, whose name says no unit: are these "
                "milliseconds? name the column time_ms, or time_s"
            )


def _check_order(path: Path, numbers: list[int], time_s: Floats) -> None:
    wrong = np.flatnonzero(np.diff(time_s) <= 0.0)
    if wrong.size:
        at = int(wrong[0])
        raise UsageError(
            f"{path}:{numbers[at + 1]}: time_s {time_s[at + 1]:g} does not come after {time_s[at]:g}; "
            "sort the rows by time and remove repeated ones; where the clock was set back, make two files of it"
        )


def _check_degrees(table: _Table, rudder: Floats) -> None:
    """Refuse a rudder that would be in degrees if headings tell its unit, too, and that is hardly so."""
    shown, largest = table.places["rudder_rad"].shown, float(np.max(np.abs(rudder)))
    if units.LARGEST_RUDDER_RAD < largest <= LARGEST_RUDDER_DEG:
        return
    raise UsageError(
        f"{table.path}: {shown} goes to {largest:.3g} and its name says no unit: radians, degrees or a share of full? "
        "name it rudder_rad or rudder_deg; for a command that is no angle say --rudder-unit any"
    )


def _rudder(path: Path, numbers: list[int], rudder: Floats, unit: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the rudder in radians, or the command as it is."""
    if unit == "any":
        limit, shown = LARGEST_COMMAND, f"{LARGEST_COMMAND:g}"
    else:
        limit, shown = (90.0, "90 deg") if unit == "deg" else (radians(90.0), "90 deg (1.5708 rad)")
    wrong = np.flatnonzero(np.abs(rudder) > limit * (1.0 + 1e-6))
    if wrong.size:
        at = int(wrong[0])
        guess = "" if unit == "any" else "; "
        if unit == "rad":
            guess += "are these degrees? convert them or say --rudder-unit deg; "
        if unit != "any":
            guess += "for a command that is no angle say --rudder-unit any"
        raise UsageError(f"{path}:{numbers[at]}: rudder_rad {rudder[at]:g} is beyond {shown}{guess or '; scale it'}")
    if unit == "deg":
        return rudder * radians(1.0), (f"rudder converted from degrees (up to {np.max(np.abs(rudder)):.0f} deg)",)
    if unit == "any":
        return rudder, ("the rudder column is a command of unknown unit: K is per that unit, delta0 in it",)
    if degrees(float(np.max(np.abs(rudder)))) > 60.0:
        return rudder, ("rudder angles beyond 60 deg: --rudder-unit deg or any, if these are no radians",)
    return rudder, ()
