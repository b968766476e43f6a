"""Absent values at the border of the numeric core: NaN there, None in the records of a tick."""

from __future__ import annotations

import math


def or_nan(value: float | None) -> float:
    """Return NaN for a value that is absent."""
    return math.nan if value is None else value
