"""A recording of time, rudder and motion, and the selection of a part of it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError

Floats = NDArray[np.float64]

MIN_ROWS = 20
_RANGE = re.compile(r"^(?P<path>.+?):(?P<low>[^:/\\]*):(?P<high>[^:/\\]*)$")


@dataclass(frozen=True, slots=True)
class Source:
    """A file and the times of the part to use, in seconds of its time column; None means its start or end."""

    path: Path
    low_s: float | None = None
    high_s: float | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read FILE or FILE:from:to, or raise UsageError; the name of an existing file is not split."""
        match = None if Path(text).exists() else _RANGE.match(text)
        if match is None:
            return cls(Path(text))
        low, high = (_seconds(match[name], text) for name in ("low", "high"))
        if low is not None and high is not None and not low < high:
            raise UsageError(f"{text}: empty range from {low:g} to {high:g} s; give FILE:from:to with from < to")
        return cls(Path(match["path"]), low, high)

    def __str__(self) -> str:
        """Return the source as it is written on the command line."""
        if self.low_s is None and self.high_s is None:
            return str(self.path)
        low, high = ("" if value is None else f"{value:g}" for value in (self.low_s, self.high_s))
        return f"{self.path}:{low}:{high}"


@dataclass(frozen=True, slots=True)
class Recording:
    """The columns of a file: finite, of equal length, with increasing times.

    The heading is clockwise and need not be unwrapped; heading, yaw rate or speed is None if the file does not have it.
    The report prints `notes`, on changes of the data, and `warnings`, on doubts.
    """

    name: str
    time_s: Floats
    rudder_rad: Floats
    heading_rad: Floats | None
    yaw_rate_rad_s: Floats | None
    speed_m_s: Floats | None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def part(self, source: Source) -> Recording:
        """Return the rows from low_s to high_s, or raise UsageError for too few."""
        low = -np.inf if source.low_s is None else source.low_s
        high = np.inf if source.high_s is None else source.high_s
        first, last = np.searchsorted(self.time_s, (low, high), side="left")
        if source.high_s is None:
            last = self.time_s.size
        if last - first < MIN_ROWS:
            span = f"{self.time_s[0]:g} to {self.time_s[-1]:g} s" if self.time_s.size else "nothing"
            raise UsageError(
                f"{source}: too short, {max(0, last - first)} rows; the file covers {span}; "
                f"give at least {MIN_ROWS} rows, better 50 times the turning lag"
            )
        return replace(self.rows(slice(int(first), int(last))), name=str(source))

    def rows(self, rows: slice | NDArray[np.bool_]) -> Recording:
        """Return selected rows."""
        columns = (self.heading_rad, self.yaw_rate_rad_s, self.speed_m_s)
        heading, rate, speed = (None if column is None else column[rows] for column in columns)
        return replace(
            self,
            time_s=self.time_s[rows],
            rudder_rad=self.rudder_rad[rows],
            heading_rad=heading,
            yaw_rate_rad_s=rate,
            speed_m_s=speed,
        )


def _seconds(text: str, source_text: str) -> float | None:
    if not text.strip():
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = np.nan
    if not np.isfinite(seconds):
        raise UsageError(f"{source_text}: {text!r} is not a number of seconds; give FILE:from:to, or only FILE")
    return seconds
