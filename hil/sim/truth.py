"""The true state of the ship: one row every tenth of a second, written to truth.csv during the run."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hil.errors import HilError

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
FLOAT_COLUMN = "float_heading_low_rad"  # last column of runs with two bodies, where heading_low_rad is the glider's
ROWS_PER_SECOND = 10
PIECE_ROWS = 4096

# The values of COLUMNS, None for a goal before the first one; then those of additional columns.
Row = tuple[float, float, float, float, float, float, float | None, float, float, float, *tuple[float, ...]]
Array = NDArray[np.float64]


class Rows(Protocol):
    """A destination for the rows of a run in order of time, a file or a list."""

    def append(self, row: Row, /) -> None:
        """Add the next row."""


class TruthFile:
    """truth.csv, written during the run and read in pieces: only the file grows with the length of a run.

    `more` names additional columns at the end, which the readers here skip. Iterating yields the rows written so far
    in pieces of PIECE_ROWS, any number of times. HilError when the file cannot be written.
    """

    def __init__(self, path: Path, more: tuple[str, ...] = ()) -> None:
        """Create the file."""
        self.rows = 0
        self.end_s = 0.0  # the time of the last row
        self._path = path
        try:
            self._file = path.open("w", newline="\n", encoding="ascii")
        except OSError as error:
            raise self._failure(error) from None
        self._file.write(",".join((*COLUMNS, *more)) + "\n")

    def append(self, row: Row, /) -> None:
        """Write a row."""
        try:
            self._file.write(_line(row))
        except OSError as error:
            raise self._failure(error) from None
        self.rows += 1
        self.end_s = row[0]

    def close(self) -> None:
        """Flush and close the file; it can still be read."""
        try:
            self._file.close()
        except OSError as error:
            raise self._failure(error) from None

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces, after its end."""
        return pieces(self._path)

    def table(self) -> Truth:
        """Return the whole file as arrays, after its end; 80 bytes a row."""
        return read(self._path)

    def _failure(self, error: OSError) -> HilError:
        return HilError(f"{self._path} cannot be written: {error.strerror}")


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


@dataclass(frozen=True, slots=True)
class Recorded:
    """The truth.csv of a completed run, readable in pieces any number of times, as far as it was written."""

    path: Path

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces, none if its header is incomplete; ValueError when it is not a truth.csv."""
        with self.path.open("rb") as file:
            begun = file.readline(1 << 12).endswith(b"\n")
        return pieces(self.path) if begun else iter(())


def pieces(path: Path, rows: int = PIECE_ROWS) -> Iterator[Truth]:
    """Yield a truth.csv in pieces of `rows` rows, the last one shorter; ValueError for another file."""
    with path.open(newline="", encoding="ascii") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))  # a killed run may end within a line
        if tuple(next(reader, []))[: len(COLUMNS)] != COLUMNS:
            raise ValueError(f"{path}: not a truth.csv; expected the columns {', '.join(COLUMNS)}")
        while some := list(islice(reader, rows)):
            yield _truth([float(text) if text else math.nan for text in row[: len(COLUMNS)]] for row in some)


def read(path: Path) -> Truth:
    """Read a whole truth.csv; ValueError for another file."""
    parts = list(pieces(path)) or [_truth(())]
    return Truth(*(np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS))


def _truth(rows: Iterable[Iterable[float]]) -> Truth:
    values = np.array(list(rows), dtype=np.float64).reshape(-1, len(COLUMNS))
    return Truth(*values.T.copy())


def _line(row: Row) -> str:
    # Nine digits resolve a heading to 1e-7 rad after many turns.
    numbers = ["" if value is None else f"{value:.9g}" for value in row]
    numbers[0] = f"{row[0]:.1f}"
    return ",".join(numbers) + "\n"
