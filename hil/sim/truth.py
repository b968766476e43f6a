"""The true state of the ship: one row each tenth of a second, written to truth.csv during the run."""

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
FLOAT_COLUMN = "float_heading_low_rad"  # last column with two bodies; heading_low_rad is then that of the glider
ROWS_PER_SECOND = 10
ROWS_PER_PIECE = 4096

# The values of COLUMNS (the goal is None before the first goal), then those of additional columns.
Row = tuple[float, float, float, float, float, float, float | None, float, float, float, *tuple[float, ...]]
Array = NDArray[np.float64]


class Rows(Protocol):
    """A destination for the rows of a run in order of time, a file or a list."""

    def append(self, row: Row, /) -> None:
        """Add the next row."""


class TruthFile:
    """truth.csv, written during the run and read in pieces, so that memory does not grow with the length of a run.

    The readers here skip `extra_columns`. Iterating yields the rows written so far in pieces of ROWS_PER_PIECE, any
    number of times. Raises HilError if the file cannot be written.
    """

    def __init__(self, path: Path, extra_columns: tuple[str, ...] = ()) -> None:
        """Create the file."""
        self.rows = 0
        self.end_s = 0.0  # the time of the last row
        self._path = path
        try:
            self._file = path.open("w", newline="\n", encoding="ascii")
        except OSError as error:
            raise self._write_error(error) from None
        self._file.write(",".join((*COLUMNS, *extra_columns)) + "\n")

    def append(self, row: Row, /) -> None:
        """Write a row."""
        try:
            self._file.write(_format_row(row))
        except OSError as error:
            raise self._write_error(error) from None
        self.rows += 1
        self.end_s = row[0]

    def close(self) -> None:
        """Flush and close the file; it can still be read."""
        try:
            self._file.close()
        except OSError as error:
            raise self._write_error(error) from None

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces, after its end."""
        return pieces(self._path)

    def table(self) -> Truth:
        """Return the whole file as arrays, after its end; 80 bytes a row."""
        return read(self._path)

    def _write_error(self, error: OSError) -> HilError:
        return HilError(f"{self._path} cannot be written: {error.strerror}")


@dataclass(frozen=True, slots=True)
class Truth:
    """The columns of truth.csv as arrays of equal length; headings are unwrapped.

    heading_low_rad and yaw_rate_rad_s are those of the hull without wave yaw, heading_rad is with it. Rudder angles are
    positive to starboard. goal_rad is NaN before the first goal. speed_m_s is through the water.
    """

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
class RecordedTruth:
    """The truth.csv of an ended run, which can be read in pieces any number of times."""

    path: Path

    def __iter__(self) -> Iterator[Truth]:
        """Yield the file in pieces, none if its header is incomplete; raise ValueError for another file."""
        with self.path.open("rb") as file:
            has_header = file.readline(1 << 12).endswith(b"\n")
        return pieces(self.path) if has_header else iter(())


def pieces(path: Path, rows: int = ROWS_PER_PIECE) -> Iterator[Truth]:
    """Yield a truth.csv in pieces of `rows` rows; raise ValueError for another file."""
    with path.open(newline="", encoding="ascii") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))  # a killed run may end within a line
        if tuple(next(reader, []))[: len(COLUMNS)] != COLUMNS:
            raise ValueError(f"{path}: not a truth.csv; expected the columns {', '.join(COLUMNS)}")
        while rows_of_piece := list(islice(reader, rows)):
            yield _make_truth(
                [float(text) if text else math.nan for text in row[: len(COLUMNS)]] for row in rows_of_piece
            )


def read(path: Path) -> Truth:
    """Read a whole truth.csv; raise ValueError for another file."""
    all_pieces = list(pieces(path)) or [_make_truth(())]
    return Truth(*(np.concatenate([getattr(piece, name) for piece in all_pieces]) for name in COLUMNS))


def _make_truth(rows: Iterable[Iterable[float]]) -> Truth:
    values = np.array(list(rows), dtype=np.float64).reshape(-1, len(COLUMNS))
    return Truth(*values.T.copy())


def _format_row(row: Row) -> str:
    # Nine digits resolve a heading to 1e-7 rad after many turns.
    numbers = ["" if value is None else f"{value:.9g}" for value in row]
    numbers[0] = f"{row[0]:.1f}"
    return ",".join(numbers) + "\n"
