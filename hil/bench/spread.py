"""What many samples of one quantity come to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Spread:
    """Percentiles of samples, in their unit; NaN where there were none."""

    count: int
    p50: float
    p95: float
    p99: float
    p999: float
    max: float


def spread(samples: Sequence[float]) -> Spread:
    """Return the percentiles of samples in any order."""
    ordered = sorted(samples)
    return Spread(len(ordered), *(percentile(ordered, part) for part in (50.0, 95.0, 99.0, 99.9, 100.0)))


def percentile(ordered: Sequence[float], part: float) -> float:
    """Return a percentile (0 to 100) of ascending samples, linear between neighbours; NaN of none."""
    if not ordered:
        return math.nan
    place = (len(ordered) - 1) * part / 100.0
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (ordered[above] - ordered[below]) * (place - below)
