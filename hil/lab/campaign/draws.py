"""What a value of a run is drawn from: fixed, one of several, or a distribution; by row, and by nothing else.

The number that row i draws for a name is the i-th block of the counter-based generator Philox under a key of the
seed and that name. So no row depends on another, and a name that a specification gains leaves the others' draws alone.
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
BLOCK = 4  # numbers of 64 bits that Philox makes of one count
LARGEST = 1e300
DIGITS = 6  # of a drawn number, so that it can be typed


class DrawError(ValueError):
    """A value that nothing can be drawn from; the text says how one is written."""


@dataclass(frozen=True, slots=True)
class Draw:
    """What a value is drawn from: values of which one is taken, or the numbers of a distribution."""

    kind: str
    values: tuple[Value, ...]

    @property
    def varies(self) -> bool:
        """Whether two rows can differ."""
        return len(set(self.values)) > 1

    def ends(self) -> tuple[Value, ...]:
        """Return all values, or the least and the largest that can be drawn."""
        return self.values if self.kind == CHOICE else DISTRIBUTIONS[self.kind].ends(self.values)

    def at(self, share: float) -> Value:
        """Return the value below which this share of the draws lies, 0 <= share < 1."""
        if self.kind == CHOICE:
            return self.values[int(share * len(self.values))]
        row = DISTRIBUTIONS[self.kind]
        low, high = map(float, row.ends(self.values))
        value = float(f"{row.quantile(share, *map(float, self.values)):.{DIGITS}g}")
        return min(max(value, low), high)


CHOICE = "one of"


@dataclass(frozen=True, slots=True)
class _Distribution:
    """One row: the names of its numbers, which of them bound it, whether they make sense, and its quantiles."""

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
REMEDY = "give a value, a list of which each run takes one, or " + ", ".join(
    f"{{{name} = [{', '.join(row.numbers)}]}}" for name, row in DISTRIBUTIONS.items()
)


def read_draw(content: Any, check: Callable[[Value], object]) -> Draw:
    """Read what a value is drawn from, or raise DrawError; check raises ValueError for a value that is not allowed."""
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
        raise DrawError(f"an empty list; {REMEDY}")
    return Draw(CHOICE, tuple(_value(value) for value in values))


def _distribution_of(content: dict[str, Any]) -> Draw:
    (name, numbers), *more = content.items() or [("", None)]
    row = DISTRIBUTIONS.get(name)
    if row is None or more or not isinstance(numbers, list) or len(numbers) != len(row.numbers):
        raise DrawError(f"{str(content)[:60]} is no distribution; {REMEDY}")
    values = tuple(_value(number) for number in numbers)
    if any(isinstance(value, str) for value in values) or not row.sound(*values):
        raise DrawError(f"{name} of {', '.join(map(str, numbers))[:60]} holds nothing; {REMEDY}")
    return Draw(name, values)


def _value(value: Any) -> Value:
    if isinstance(value, str):
        return value
    if value is None:
        raise DrawError(f"is lacking; {REMEDY}")
    if isinstance(value, bool | int | float) and abs(value) <= LARGEST:  # NaN is not
        return float(value)
    raise DrawError(f"{str(value)[:40]!r} is no value; {REMEDY}")


def blocks(seed: int, name: str, first: int, count: int) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """Return the first 64 bits of the blocks of rows first, first + 1, ..."""
    key = np.frombuffer(hashlib.sha256(f"{seed} {name}".encode()).digest()[:16], np.uint64)
    raw = np.random.Philox(key=key, counter=[first, 0, 0, 0]).random_raw(BLOCK * count)
    return np.asarray(raw[::BLOCK], np.uint64)


def shares(seed: int, name: str, first: int, count: int) -> list[float]:
    """Return the numbers in [0, 1) that rows first, first + 1, ... draw for a name."""
    return [float(bits >> 11) * 2.0**-53 for bits in blocks(seed, name, first, count).tolist()]
