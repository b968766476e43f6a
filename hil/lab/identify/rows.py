"""The rows of a table in order of time: without those that have none, and each once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.recording import Floats
from hil.lab.identify.table import Raw, Table

MOST_LATE = 10  # rows that one comes after where it belongs
MOST_SHARED = 0.05  # of the rows, that have the time of the row before


def in_order(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Leave out rows without a time and repeated ones, and sort those that come a little late."""
    return _one_a_time(*_sorted(*_once(*_timed(table, raw))))


def _timed(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Leave out rows without a time, as those are that a logger writes below the last one."""
    time_s = raw["time_s"]
    known = np.zeros(0, dtype=bool) if time_s is None else ~np.isnan(time_s)
    if known.all():
        return table, raw
    table.notes.append(f"{np.count_nonzero(~known)} rows have no time, and are left out")
    return kept(table, raw, known)


def _once(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Leave out rows that are the one before to the last digit, the time included."""
    whole = np.column_stack([values for values in raw.values() if values is not None])
    same = np.all((whole[1:] == whole[:-1]) | (np.isnan(whole[1:]) & np.isnan(whole[:-1])), axis=1)
    new = np.concatenate(([True], ~same))
    if not same.any() or np.count_nonzero(new) < 2:
        return table, raw
    table.notes.append(f"{np.count_nonzero(same)} rows are the one before to the last digit, and left out")
    return kept(table, raw, new)


def kept(table: Table, raw: Raw, rows: NDArray[np.bool_ | np.intp]) -> tuple[Table, Raw]:
    """Return the table and the columns with some of their rows."""
    numbers = np.asarray(table.numbers)[rows].tolist()
    return replace(table, numbers=numbers), {
        name: None if values is None else values[rows] for name, values in raw.items()
    }


def _sorted(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Sort rows that come a little late, as of several senders; a clock that was set back is left to be refused."""
    time_s = raw["time_s"]
    if time_s is None or np.all(np.diff(time_s) > 0.0):
        return table, raw
    order = np.argsort(time_s, kind="stable")
    moved = np.abs(order - np.arange(order.size))
    late = np.count_nonzero(np.diff(time_s) < 0.0)
    if np.max(moved) > MOST_LATE or late == 0:
        return table, raw
    table.notes.append(f"{late} row{'s' if late > 1 else ''} came after a later one, and the rows are sorted by time")
    return kept(table, raw, order)


def _one_a_time(table: Table, raw: Raw) -> tuple[Table, Raw]:
    """Leave out the second of two rows with one time, where that is rare; where it is usual, the clock is coarse."""
    time_s = raw["time_s"]
    if time_s is None:
        return table, raw
    again = np.concatenate(([False], np.diff(time_s) == 0.0))
    count = int(np.count_nonzero(again))
    if count == 0 or count > max(1, MOST_SHARED * again.size):
        return table, raw
    line = table.numbers[int(np.argmax(again))]
    table.notes.append(
        f"{count} row{'s have' if count > 1 else ' has'} the time of the row before (first in line {line}), and "
        f"{'are' if count > 1 else 'is'} left out"
    )
    return kept(table, raw, ~again)


def check_order(table: Table, time_s: Floats) -> None:
    """Refuse times that do not rise; UsageError names the line."""
    wrong = np.flatnonzero(np.diff(time_s) <= 0.0)
    if wrong.size:
        at = int(wrong[0])
        raise UsageError(
            f"{table.path}:{table.numbers[at + 1]}: time_s {time_s[at + 1]:g} does not come after {time_s[at]:g}; "
            "sort the rows by time and remove repeated ones; where the clock was set back, make two files of it"
        )
