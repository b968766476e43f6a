"""What can be said of many runs, and how surely: shares, rank correlations, differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.sim.truth import Array

NINETY_FIVE = 1.959963984540054  # standard deviations to either side that hold 95 % of a normal distribution
RANK_SPREAD = 1.03  # of a rank correlation's transform by that of a product-moment one (Fieller, Hartley, Pearson 1957)
RESAMPLES = 2000
GROUPS = 5000  # in which more numbers than that are drawn
LEAST = 8  # runs that a statement is made of


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and the ends of its 95 % confidence interval."""

    value: float
    low: float
    high: float


def share(count: int, of: int) -> Estimate:
    """Return a share with Wilson's interval."""
    if of == 0:
        return Estimate(0.0, 0.0, 1.0)
    part, z = count / of, NINETY_FIVE**2 / of
    middle = (part + z / 2.0) / (1.0 + z)
    reach = NINETY_FIVE * math.sqrt(part * (1.0 - part) / of + z / (4.0 * of)) / (1.0 + z)
    return Estimate(part, max(0.0, middle - reach), min(1.0, middle + reach))


def ranks(values: Array) -> Array:
    """Return the ranks of numbers from 1 up, equal ones their mean; infinity is the largest."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    ends = np.concatenate((begins[1:], [values.size]))
    found = np.empty(values.size)
    found[order] = np.repeat(0.5 * (begins + 1 + ends), ends - begins)
    return found


def rank_correlation(first: Array, second: Array, groups: NDArray[Any]) -> Estimate | None:
    """Return Spearman's correlation within groups, pooled; None for too few pairs, or where one does not vary.

    NaN is left out.
    """
    there = ~(np.isnan(first) | np.isnan(second))
    one, other, groups = first[there], second[there], groups[there]
    names, number = np.unique(groups, return_inverse=True)
    for each in range(len(names)):
        inside = number == each
        one[inside], other[inside] = _centred(one[inside]), _centred(other[inside])
    freedom = one.size - len(names) - 2
    if freedom < LEAST or not np.any(one) or not np.any(other):
        return None
    value = float(np.sum(one * other) / math.sqrt(np.sum(one * one) * np.sum(other * other)))
    # On Fisher's scale the error hardly depends on the value.
    middle = math.atanh(max(-1.0 + 1e-12, min(1.0 - 1e-12, value)))
    reach = NINETY_FIVE * RANK_SPREAD / math.sqrt(freedom)
    return Estimate(value, math.tanh(middle - reach), math.tanh(middle + reach))


def _centred(values: Array) -> Array:
    """Return the ranks as shares of their number, about their mean."""
    found = ranks(values)
    return (found - np.mean(found)) / values.size


def mean(values: Array, seed: int) -> Estimate:
    """Return the mean with its interval by the bootstrap, drawn with a seed."""
    resampled = _resampled(values, np.random.default_rng(seed))
    return _between(float(np.mean(values)), resampled)


def difference(before: Array, after: Array, seed: int) -> Estimate:
    """Return by how much the mean of independent runs differs, with its interval by the bootstrap."""
    random = np.random.default_rng(seed)
    resampled = _resampled(after, random) - _resampled(before, random)
    return _between(float(np.mean(after) - np.mean(before)), resampled)


def _between(value: float, resampled: Array) -> Estimate:
    low, high = np.quantile(resampled, (0.025, 0.975)).tolist()
    return Estimate(value, low, high)


def _resampled(values: Array, random: np.random.Generator) -> Array:
    """Return means of as many numbers, drawn from them with replacement; many numbers are drawn in groups."""
    groups = min(values.size, GROUPS)
    begins = np.arange(groups) * values.size // groups
    sums, sizes = np.add.reduceat(values, begins), np.diff(begins, append=values.size)
    counts = random.multinomial(groups, np.full(groups, 1.0 / groups), RESAMPLES)
    return np.asarray((counts @ sums) / (counts @ sizes))
