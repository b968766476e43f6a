"""What really happened: one row every tenth of a second, written to truth.csv as the run goes."""

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
FLOAT_COLUMN = "float_heading_low_rad"  # a last column of runs with two bodies, whose hull is the glider
ROWS_PER_SECOND = 10
PIECE_ROWS = 4096

# Of COLUMNS, a goal not yet given is None, and of what else this run records.
Row = tuple[float, float, float, float, float, float, float | None, float, float, float, *tuple[float, ...]]
Array = NDArray[np.float64]


class Rows(Protocol):
    """What takes the rows of a run in order of time, a file or a list; a goal not yet given is None."""

    def append(self, row: Row, /) -> None:
        """Take the next row."""


class TruthFile:
    """truth.csv, written while the run goes on and read in pieces: only the file grows with the length of a run.

    `more` names columns behind the contract's, which rows bring along and readers here pass over.
    Iterating yields what has been written in pieces of PIECE_ROWS, as often as it is done. HilError when the file
    cannot be written.
    """

    def __init__(self, path: Path, more: tuple[str, ...] = ()) -> None:
        """Begin a new file."""
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
        """Write out what is left and close the file; it can be read on."""
        try:
            self._file.close()
        except OSError as error:
            raise self._failure(error) from None

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces; after its end."""
        return pieces(self._path)

    def table(self) -> Truth:
        """Return the whole file as arrays, after its end; they take 80 bytes a row."""
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
    """The truth.csv of a run that is over, to be read in pieces as often as wanted, as far as it goes."""

    path: Path

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces, none where not even its head is whole; ValueError when it is no truth.csv."""
        with self.path.open("rb") as file:
            begun = file.readline(1 << 12).endswith(b"\n")
        return pieces(self.path) if begun else iter(())


def pieces(path: Path, rows: int = PIECE_ROWS) -> Iterator[Truth]:
    """Yield a truth.csv in pieces of so many rows, the last one shorter; ValueError when it is none."""
    with path.open(newline="", encoding="ascii") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))  # a run that was killed may end amid a line
        if tuple(next(reader, []))[: len(COLUMNS)] != COLUMNS:
            raise ValueError(f"{path}: not a truth.csv; expected the columns {', '.join(COLUMNS)}")
        while some := list(islice(reader, rows)):
            yield _truth([float(text) if text else math.nan for text in row[: len(COLUMNS)]] for row in some)


def read(path: Path) -> Truth:
    """Read a whole truth.csv; ValueError when it is none."""
    parts = list(pieces(path)) or [_truth(())]
    return Truth(*(np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS))


def _truth(rows: Iterable[Iterable[float]]) -> Truth:
    values = np.array(list(rows), dtype=np.float64).reshape(-1, len(COLUMNS))
    return Truth(*values.T.copy())


def _line(row: Row) -> str:
    # Nine digits hold a heading to 1e-7 rad after many turns, and hide no difference that matters.
    numbers = ["" if value is None else f"{value:.9g}" for value in row]
    numbers[0] = f"{row[0]:.1f}"
    return ",".join(numbers) + "\n"
