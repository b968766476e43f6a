"""Sort the rows of a table by time, and remove rows without time and repeated rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.recording import MIN_ROWS, Floats
from hil.lab.identify.table import Raw, Table

MAX_LATE_ROWS = 10  # rows that one comes after where it belongs
MAX_SHARED = 0.05  # of the rows, that have the time of the row before


def in_order(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows without time and repeated rows, and sort rows that are a little late."""
    return _one_a_time(*_sorted(*_once(*_timed(table, raw))))


def _timed(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows without time, as some loggers write at the end."""
    time_s = raw["time_s"]
    known = np.zeros(0, dtype=bool) if time_s is None else ~np.isnan(time_s)
    if known.all():
        return table, raw
    table.notes.append(f"{np.count_nonzero(~known)} rows have no time and are ignored")
    return kept(table, raw, known)


def _once(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows that are identical to the previous one, including the time."""
    whole = np.column_stack([values for values in raw.values() if values is not None])
    same = np.all((whole[1:] == whole[:-1]) | (np.isnan(whole[1:]) & np.isnan(whole[:-1])), axis=1)
    new = np.concatenate(([True], ~same))
    if not same.any() or np.count_nonzero(new) < 2:
        return table, raw
    table.notes.append(f"{np.count_nonzero(same)} rows are identical to the previous one and are ignored")
    return kept(table, raw, new)


def kept(table: Table, raw: Raw, rows: NDArray[np.bool_ | np.intp]) -> tuple[Table, Raw]:
    """Return table and columns with selected rows."""
    numbers = np.asarray(table.numbers)[rows].tolist()
    return replace(table, numbers=numbers), {
        name: None if values is None else values[rows] for name, values in raw.items()
    }


def _sorted(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Sort rows that are a little late, as from several senders; a clock that was set back is an error later."""
    time_s = raw["time_s"]
    if time_s is None or np.all(np.diff(time_s) > 0.0):
        return table, raw
    order = np.argsort(time_s, kind="stable")
    moved = np.abs(order - np.arange(order.size))
    late = np.count_nonzero(np.diff(time_s) < 0.0)
    if np.max(moved) > MAX_LATE_ROWS or late == 0:
        return table, raw
    table.notes.append(f"{late} row{'s' if late > 1 else ''} came after a later one; rows sorted by time")
    return kept(table, raw, order)


def _one_a_time(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove the second of two rows with the same time if that is rare; otherwise the clock is coarse."""
    time_s = raw["time_s"]
    if time_s is None:
        return table, raw
    again = np.concatenate(([False], np.diff(time_s) == 0.0))
    count = int(np.count_nonzero(again))
    if count == 0 or count > max(1, MAX_SHARED * again.size):
        return table, raw
    line = table.numbers[int(np.argmax(again))]
    table.notes.append(
        f"{count} row{'s have' if count > 1 else ' has'} the time of the previous row (first in line {line}) and "
        f"{'are' if count > 1 else 'is'} ignored"
    )
    return kept(table, raw, ~again)


def check_order(table: Table, time_s: Floats) -> None:
    """Raise UsageError with the line for times that do not increase."""
    wrong = np.flatnonzero(np.diff(time_s) <= 0.0)
    if wrong.size:
        at = int(wrong[0])
        raise UsageError(
            f"{table.path}:{table.numbers[at + 1]}: time_s {time_s[at + 1]:g} is not later than {time_s[at]:g}; "
            "sort the rows by time and remove repeated ones; split the file where the clock was set back"
        )


MIN_REPEATS = 2
EXACT_BELOW, ONE_BELOW = 4, 10  # rows per value: below these limits with a tolerance of 0 rows and of 1 row
REGULAR_SHARE = 0.9  # of the values
COARSE_SHARE = 0.9  # with more steps of the smallest size, the repetitions may come from a coarse resolution


def without_repeats(raw: Raw, labels: dict[str, str], notes: list[str]) -> Raw:
    """Return columns with only the new values of a heading or yaw rate sensor that is slower than the rows.

    labels: names of the columns in the file. notes: gets the changes.
    """
    columns = dict(raw)
    for name in ("heading_rad", "yaw_rate_rad_s"):
        values = raw.get(name)
        each = 1 if values is None or np.isnan(values).any() else rows_each(values)
        if values is None or each < MIN_REPEATS:
            continue
        new = _new(values)
        columns[name] = np.where(new, values, np.nan)
        notes.append(f"{labels[name]} changes in every {each}th row only (slower sensor): repeated values ignored")
    return columns


def rows_each(values: Floats) -> int:
    """Return the number of rows per value, 1 if the sensor may be coarse."""
    places = np.flatnonzero(_new(values))[1:]
    if places.size < MIN_ROWS:
        return 1
    gaps = np.diff(places)
    usual = int(np.median(gaps))
    slack = 0 if usual < EXACT_BELOW else 1 if usual < ONE_BELOW else usual // ONE_BELOW
    times = np.maximum(np.round(gaps / max(usual, 1)), 1)
    if usual < MIN_REPEATS or float(np.mean(np.abs(gaps - usual * times) <= slack)) < REGULAR_SHARE:
        return 1
    steps = np.abs(np.diff(values[places]))
    if float(np.mean(steps <= 1.5 * np.quantile(steps, 0.05))) > COARSE_SHARE:
        return 1
    return usual


def _new(values: Floats) -> NDArray[np.bool_]:
    """Return the rows whose value differs from that of the previous row."""
    return np.concatenate(([True], np.diff(values) != 0.0))


MAX_HOLE = 10.0  # median intervals of a column; longer gaps are not interpolated


def filled(path: Path, time_s: Floats, raw: Raw, notes: list[str]) -> tuple[Raw, NDArray[np.bool_]]:
    """Return columns without missing cells, and the remaining rows; `notes` gets the changes.

    A row needs a heading, or a yaw rate if the table has no headings. Other missing cells are interpolated.
    """
    columns, rows = dict(raw), np.ones(time_s.size, dtype=bool)
    heading, rate = columns.get("heading_rad"), columns.get("yaw_rate_rad_s")
    if heading is not None and rate is not None and np.count_nonzero(~np.isnan(heading)) < MIN_ROWS:
        notes.append("heading_rad has too few values: ignored")
        columns["heading_rad"] = heading = None
    name = "yaw_rate_rad_s" if heading is None else "heading_rad"
    base = rate if heading is None else heading
    if base is not None and np.isnan(base).any():
        rows = ~np.isnan(base)
        notes.append(f"{np.count_nonzero(~rows)} of {rows.size} rows have no {name} and are ignored")
    for name in ("rudder_rad", "yaw_rate_rad_s", "speed_m_s"):
        values = columns.get(name)
        if values is None or not np.isnan(values[rows]).any():
            continue
        known = np.flatnonzero(~np.isnan(values))
        columns[name] = np.interp(time_s, time_s[known], values[known])
        missing, far = np.isnan(values) & rows, np.zeros(time_s.size, dtype=bool)
        if name != "speed_m_s":
            far = missing & _far(time_s, time_s[known])
            rows = rows & ~far
        notes.append(
            f"{name} is missing in {np.count_nonzero(missing)} of {rows.size} rows: "
            f"{np.count_nonzero(missing & ~far)} interpolated"
            + (f", {np.count_nonzero(far)} in long gaps ignored" if far.any() else "")
        )
    if np.count_nonzero(rows) < min(MIN_ROWS, time_s.size):
        raise UsageError(
            f"{path}: only {np.count_nonzero(rows)} rows have a heading or yaw rate with a rudder near it; "
            "fill the empty cells, or export the columns at common times"
        )
    return columns, rows


def _far(time_s: Floats, known_s: Floats) -> NDArray[np.bool_]:
    """Return the times in gaps that are too long for interpolation, or outside the known times."""
    after = np.searchsorted(known_s, time_s)
    inside = (after > 0) & (after < known_s.size)
    last = max(known_s.size - 1, 0)
    hole = known_s[np.minimum(after, last)] - known_s[np.maximum(after - 1, 0)]
    usual = float(np.median(np.diff(known_s))) if known_s.size > 1 else 0.0
    return np.asarray(~inside | (hole > MAX_HOLE * usual))
