"""What can be said of many runs, and how surely: shares, rank correlations, differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtr, ndtri, stdtrit  # scipy.stats takes a second to import

from hil.sim.truth import Array

NINETY_FIVE = 1.959963984540054  # standard deviations to either side that hold 95 % of a normal distribution
RANK_SPREAD = 1.03  # of a rank correlation's transform by that of a product-moment one (Fieller, Hartley, Pearson 1957)
RESAMPLES = 2000
GROUPS = 5000  # in which more numbers than that are drawn
LEAST = 8  # runs that a statement is made of
TOLD = 0.8  # how often a difference is to be told that a number of runs is said to tell


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
    # Where all or none are, the end is exact, and rounding would show.
    return Estimate(part, max(0.0, middle - reach) if count else 0.0, min(1.0, middle + reach) if count < of else 1.0)


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
    return _between(float(np.mean(values)), resampled, values.size)


def difference(before: Array, after: Array, seed: int) -> Estimate:
    """Return by how much the mean of independent runs differs, with its interval by the bootstrap."""
    random = np.random.default_rng(seed)
    resampled = _resampled(after, random) - _resampled(before, random)
    return _between(float(np.mean(after) - np.mean(before)), resampled, min(before.size, after.size))


def told_from(spread: float, runs: int) -> float:
    """Return the least difference of a mean that so many runs tell four times of five, at 95 % confidence.

    `spread` is the standard deviation of what a run adds: of the differences of pairs, or of both kinds together.
    """
    return float(stdtrit(runs - 1, 0.975) + stdtrit(runs - 1, TOLD)) * spread / math.sqrt(runs)


def runs_to_tell(spread: float, least: float) -> int:
    """Return how many runs tell a difference as told_from does (Guenther, American Statistician 35, 1981)."""
    of_spread = (NINETY_FIVE + float(ndtri(TOLD))) * spread / least
    return max(LEAST, math.ceil(of_spread**2 + 0.5 * NINETY_FIVE**2))


def median(values: Array) -> Estimate:
    """Return the median, which may be infinite, between two values of the order that hold it in 95 % at least.

    Whatever the values are distributed like: each lies below the median as often as a coin shows heads.
    """
    ordered, runs = np.sort(values), values.size
    out = int(
        np.searchsorted(bdtr(np.arange(runs + 1), runs, 0.5), 0.025)
    )  # so many or fewer lie to one side in more than 2.5 %
    low, high = ordered[max(out - 1, 0)], ordered[min(runs - out, runs - 1)]
    middle = ordered[(runs - 1) // 2], ordered[runs // 2]
    value = np.mean(middle) if np.isfinite(middle).all() else min(middle, key=abs)
    return Estimate(float(value), float(low), float(high))


def median_difference(before: Array, after: Array) -> Estimate:
    """Return by how much the median of independent runs differs; the ends by those of either (Newcombe's way)."""
    one, other = median(before), median(after)
    if not (math.isfinite(one.value) and math.isfinite(other.value)):
        value = 0.0 if one.value == other.value else other.value - one.value
        return Estimate(value, -math.inf, math.inf)
    value = other.value - one.value
    return Estimate(
        value,
        value - math.hypot(other.value - other.low, one.high - one.value),
        value + math.hypot(other.high - other.value, one.value - one.low),
    )


def share_difference(before: NDArray[np.bool_], after: NDArray[np.bool_], *, paired: bool) -> Estimate:
    """Return by how much a share differs, with Newcombe's interval (Statistics in Medicine 17, 1998).

    It is made of Wilson's for either share, so that what never happened in a few runs is not said to be impossible.
    """
    one = share(int(np.count_nonzero(before)), before.size)
    other = share(int(np.count_nonzero(after)), after.size)
    alike = _likeness(before, after) if paired else 0.0
    value = other.value - one.value

    def reach(down: float, up: float) -> float:
        return math.sqrt(max(down * down - 2.0 * alike * down * up + up * up, 0.0))

    return Estimate(
        value,
        value - reach(other.value - other.low, one.high - one.value),
        value + reach(other.high - other.value, one.value - one.low),
    )


def _likeness(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> float:
    """Return the correlation of pairs of yes and no, with Newcombe's correction for few pairs."""
    both, neither = np.count_nonzero(before & after), np.count_nonzero(~before & ~after)
    first, second = np.count_nonzero(before & ~after), np.count_nonzero(~before & after)
    margins = float((both + first) * (second + neither) * (both + second) * (first + neither))
    if margins == 0.0:
        return 0.0
    alike = float(both * neither - first * second)
    return (max(alike - before.size / 2.0, 0.0) if alike > 0.0 else alike) / math.sqrt(margins)


def _between(value: float, resampled: Array, runs: int) -> Estimate:
    """Return the ends of the bootstrap, as far out as few runs ask (Hesterberg, American Statistician 69, 2015)."""
    tail = float(ndtr(stdtrit(runs - 1, 0.025) * math.sqrt(runs / (runs - 1)))) if runs > 1 else 0.0
    low, high = np.quantile(resampled, (tail, 1.0 - tail)).tolist()
    return Estimate(value, low, high)


def _resampled(values: Array, random: np.random.Generator) -> Array:
    """Return means of as many numbers, drawn from them with replacement; many numbers are drawn in groups."""
    groups = min(values.size, GROUPS)
    begins = np.arange(groups) * values.size // groups
    sums, sizes = np.add.reduceat(values, begins), np.diff(begins, append=values.size)
    counts = random.multinomial(groups, np.full(groups, 1.0 / groups), RESAMPLES)
    return np.asarray((counts @ sums) / (counts @ sizes))
