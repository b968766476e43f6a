"""Random draws of a campaign: each name has a fixed value, a choice or a distribution.

Row i uses block i of the counter-based generator Philox, whose key is a hash of the seed and the name. Therefore no row
depends on another row, and a name that is added to a specification does not change the draws of the others.
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
MAX_VALUE = 1e300
DIGITS = 6  # significant digits of a drawn number, short enough to be typed


class DrawError(ValueError):
    """An invalid draw; the text contains the remedy."""


@dataclass(frozen=True, slots=True)
class Draw:
    """A draw: the values of a choice, or the parameters of a distribution; `kind`: CHOICE, or key of DISTRIBUTIONS."""

    kind: str
    values: tuple[Value, ...]

    @property
    def has_variation(self) -> bool:
        """Return whether two rows can draw different values."""
        return len(set(self.values)) > 1

    def limits(self) -> tuple[Value, ...]:
        """Return all values of a choice, or the limits of a distribution."""
        return self.values if self.kind == CHOICE else DISTRIBUTIONS[self.kind].limits(self.values)

    def quantile(self, fraction: float) -> Value:
        """Return the quantile for a probability, 0 <= fraction < 1."""
        if self.kind == CHOICE:
            return self.values[int(fraction * len(self.values))]
        distribution = DISTRIBUTIONS[self.kind]
        low, high = map(float, distribution.limits(self.values))
        value = float(f"{distribution.quantile(fraction, *map(float, self.values)):.{DIGITS}g}")
        return min(max(value, low), high)


CHOICE = "one of"


@dataclass(frozen=True, slots=True)
class _Distribution:
    """A distribution: names of its parameters, its limits, check of the parameters, and quantile function."""

    parameters: tuple[str, ...]
    limits: Callable[[Sequence[Value]], tuple[Value, ...]]
    is_valid: Callable[..., bool]
    quantile: Callable[..., float]


def _uniform(fraction: float, low: float, high: float) -> float:
    return low + fraction * (high - low)


def _log_uniform(fraction: float, low: float, high: float) -> float:
    return low * math.exp(fraction * math.log(high / low))


def _normal(fraction: float, mean: float, sd: float, low: float, high: float) -> float:
    normal = NormalDist(mean, sd)
    low_fraction = normal.cdf(low)
    total_fraction = low_fraction + fraction * (normal.cdf(high) - low_fraction)
    return normal.inv_cdf(total_fraction) if 0.0 < total_fraction < 1.0 else low


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
        lambda mean, sd, low, high: sd > 0.0 and low < high and max(low - mean, mean - high) < 6.0 * sd,
        _normal,
    ),
}
REMEDY = "give a value, a list to choose from, or " + ", ".join(
    f"{{{name} = [{', '.join(distribution.parameters)}]}}" for name, distribution in DISTRIBUTIONS.items()
)


def read_draw(content: Any, check: Callable[[Value], object]) -> Draw:
    """Read a draw, or raise DrawError; `check` raises ValueError for a value that is not allowed."""
    draw = _draw_of(content)
    for value in draw.limits():
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
    (name, numbers), *others = content.items() or [("", None)]
    distribution = DISTRIBUTIONS.get(name)
    if distribution is None or others or not isinstance(numbers, list) or len(numbers) != len(distribution.parameters):
        raise DrawError(f"{str(content)[:60]} is not a distribution; {REMEDY}")
    values = tuple(_value(number) for number in numbers)
    if any(isinstance(value, str) for value in values) or not distribution.is_valid(*values):
        raise DrawError(f"{name} of {', '.join(map(str, numbers))[:60]} is an empty range; {REMEDY}")
    return Draw(name, values)


def _value(value: Any) -> Value:
    if isinstance(value, str):
        return value
    if value is None:
        raise DrawError(f"is missing; {REMEDY}")
    if isinstance(value, bool | int | float) and abs(value) <= MAX_VALUE:  # false for NaN
        return float(value)
    raise DrawError(f"{str(value)[:40]!r} is not a value; {REMEDY}")


def blocks(seed: int, name: str, first: int, count: int) -> np.ndarray[Any, np.dtype[np.uint64]]:
    """Return the first 64 bits of the Philox blocks of rows first, first + 1, ..."""
    key = np.frombuffer(hashlib.sha256(f"{seed} {name}".encode()).digest()[:16], np.uint64)
    raw = np.random.Philox(key=key, counter=[first, 0, 0, 0]).random_raw(BLOCK * count)
    return np.asarray(raw[::BLOCK], np.uint64)


def uniform_numbers(seed: int, name: str, first: int, count: int) -> list[float]:
    """Return the uniform random numbers in [0, 1) of a name for the rows first, first + 1, ..."""
    return [float(bits >> 11) * 2.0**-53 for bits in blocks(seed, name, first, count).tolist()]
