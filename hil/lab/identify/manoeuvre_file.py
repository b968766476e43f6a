"""Reads the manoeuvre CSV, and refuses with file, line and remedy what is not one.

Columns by name, in any order: time_s, rudder_rad, heading_rad, yaw_rate_rad_s, and speed_m_s,
which may be missing. A column of the last three may be empty throughout, but heading and
yaw rate not both. Lines that begin with # and columns of other names are passed over.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from firmware_py.common.angles import degrees, radians
from firmware_py.files.reading import open_regular
from hil.errors import UsageError
from hil.lab.identify.recording import Floats, Recording

REQUIRED = ("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s")
COLUMNS = (*REQUIRED, "speed_m_s")
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


def read(path: Path, rudder_unit: str = "rad") -> Recording:
    """Read a whole file; UsageError names the line and the remedy.

    rudder_unit: "rad"; "deg" converts; "any" takes the column for a signed command of whatever
    unit, such as the difference of two thrusters, so that K is per that unit.
    """
    try:
        with os.fdopen(open_regular(path, most_bytes=MOST_BYTES), encoding="utf-8-sig", newline="") as file:
            # A line is never read without end; one that is cut here is refused for the length of its field.
            return _read(path, csv.reader(iter(lambda: file.readline(LONGEST_LINE), "")), rudder_unit)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}; give a manoeuvre CSV or an onboard .BIN log") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not text; give a manoeuvre CSV, or an onboard log whose name ends in .BIN") from None


def _read(path: Path, reader: Iterator[list[str]], unit: str) -> Recording:
    lines = _lines(path, reader)
    first = next(lines, None)
    if first is None:
        raise UsageError(f"{path}: empty; the first line must name the columns {','.join(COLUMNS)}")
    header = [name.strip().lower() for name in first[1]]
    places = _places(path, first[0], header)
    numbers: list[int] = []
    texts: list[list[str]] = []
    for number, fields in lines:
        if len(fields) != len(header):
            raise UsageError(
                f"{path}:{number}: {len(fields)} fields under {len(header)} column names; "
                "mend or remove the line (a last line may have been cut)"
            )
        numbers.append(number)
        texts.append(fields)
        if len(texts) > MOST_ROWS:
            raise UsageError(f"{path}: more than {MOST_ROWS} rows; cut the file")
    if not texts:
        raise UsageError(f"{path}: no rows below the column names; record at least a zigzag")
    columns = {name: _column(path, numbers, [row[at] for row in texts], name) for name, at in places.items()}
    time_s = columns["time_s"]
    rudder = columns["rudder_rad"]
    if time_s is None or rudder is None:
        missing = "time_s" if time_s is None else "rudder_rad"
        raise UsageError(f"{path}:{numbers[0]}: column {missing} is empty; it must be filled")
    if columns["heading_rad"] is None and columns["yaw_rate_rad_s"] is None:
        raise UsageError(f"{path}:{numbers[0]}: heading_rad and yaw_rate_rad_s are both empty; fill one of them")
    _check_order(path, numbers, time_s)
    rudder, notes = _rudder(path, numbers, rudder, unit)
    return Recording(
        str(path), time_s, rudder, columns["heading_rad"], columns["yaw_rate_rad_s"], columns.get("speed_m_s"), notes
    )


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


def _places(path: Path, line: int, header: list[str]) -> dict[str, int]:
    missing = [name for name in REQUIRED if name not in header]
    if missing:
        raise UsageError(
            f"{path}:{line}: missing column{'s' if len(missing) > 1 else ''} {', '.join(missing)}; name the columns "
            f"{','.join(COLUMNS)} (an unmeasured heading, yaw rate or speed may be empty)"
        )
    twice = [name for name in COLUMNS if header.count(name) > 1]
    if twice:
        raise UsageError(f"{path}:{line}: column {twice[0]} stands there twice; remove one")
    return {name: header.index(name) for name in COLUMNS if name in header}


def _column(path: Path, numbers: list[int], texts: list[str], name: str) -> Floats | None:
    """Return the numbers of a column, None when it is empty throughout."""
    try:
        values = np.array(texts, dtype=np.float64)
    except ValueError:
        if name in MAY_BE_EMPTY and not any(text.strip() for text in texts):
            return None
        values = np.array([_number(text) for text in texts])
    most, remedy = BELIEVED.get(name, (math.inf, ""))
    wrong = np.flatnonzero(~(np.abs(values) <= most) | ~np.isfinite(values))
    if wrong.size == 0:
        return values
    at = int(wrong[0])
    where, text = f"{path}:{numbers[at]}", texts[at].strip()
    more = f" (and {wrong.size - 1} more like it)" if wrong.size > 1 else ""
    if not np.isfinite(values[at]):
        shown = "is empty" if not text else f"{text[:30]!r} is not a finite number"
        raise UsageError(f"{where}: {name} {shown}{more}; remove the row, or empty the whole column if it may be")
    raise UsageError(f"{where}: {name} {text[:30]} is beyond {most:g}{more}; {remedy}")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _check_order(path: Path, numbers: list[int], time_s: Floats) -> None:
    wrong = np.flatnonzero(np.diff(time_s) <= 0.0)
    if wrong.size:
        at = int(wrong[0])
        raise UsageError(
            f"{path}:{numbers[at + 1]}: time_s {time_s[at + 1]:g} does not come after {time_s[at]:g}; "
            "sort the rows by time and remove repeated ones"
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
