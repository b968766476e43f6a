"""Columns of a sensor that is slower than the table: its last value stands there again until the next one comes.

Taken for readings of their rows, they are late by half of what the sensor takes, and T with them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.lab.identify.recording import LEAST_ROWS, Floats
from hil.lab.identify.table import Raw

LEAST_ROWS_EACH = 2
EXACT_BELOW, ONE_BELOW = 4, 10  # rows a value: below, it comes exactly so often; below, or one row sooner or later
REGULAR = 0.9  # of the values
FINE = 0.9  # of the steps, that are the least of a coarse sensor, beyond which it may stand still by itself


def emptied(raw: Raw, shown: dict[str, str], notes: list[str]) -> Raw:
    """Return columns in which a heading or a yaw rate stands only where it is new, if a sensor is slower than the rows.

    shown: what the file calls the columns. notes: what was done.
    """
    columns = dict(raw)
    for name in ("heading_rad", "yaw_rate_rad_s"):
        values = raw.get(name)
        each = 1 if values is None or np.isnan(values).any() else rows_each(values)
        if values is None or each < LEAST_ROWS_EACH:
            continue
        new = _new(values)
        columns[name] = np.where(new, values, np.nan)
        notes.append(f"{shown[name]} is new in every {each}th row only, as of a slower sensor: it counts there alone")
    return columns


def rows_each(values: Floats) -> int:
    """Return how many rows a value stands for, 1 if it may be a coarse sensor."""
    places = np.flatnonzero(_new(values))[1:]
    if places.size < LEAST_ROWS:
        return 1
    gaps = np.diff(places)
    usual = int(np.median(gaps))
    slack = 0 if usual < EXACT_BELOW else 1 if usual < ONE_BELOW else usual // ONE_BELOW
    times = np.maximum(np.round(gaps / max(usual, 1)), 1)
    if usual < LEAST_ROWS_EACH or float(np.mean(np.abs(gaps - usual * times) <= slack)) < REGULAR:
        return 1
    steps = np.abs(np.diff(values[places]))
    if float(np.mean(steps <= 1.5 * np.quantile(steps, 0.05))) > FINE:
        return 1
    return usual


def _new(values: Floats) -> NDArray[np.bool_]:
    """Return in which rows a value is another than in the row before."""
    return np.concatenate(([True], np.diff(values) != 0.0))
