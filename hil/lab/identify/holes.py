"""Missing cells of a table: short gaps are interpolated, rows in longer ones left out; both are noted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.recording import LEAST_ROWS, Floats
from hil.lab.identify.table import Raw

LONGEST_HOLE = 10.0  # usual intervals of a column; a longer gap is not interpolated


def filled(path: Path, time_s: Floats, raw: Raw, notes: list[str]) -> tuple[Raw, NDArray[np.bool_]]:
    """Return columns without holes, and the rows to be kept.

    A row counts where there is a heading, or a yaw rate where the table has no headings: these are not invented. What
    else is missing there lies between what was before and behind. notes: what was done.
    """
    columns, rows = dict(raw), np.ones(time_s.size, dtype=bool)
    heading, rate = columns.get("heading_rad"), columns.get("yaw_rate_rad_s")
    if heading is not None and rate is not None and np.count_nonzero(~np.isnan(heading)) < LEAST_ROWS:
        notes.append("heading_rad is hardly ever there: left out")
        columns["heading_rad"] = heading = None
    name = "yaw_rate_rad_s" if heading is None else "heading_rad"
    base = rate if heading is None else heading
    if base is not None and np.isnan(base).any():
        rows = ~np.isnan(base)
        notes.append(f"{np.count_nonzero(~rows)} of {rows.size} rows have no {name}, and are left out")
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
            f"{np.count_nonzero(missing & ~far)} lie between what is before and behind"
            + (f", {np.count_nonzero(far)} are too far from any and left out" if far.any() else "")
        )
    if np.count_nonzero(rows) < min(LEAST_ROWS, time_s.size):
        raise UsageError(
            f"{path}: only {np.count_nonzero(rows)} rows have a heading or yaw rate with a rudder near it; "
            "fill the empty cells, or export the columns at common times"
        )
    return columns, rows


def _far(time_s: Floats, known_s: Floats) -> NDArray[np.bool_]:
    """Return which times lie in a hole between known ones that is too long to be bridged, or beyond them."""
    after = np.searchsorted(known_s, time_s)
    inside = (after > 0) & (after < known_s.size)
    last = max(known_s.size - 1, 0)
    hole = known_s[np.minimum(after, last)] - known_s[np.maximum(after - 1, 0)]
    usual = float(np.median(np.diff(known_s))) if known_s.size > 1 else 0.0
    return np.asarray(~inside | (hole > LONGEST_HOLE * usual))
