"""Places and numbers of plan items in the units of the boat."""

from __future__ import annotations

import math

from firmware_py.common.angles import radians
from firmware_py.common.geodesy import Place
from firmware_py.common.plan import PlanItem


def place_of(item: PlanItem) -> Place | None:
    """Return the place of an item, None for 'where the boat is' and for what is on no globe."""
    if (item.x == 0 and item.y == 0) or abs(item.x) > 900_000_000 or abs(item.y) > 1_800_000_000:
        return None
    return Place(radians(item.x * 1e-7), radians(item.y * 1e-7))


def number(value: float, low: float, high: float) -> float:
    """Return a parameter within its bounds; an absent one (NaN) is 0 within them."""
    return min(max(0.0 if math.isnan(value) else value, low), high)
