"""What really happened: one row every tenth of a second, kept by the world and written as truth.csv."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

COLUMNS = (
    "time_s",
    "heading_low_rad",
    "heading_rad",
    "yaw_rate_rad_s",
    "rudder_rad",
    "rudder_command_rad",
    "goal_rad",
    "north_m",
    "east_m",
    "speed_m_s",
)
ROWS_PER_SECOND = 10

Row = tuple[float, float, float, float, float, float, float | None, float, float, float]
Array = NDArray[np.float64]


@dataclass(slots=True)
class TruthRecorder:
    """The rows of a run, in order of time; a goal not yet given is None."""

    rows: list[Row] = field(default_factory=list)

    def write(self, path: Path) -> None:
        """Write the contract's CSV."""
        with path.open("w", newline="\n", encoding="ascii") as file:
            file.write(",".join(COLUMNS) + "\n")
            file.writelines(_line(row) for row in self.rows)

    def table(self) -> Truth:
        """Return the rows as arrays."""
        return _truth(self.rows)


@dataclass(frozen=True, slots=True)
class Truth:
    """The columns of truth.csv as arrays of equal length; goal_rad is NaN before the first goal."""

    time_s: Array
    heading_low_rad: Array
    heading_rad: Array
    yaw_rate_rad_s: Array
    rudder_rad: Array
    rudder_command_rad: Array
    goal_rad: Array
    north_m: Array
    east_m: Array
    speed_m_s: Array


def read(path: Path) -> Truth:
    """Read a truth.csv; ValueError when it is none."""
    with path.open(newline="", encoding="ascii") as file:
        reader = csv.reader(file)
        if tuple(next(reader, [])) != COLUMNS:
            raise ValueError(f"{path}: not a truth.csv; expected the columns {', '.join(COLUMNS)}")
        return _truth([float(text) if text else None for text in row] for row in reader)


def _truth(rows: Iterable[Iterable[float | None]]) -> Truth:
    values = np.array(list(rows), dtype=np.float64).reshape(-1, len(COLUMNS))
    return Truth(*values.T.copy())


def _line(row: Row) -> str:
    # Nine digits hold a heading to 1e-7 rad after many turns, and hide no difference that matters.
    numbers = ["" if value is None else f"{value:.9g}" for value in row]
    numbers[0] = f"{row[0]:.1f}"
    return ",".join(numbers) + "\n"
