"""Sort the rows of a table by time, and remove rows without time and repeated rows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.recording import MIN_ROWS, Floats
from hil.lab.identify.table import Raw, Table

MAX_LATE_ROWS = 10  # largest distance over which a row is moved
MAX_SAME_TIME_FRACTION = 0.05  # of rows that have the time of the previous row


def clean_rows(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows without time and repeated rows, and sort rows that are at most MAX_LATE_ROWS late."""
    return _remove_same_times(*_sort_late_rows(*_remove_identical(*_remove_untimed(table, raw))))


def _remove_untimed(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows without time; some loggers write them at the end."""
    time_s = raw["time_s"]
    is_known = np.zeros(0, dtype=bool) if time_s is None else ~np.isnan(time_s)
    if is_known.all():
        return table, raw
    table.notes.append(f"{np.count_nonzero(~is_known)} rows have no time and are ignored")
    return select_rows(table, raw, is_known)


def _remove_identical(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove rows that are identical to the previous one, including the time."""
    table_values = np.column_stack([values for values in raw.values() if values is not None])
    is_same = np.all(
        (table_values[1:] == table_values[:-1]) | (np.isnan(table_values[1:]) & np.isnan(table_values[:-1])), axis=1
    )
    is_new = np.concatenate(([True], ~is_same))
    if not is_same.any() or np.count_nonzero(is_new) < 2:
        return table, raw
    table.notes.append(f"{np.count_nonzero(is_same)} rows are identical to the previous one and are ignored")
    return select_rows(table, raw, is_new)


def select_rows(table: Table, raw: Raw, rows: NDArray[np.bool_ | np.intp]) -> tuple[Table, Raw]:
    """Return table and columns with selected rows."""
    line_numbers = np.asarray(table.line_numbers)[rows].tolist()
    return replace(table, line_numbers=line_numbers), {
        name: None if values is None else values[rows] for name, values in raw.items()
    }


def _sort_late_rows(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Sort late rows, as from several senders; check_time_order refuses a clock that was set back further."""
    time_s = raw["time_s"]
    if time_s is None or np.all(np.diff(time_s) > 0.0):
        return table, raw
    order = np.argsort(time_s, kind="stable")
    distance = np.abs(order - np.arange(order.size))
    late_count = np.count_nonzero(np.diff(time_s) < 0.0)
    if np.max(distance) > MAX_LATE_ROWS or late_count == 0:
        return table, raw
    table.notes.append(f"{late_count} row{'s' if late_count > 1 else ''} came after a later one; rows sorted by time")
    return select_rows(table, raw, order)


def _remove_same_times(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Remove the second of two rows with the same time if that is rare; otherwise the clock is coarse."""
    time_s = raw["time_s"]
    if time_s is None:
        return table, raw
    is_repeated = np.concatenate(([False], np.diff(time_s) == 0.0))
    count = int(np.count_nonzero(is_repeated))
    if count == 0 or count > max(1, MAX_SAME_TIME_FRACTION * is_repeated.size):
        return table, raw
    line = table.line_numbers[int(np.argmax(is_repeated))]
    table.notes.append(
        f"{count} row{'s have' if count > 1 else ' has'} the time of the previous row (first in line {line}) and "
        f"{'are' if count > 1 else 'is'} ignored"
    )
    return select_rows(table, raw, ~is_repeated)


def check_time_order(table: Table, time_s: Floats) -> None:
    """Raise UsageError with the line number if the times do not increase."""
    invalid = np.flatnonzero(np.diff(time_s) <= 0.0)
    if invalid.size:
        first = int(invalid[0])
        raise UsageError(
            f"{table.path}:{table.line_numbers[first + 1]}: time_s {time_s[first + 1]:g} is not later than "
            f"{time_s[first]:g}; sort the rows by time and remove repeated ones; split the file where the clock was "
            "set back"
        )


MIN_REPEATS = 2
EXACT_BELOW, ONE_BELOW = 4, 10  # rows per value: tolerance of 0 rows below 4, of 1 row below 10, else a tenth
MIN_REGULAR_FRACTION = 0.9  # of the values that come at the regular interval
MAX_SMALL_STEP_FRACTION = 0.9  # with more steps of the smallest size, the resolution may cause the repetitions


def remove_repeated_values(raw: Raw, labels: dict[str, str], notes: list[str]) -> Raw:
    """Replace repeated values of a heading or yaw rate sensor that is slower than the rows by NaN.

    labels: names of the columns in the file. A note on each change is appended to `notes`.
    """
    columns = dict(raw)
    for name in ("heading_rad", "yaw_rate_rad_s"):
        values = raw.get(name)
        row_count = 1 if values is None or np.isnan(values).any() else rows_per_value(values)
        if values is None or row_count < MIN_REPEATS:
            continue
        is_new = _is_new(values)
        columns[name] = np.where(is_new, values, np.nan)
        notes.append(f"{labels[name]} changes in every {row_count}th row only (slower sensor): repeated values ignored")
    return columns


def rows_per_value(values: Floats) -> int:
    """Return the number of rows per sensor value; 1 if a coarse resolution may cause the repetitions."""
    new_rows = np.flatnonzero(_is_new(values))[1:]
    if new_rows.size < MIN_ROWS:
        return 1
    gaps = np.diff(new_rows)
    usual_gap = int(np.median(gaps))
    tolerance = 0 if usual_gap < EXACT_BELOW else 1 if usual_gap < ONE_BELOW else usual_gap // ONE_BELOW
    multiples = np.maximum(np.round(gaps / max(usual_gap, 1)), 1)
    if (
        usual_gap < MIN_REPEATS
        or float(np.mean(np.abs(gaps - usual_gap * multiples) <= tolerance)) < MIN_REGULAR_FRACTION
    ):
        return 1
    steps = np.abs(np.diff(values[new_rows]))
    if float(np.mean(steps <= 1.5 * np.quantile(steps, 0.05))) > MAX_SMALL_STEP_FRACTION:
        return 1
    return usual_gap


def _is_new(values: Floats) -> NDArray[np.bool_]:
    """Return the rows whose value differs from that of the previous row."""
    return np.concatenate(([True], np.diff(values) != 0.0))


MAX_GAP = 10.0  # median intervals of a column; longer gaps are not interpolated


def fill_gaps(path: Path, time_s: Floats, raw: Raw, notes: list[str]) -> tuple[Raw, NDArray[np.bool_]]:
    """Interpolate missing cells; return the columns and which rows are usable, and append notes on the changes.

    A usable row has a heading, or a yaw rate if the table has no headings. Other missing cells are interpolated.
    """
    columns, rows = dict(raw), np.ones(time_s.size, dtype=bool)
    heading, rate = columns.get("heading_rad"), columns.get("yaw_rate_rad_s")
    if heading is not None and rate is not None and np.count_nonzero(~np.isnan(heading)) < MIN_ROWS:
        notes.append("heading_rad has too few values: ignored")
        columns["heading_rad"] = heading = None
    name = "yaw_rate_rad_s" if heading is None else "heading_rad"
    main_values = rate if heading is None else heading
    if main_values is not None and np.isnan(main_values).any():
        rows = ~np.isnan(main_values)
        notes.append(f"{np.count_nonzero(~rows)} of {rows.size} rows have no {name} and are ignored")
    for name in ("rudder_rad", "yaw_rate_rad_s", "speed_m_s"):
        values = columns.get(name)
        if values is None or not np.isnan(values[rows]).any():
            continue
        is_known = np.flatnonzero(~np.isnan(values))
        columns[name] = np.interp(time_s, time_s[is_known], values[is_known])
        is_missing, is_far = np.isnan(values) & rows, np.zeros(time_s.size, dtype=bool)
        if name != "speed_m_s":
            is_far = is_missing & _is_far(time_s, time_s[is_known])
            rows = rows & ~is_far
        notes.append(
            f"{name} is missing in {np.count_nonzero(is_missing)} of {rows.size} rows: "
            f"{np.count_nonzero(is_missing & ~is_far)} interpolated"
            + (f", {np.count_nonzero(is_far)} in long gaps ignored" if is_far.any() else "")
        )
    if np.count_nonzero(rows) < min(MIN_ROWS, time_s.size):
        raise UsageError(
            f"{path}: only {np.count_nonzero(rows)} rows have a heading or yaw rate with a rudder near it; "
            "fill the empty cells, or export the columns at common times"
        )
    return columns, rows


def _is_far(time_s: Floats, known_s: Floats) -> NDArray[np.bool_]:
    """Return the times in gaps that are too long for interpolation, or outside the known times."""
    next_index = np.searchsorted(known_s, time_s)
    is_inside = (next_index > 0) & (next_index < known_s.size)
    last_index = max(known_s.size - 1, 0)
    gap_s = known_s[np.minimum(next_index, last_index)] - known_s[np.maximum(next_index - 1, 0)]
    usual_gap = float(np.median(np.diff(known_s))) if known_s.size > 1 else 0.0
    return np.asarray(~is_inside | (gap_s > MAX_GAP * usual_gap))
