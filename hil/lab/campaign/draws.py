"""Random draws of a campaign: a fixed value, a choice or a distribution for each name.

Row i draws the i-th block of the counter-based generator Philox, whose key is made of the seed and the name. So no row
depends on another row, and adding a name to a specification does not change the draws of the others.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

Value = float | str
BLOCK = 4  # 64-bit numbers that Philox generates for each counter value
LARGEST = 1e300
DIGITS = 6  # significant digits of a drawn number, short enough to be typed


class DrawError(ValueError):
    """An invalid draw; the text contains the remedy."""


@dataclass(frozen=True, slots=True)
class Draw:
    """A draw: the values of a choice, or the numbers of a distribution."""

    kind: str
    values: tuple[Value, ...]

    @property
    def varies(self) -> bool:
        """Return whether two rows can draw different values."""
        return len(set(self.values)) > 1

    def ends(self) -> tuple[Value, ...]:
        """Return all values of a choice, or the limits of a distribution."""
        return self.values if self.kind == CHOICE else DISTRIBUTIONS[self.kind].ends(self.values)

    def at(self, share: float) -> Value:
        """Return the quantile for a share, 0 <= share < 1."""
        if self.kind == CHOICE:
            return self.values[int(share * len(self.values))]
        row = DISTRIBUTIONS[self.kind]
        low, high = map(float, row.ends(self.values))
        value = float(f"{row.quantile(share, *map(float, self.values)):.{DIGITS}g}")
        return min(max(value, low), high)


CHOICE = "one of"


@dataclass(frozen=True, slots=True)
class _Distribution:
    """A distribution: names of its numbers, its limits, validity check and quantile function."""

    numbers: tuple[str, ...]
    ends: Callable[[Sequence[Value]], tuple[Value, ...]]
    sound: Callable[..., bool]
    quantile: Callable[..., float]


def _uniform(share: float, low: float, high: float) -> float:
    return low + share * (high - low)


def _log_uniform(share: float, low: float, high: float) -> float:
    return low * math.exp(share * math.log(high / low))


def _normal(share: float, mean: float, spread: float, low: float, high: float) -> float:
    normal = NormalDist(mean, spread)
    below = normal.cdf(low)
    inside = below + share * (normal.cdf(high) - below)
    return normal.inv_cdf(inside) if 0.0 < inside < 1.0 else low


DISTRIBUTIONS: Mapping[str, _Distribution] = {
    "uniform": _Distribution(
        ("low", "high"), lambda numbers: (numbers[0], numbers[1]), lambda low, high: low <= high, _uniform
    ),
    "log_uniform": _Distribution(
        ("low", "high"), lambda numbers: (numbers[0], numbers[1]), lambda low, high: 0.0 < low <= high, _log_uniform
    ),
    "normal": _Distribution(
        ("mean", "spread", "low", "high"),
        lambda numbers: (numbers[2], numbers[3]),
        lambda mean, spread, low, high: spread > 0.0 and low < high and max(low - mean, mean - high) < 6.0 * spread,
        _normal,
    ),
}
REMEDY = "give a value, a list to choose from, or " + ", ".join(
    f"{{{name} = [{', '.join(row.numbers)}]}}" for name, row in DISTRIBUTIONS.items()
)


def read_draw(content: Any, check: Callable[[Value], object]) -> Draw:
    """Read a draw, or raise DrawError; `check` raises ValueError for a value that is not allowed."""
    draw = _draw_of(content)
    for value in draw.ends():
        try:
            check(value)
        except ValueError as error:
            raise DrawError(str(error)) from None
    return draw


def _draw_of(content: Any) -> Draw:
    if isinstance(content, dict):
        return _distribution_of(content)
    values = content if isinstance(content, list) else [content]
    if not values:
        raise DrawError(f"list is empty; {REMEDY}")
    return Draw(CHOICE, tuple(_value(value) for value in values))


def _distribution_of(content: dict[str, Any]) -> Draw:
    (name, numbers), *more = content.items() or [("", None)]
    row = DISTRIBUTIONS.get(name)
    if row is None or more or not isinstance(numbers, list) or len(numbers) != len(row.numbers):
        raise DrawError(f"{str(content)[:60]} is not a distribution; {REMEDY}")
    values = tuple(_value(number) for number in numbers)
    if any(isinstance(value, str) for value in values) or not row.sound(*values):
        raise DrawError(f"{name} of {', '.join(map(str, numbers))[:60]} is an empty range; {REMEDY}")
    return Draw(name, values)


def _value(value: Any) -> Value:
    if isinstance(value, str):
        return value
    if value is None:
        raise DrawError(f"is missing; {REMEDY}")
    if isinstance(value, bool | int | float) and abs(value) <= LARGEST:  # false for NaN
        return float(value)
    raise DrawError(f"{str(value)[:40]!r} is not a value; {REMEDY}")


def blocks(seed: int, name: str, first: int, count: int) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """Return the first 64 bits of the Philox blocks of rows first, first + 1, ..."""
    key = np.frombuffer(hashlib.sha256(f"{seed} {name}".encode()).digest()[:16], np.uint64)
    raw = np.random.Philox(key=key, counter=[first, 0, 0, 0]).random_raw(BLOCK * count)
    return np.asarray(raw[::BLOCK], np.uint64)


def shares(seed: int, name: str, first: int, count: int) -> list[float]:
    """Return the numbers in [0, 1) that the rows first, first + 1, ... draw for a name."""
    return [float(bits >> 11) * 2.0**-53 for bits in blocks(seed, name, first, count).tolist()]
