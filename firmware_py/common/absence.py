"""Absent values at the border of the numeric core: NaN inside, None in the records of a tick."""

from __future__ import annotations

import math


def or_nan(value: float | None) -> float:
    """Return the value, or NaN for None."""
    return math.nan if value is None else value
