"""Measured figures with a bare limit, a target and values of other autopilots; percentiles; pairs of runs."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

TIMES: Final = "times"  # the unit of a ratio to another quantity of the same run


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the result.

    `bare` is the cost of a minimal program on this machine. The target is an upper (`maximum`) or a lower (`minimum`)
    limit of the value, or an upper limit of its ratio to `bare`. `peer` is the same figure of other autopilots, as
    text. `paired_ratio` replaces the ratio where both programs ran in turns: the median over pairs of neighbouring
    runs, which a changing load does not shift. `repeats` contains the compared quantities of all repeats.
    """

    name: str
    unit: str
    value: float
    bare: float | None = None
    maximum: float | None = None
    maximum_ratio: float | None = None
    peer: str = ""
    minimum: float | None = None
    paired_ratio: float | None = None
    repeats: tuple[float, ...] = ()

    @property
    def ratio(self) -> float | None:
        """The value divided by the bare limit; None if there is none or it is zero."""
        if self.paired_ratio is not None:
            return self.paired_ratio
        return self.value / self.bare if self.bare else None

    @property
    def compared_quantity(self) -> float | None:
        """The quantity that depends least on machine and load: the ratio, or the value if its unit is TIMES."""
        return self.value if self.unit == TIMES else self.ratio

    @property
    def more_is_better(self) -> bool:
        """True if a larger value is better."""
        return self.unit == TIMES or self.minimum is not None

    @property
    def met(self) -> bool | None:
        """True if the target is met; None without a target."""
        if self.maximum is not None:
            return self.value <= self.maximum
        if self.minimum is not None:
            return self.value >= self.minimum
        if self.maximum_ratio is not None:
            return self.ratio is not None and self.ratio <= self.maximum_ratio
        return None


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one measurement: its figures, and notes on the method."""

    title: str
    figures: tuple[Figure, ...]
    notes: tuple[str, ...] = ()


def percentile(samples: Sequence[float], percent: float) -> float:
    """Return a percentile (0 to 100) of samples in any order, linear between neighbours; NaN without samples."""
    if not samples:
        return math.nan
    ordered = sorted(samples)
    position = (len(ordered) - 1) * percent / 100.0
    below = math.floor(position)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (ordered[above] - ordered[below]) * (position - below)


def paired_figure(
    name: str, unit: str, run_program: Callable[[], float], bare: Callable[[], float], pairs: int, scale: float = 1.0
) -> Figure:
    """Run a program and its bare limit in turns, and return the medians and the median ratio of neighbouring runs.

    Each callable returns the duration of its run; `scale` converts it to the unit.
    """
    durations = [(run_program(), bare()) for _ in range(pairs)]
    value, limit = (scale * statistics.median(column) for column in zip(*durations, strict=True))
    return Figure(
        name, unit, value, limit, paired_ratio=statistics.median(value_s / limit_s for value_s, limit_s in durations)
    )
