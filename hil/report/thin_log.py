"""The thin log of a boat, one row a minute, as arrays, and the data of its plots over days."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.calendar import is_possible
from firmware_py.common.geodesy import EARTH_RADIUS_M, Place
from firmware_py.log.log_time import corrected_utc_s
from firmware_py.log.open_file import open_buffer
from hil.errors import UsageError
from hil.report.log_records import records
from hil.sim.truth import Array

Rows = NDArray[np.intp]
DAY_S: Final = 86_400.0
_GAP_S: Final = 600.0  # no line is drawn across a longer gap between two rows
# Labels of the two records of a row; angles in radians, energies in joules.
_THIN_LABELS = ("Utc", "Sec", "Mod", "Arm", "Flt", "Lat", "Lng", "Rms", "Trv", "WT", "WSd")
_THNE_LABELS = ("Enr", "TSrv", "BatV", "SoC", "Sun", "Load", "Skip")


@dataclass(frozen=True, slots=True)
class ThinTable:
    """Rows of the thin log by column label, in order of time; NaN for unknown values.

    `undated_s` is the duration of the rows without a valid clock, which are not included.
    """

    columns: dict[str, Array]
    undated_s: float

    def __getitem__(self, label: str) -> Array:
        """Return a column."""
        return self.columns[label]

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return self.columns["Utc"].size


def read(paths: Sequence[Path]) -> ThinTable:
    """Read thin logs without rows of impossible times; raise UsageError for a log that cannot be read."""
    rows: list[tuple[float, ...]] = []
    times_s: list[float] = []
    columns = {"THIN": ("TimeUS", *_THIN_LABELS), "THNE": _THNE_LABELS}
    for path in paths:
        thin_values: tuple[float, ...] | None = None
        try:
            with open_buffer(path) as data:
                for name, values in records(data, columns):
                    if name == "THIN":
                        thin_values = values
                    elif thin_values is not None:
                        times_s.append(thin_values[0] / 1e6)
                        rows.append((*thin_values[1:], *values))
                        thin_values = None
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror or error}") from None
    utc_s = corrected_utc_s([row[0] for row in rows], times_s, [row[1] for row in rows])
    dated_rows = [(when_s, *row[1:]) for when_s, row in zip(utc_s, rows, strict=True) if is_possible(when_s)]
    undated_s = [row[1] for when_s, row in zip(utc_s, rows, strict=True) if not is_possible(when_s)]
    table = np.array(sorted(dated_rows), dtype=np.float64).reshape(-1, len(_THIN_LABELS) + len(_THNE_LABELS))
    return ThinTable(
        dict(zip((*_THIN_LABELS, *_THNE_LABELS), table.T.copy(), strict=True)), float(np.nansum(undated_s))
    )


def day_rows(table: ThinTable) -> Iterator[tuple[str, ...]]:
    """Yield a row of texts for each day, the header first."""
    yield "day (UTC)", "logged", "armed", "rms error", "rudder travel", "servo energy", "made good", "faults", "skipped"
    utc_s = table["Utc"]
    numbers = np.floor(utc_s / DAY_S).astype(int)
    for number in np.unique(numbers):
        day = numbers == number
        seconds = np.nan_to_num(table["Sec"][day])
        hours = float(seconds.sum()) / 3600.0
        rms = table["Rms"][day]
        is_known = np.isfinite(rms)
        mean = math.sqrt(float(np.average(rms[is_known] ** 2))) if is_known.any() else math.nan
        yield (
            dt.datetime.fromtimestamp(number * DAY_S, tz=dt.UTC).strftime("%Y-%m-%d"),
            f"{hours:.1f} h",
            f"{float(np.sum(seconds * table['Arm'][day])) / 3600.0:.1f} h",
            f"{math.degrees(mean):.1f} deg" if is_known.any() else "-",
            f"{math.degrees(float(np.nansum(table['Trv'][day]))):.0f} deg",
            f"{float(np.nansum(table['Enr'][day])) / 3600.0:.2f} Wh",
            f"{made_good_m(table, day) / 1000.0:.1f} km",
            f"{float(np.sum(seconds[table['Flt'][day] > 0])) / 60.0:.0f} min",
            f"{float(np.nansum(table['Skip'][day])):.0f}",
        )


def made_good_m(table: ThinTable, rows: NDArray[np.bool_]) -> float:
    """Return the distance between the first and the last known position of some rows."""
    lat, lng = table["Lat"], table["Lng"]
    known_rows = np.flatnonzero(rows & np.isfinite(lat) & np.isfinite(lng))
    if known_rows.size < 2:
        return 0.0
    begin, end = (Place(float(lat[row]), float(lng[row])) for row in (known_rows[0], known_rows[-1]))
    return begin.distance_and_bearing(end)[0]


def positions_m(table: ThinTable) -> tuple[Array, Array]:
    """Return the positions north and east of the first known position."""
    lat, lng = table["Lat"], table["Lng"]
    known_rows = np.flatnonzero(np.isfinite(lat) & np.isfinite(lng))
    if not known_rows.size:
        return lat, lng
    east_rad = np.remainder(lng - lng[known_rows[0]] + math.pi, math.tau) - math.pi
    return (lat - lat[known_rows[0]]) * EARTH_RADIUS_M, east_rad * math.cos(float(lat[known_rows[0]])) * EARTH_RADIUS_M


# Panels: name with unit, column, factor; drawn if any value is known.
PANELS: Final = (
    ("rms error, deg", "Rms", math.degrees(1.0)),
    ("rudder travel, deg/h", "Trv", math.degrees(3600.0)),
    ("servo power, W", "Enr", 1.0),
    ("fault active (1: any)", "Flt", 1.0),
    ("wave period, s", "WT", 1.0),
    ("servo temperature, deg C", "TSrv", 1.0),
    ("battery, V", "BatV", 1.0),
    ("state of charge, %", "SoC", 100.0),
)


def panel_values(table: ThinTable, panel: tuple[str, str, float]) -> Array:
    """Return the values of a panel, one for each row."""
    _, label, factor = panel
    values = table[label] * factor
    if label in ("Trv", "Enr"):  # sums over the duration of the row
        seconds = table["Sec"]
        values = np.divide(values, seconds, out=np.full_like(values, np.nan), where=seconds > 1.0)
    return np.asarray((values > 0.0).astype(float) if label == "Flt" else values)


def gap_rows(time_s: Array) -> Rows:
    """Return the numbers of the first rows after gaps."""
    return np.flatnonzero(np.diff(time_s) > _GAP_S) + 1


def with_breaks(time_s: Array, columns: Mapping[str, Array], gaps: Rows) -> dict[str, Array]:
    """Return the columns with NaN rows before the rows `gaps`, where lines of a plot are interrupted."""
    columns_with_breaks = {name: np.insert(values, gaps, np.nan) for name, values in columns.items()}
    return {"time_s": np.insert(time_s, gaps, (time_s[gaps - 1] + time_s[gaps]) / 2.0), **columns_with_breaks}
