"""Statistics of many runs with confidence intervals: shares, rank correlations, differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtr, ndtri, stdtrit  # scipy.stats takes a second to import

from hil.sim.truth import Array

Z_95 = 1.959963984540054  # a normal variable is within +-Z_95 standard deviations with 95 % probability
RANK_SPREAD = 1.03  # sd of Fisher's transform, rank by product-moment correlation (Fieller, Hartley, Pearson 1957)
RESAMPLES = 2000
GROUPS = 5000  # larger samples are resampled in this number of groups
MIN_RUNS = 8  # runs that a statistic needs
TEST_POWER = 0.8  # probability to detect the detectable difference


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
    part, z = count / of, Z_95**2 / of
    middle = (part + z / 2.0) / (1.0 + z)
    reach = Z_95 * math.sqrt(part * (1.0 - part) / of + z / (4.0 * of)) / (1.0 + z)
    # For none and all of the runs the limit is exact; rounding must not move it.
    return Estimate(part, max(0.0, middle - reach) if count else 0.0, min(1.0, middle + reach) if count < of else 1.0)


def ranks(values: Array) -> Array:
    """Return the ranks of numbers from 1 up; ties share their mean rank, and infinity is the largest."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    begins = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    ends = np.concatenate((begins[1:], [values.size]))
    found = np.empty(values.size)
    found[order] = np.repeat(0.5 * (begins + 1 + ends), ends - begins)
    return found


def rank_correlation(first: Array, second: Array, groups: NDArray[Any]) -> Estimate | None:
    """Return Spearman's correlation within groups, pooled; None for too few pairs or a constant value.

    Pairs with NaN are ignored.
    """
    there = ~(np.isnan(first) | np.isnan(second))
    one, other, groups = first[there], second[there], groups[there]
    names, number = np.unique(groups, return_inverse=True)
    for each in range(len(names)):
        inside = number == each
        one[inside], other[inside] = _centred(one[inside]), _centred(other[inside])
    freedom = one.size - len(names) - 2
    if freedom < MIN_RUNS or not np.any(one) or not np.any(other):
        return None
    value = float(np.sum(one * other) / math.sqrt(np.sum(one * one) * np.sum(other * other)))
    # On Fisher's scale the standard error hardly depends on the value.
    middle = math.atanh(max(-1.0 + 1e-12, min(1.0 - 1e-12, value)))
    reach = Z_95 * RANK_SPREAD / math.sqrt(freedom)
    return Estimate(value, math.tanh(middle - reach), math.tanh(middle + reach))


def _centred(values: Array) -> Array:
    """Return the ranks minus their mean, divided by their number."""
    found = ranks(values)
    return (found - np.mean(found)) / values.size


def mean(values: Array, seed: int) -> Estimate:
    """Return the mean with its bootstrap interval."""
    resampled = _resampled(values, np.random.default_rng(seed))
    return _between(float(np.mean(values)), resampled, values.size)


def difference(before: Array, after: Array, seed: int) -> Estimate:
    """Return the difference of the means of independent runs with its bootstrap interval."""
    random = np.random.default_rng(seed)
    resampled = _resampled(after, random) - _resampled(before, random)
    return _between(float(np.mean(after) - np.mean(before)), resampled, min(before.size, after.size))


def detectable_difference(spread: float, runs: int) -> float:
    """Return the smallest difference of a mean that is detected with a power of TEST_POWER at 95 % confidence.

    `spread` is the standard deviation of the differences of pairs, or of both independent samples together.
    """
    return float(stdtrit(runs - 1, 0.975) + stdtrit(runs - 1, TEST_POWER)) * spread / math.sqrt(runs)


def runs_to_detect(spread: float, change: float) -> int:
    """Return the number of runs that detect a difference (Guenther, American Statistician 35, 1981)."""
    ratio = (Z_95 + float(ndtri(TEST_POWER))) * spread / change
    return max(MIN_RUNS, math.ceil(ratio**2 + 0.5 * Z_95**2))


def median(values: Array) -> Estimate:
    """Return the median, which may be infinite, and the order statistics that bound it with at least 95 % confidence.

    The interval is distribution-free: the number of values below the median is binomial with p = 0.5.
    """
    ordered, runs = np.sort(values), values.size
    out = int(np.searchsorted(bdtr(np.arange(runs + 1), runs, 0.5), 0.025))
    low, high = ordered[max(out - 1, 0)], ordered[min(runs - out, runs - 1)]
    middle = ordered[(runs - 1) // 2], ordered[runs // 2]
    value = np.mean(middle) if np.isfinite(middle).all() else min(middle, key=abs)
    return Estimate(float(value), float(low), float(high))


def median_difference(before: Array, after: Array) -> Estimate:
    """Return the difference of the medians of independent runs, with an interval by Newcombe's method."""
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
    """Return the difference of two shares with Newcombe's interval (Statistics in Medicine 17, 1998).

    It combines Wilson's intervals of both shares, which are not of zero width for 0 failures in a few runs.
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
    """Return the phi correlation of paired outcomes, with Newcombe's continuity correction."""
    both, neither = np.count_nonzero(before & after), np.count_nonzero(~before & ~after)
    first, second = np.count_nonzero(before & ~after), np.count_nonzero(~before & after)
    margins = float((both + first) * (second + neither) * (both + second) * (first + neither))
    if margins == 0.0:
        return 0.0
    alike = float(both * neither - first * second)
    return (max(alike - before.size / 2.0, 0.0) if alike > 0.0 else alike) / math.sqrt(margins)


def _between(value: float, resampled: Array, runs: int) -> Estimate:
    """Return the bootstrap interval, widened for few runs (Hesterberg, American Statistician 69, 2015)."""
    tail = float(ndtr(stdtrit(runs - 1, 0.025) * math.sqrt(runs / (runs - 1)))) if runs > 1 else 0.0
    low, high = np.quantile(resampled, (tail, 1.0 - tail)).tolist()
    return Estimate(value, low, high)


def _resampled(values: Array, random: np.random.Generator) -> Array:
    """Return bootstrap means, drawn with replacement; large samples are drawn in groups."""
    groups = min(values.size, GROUPS)
    begins = np.arange(groups) * values.size // groups
    sums, sizes = np.add.reduceat(values, begins), np.diff(begins, append=values.size)
    counts = random.multinomial(groups, np.full(groups, 1.0 / groups), RESAMPLES)
    return np.asarray((counts @ sums) / (counts @ sizes))
