"""Statistics of many runs with confidence intervals: proportions, means, medians, rank correlations, differences."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr, ndtr, ndtri, stdtrit  # scipy.stats takes a second to import

from hil.sim.truth import Array

Z_95 = 1.959963984540054  # 97.5 % quantile of the normal distribution
RANK_SD_RATIO = 1.03  # standard deviation of Fisher's transform: ranks / values (Fieller, Hartley, Pearson 1957)
RESAMPLES = 2000
MAX_GROUPS = 5000  # larger samples are resampled in this number of groups
MIN_RUNS = 8  # minimum number of runs for a statistic
TEST_POWER = 0.8  # probability to detect the detectable difference


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and the limits of its 95 % confidence interval."""

    value: float
    low: float
    high: float


def proportion(count: int, total: int) -> Estimate:
    """Return count / total with Wilson's interval."""
    if total == 0:
        return Estimate(0.0, 0.0, 1.0)
    fraction, z = count / total, Z_95**2 / total
    middle = (fraction + z / 2.0) / (1.0 + z)
    half_width = Z_95 * math.sqrt(fraction * (1.0 - fraction) / total + z / (4.0 * total)) / (1.0 + z)
    # For none and all of the runs the limit is exact and must not be changed by rounding.
    return Estimate(
        fraction,
        max(0.0, middle - half_width) if count else 0.0,
        min(1.0, middle + half_width) if count < total else 1.0,
    )


def ranks(values: Array) -> Array:
    """Return the ranks of numbers, from 1; equal numbers have their mean rank, and infinity is the largest."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    starts = np.flatnonzero(np.concatenate(([True], ordered[1:] != ordered[:-1])))
    ends = np.concatenate((starts[1:], [values.size]))
    result = np.empty(values.size)
    result[order] = np.repeat(0.5 * (starts + 1 + ends), ends - starts)
    return result


def rank_correlation(first: Array, second: Array, groups: NDArray[Any]) -> Estimate | None:
    """Return Spearman's correlation within groups, pooled; None for too few pairs or constant values.

    Pairs with NaN are ignored.
    """
    is_known = ~(np.isnan(first) | np.isnan(second))
    first_ranks, second_ranks, groups = first[is_known], second[is_known], groups[is_known]
    group_names, group_index = np.unique(groups, return_inverse=True)
    for group in range(len(group_names)):
        is_member = group_index == group
        first_ranks[is_member], second_ranks[is_member] = (
            _centred_ranks(first_ranks[is_member]),
            _centred_ranks(second_ranks[is_member]),
        )
    degrees_of_freedom = first_ranks.size - len(group_names) - 2
    if degrees_of_freedom < MIN_RUNS or not np.any(first_ranks) or not np.any(second_ranks):
        return None
    value = float(
        np.sum(first_ranks * second_ranks)
        / math.sqrt(np.sum(first_ranks * first_ranks) * np.sum(second_ranks * second_ranks))
    )
    # On Fisher's scale the standard error is almost independent of the value.
    middle = math.atanh(max(-1.0 + 1e-12, min(1.0 - 1e-12, value)))
    half_width = Z_95 * RANK_SD_RATIO / math.sqrt(degrees_of_freedom)
    return Estimate(value, math.tanh(middle - half_width), math.tanh(middle + half_width))


def _centred_ranks(values: Array) -> Array:
    """Return the ranks minus their mean, divided by their number."""
    result = ranks(values)
    return (result - np.mean(result)) / values.size


def mean(values: Array, seed: int) -> Estimate:
    """Return the mean with its bootstrap interval."""
    resampled = _bootstrap_means(values, np.random.default_rng(seed))
    return _bootstrap_interval(float(np.mean(values)), resampled, values.size)


def difference(before: Array, after: Array, seed: int) -> Estimate:
    """Return the difference of the means of independent runs with its bootstrap interval."""
    rng = np.random.default_rng(seed)
    resampled = _bootstrap_means(after, rng) - _bootstrap_means(before, rng)
    return _bootstrap_interval(float(np.mean(after) - np.mean(before)), resampled, min(before.size, after.size))


def detectable_difference(spread: float, runs: int) -> float:
    """Return the smallest difference of a mean that is detected with a power of TEST_POWER at 95 % confidence.

    `spread`: standard deviation of the differences of pairs, or root of the sum of the variances of both samples.
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
    skipped = int(np.searchsorted(bdtr(np.arange(runs + 1), runs, 0.5), 0.025))
    low, high = ordered[max(skipped - 1, 0)], ordered[min(runs - skipped, runs - 1)]
    middle = ordered[(runs - 1) // 2], ordered[runs // 2]
    value = np.mean(middle) if np.isfinite(middle).all() else min(middle, key=abs)
    return Estimate(float(value), float(low), float(high))


def median_difference(before: Array, after: Array) -> Estimate:
    """Return the difference of the medians of independent runs, with an interval by Newcombe's method."""
    first_estimate, second_estimate = median(before), median(after)
    if not (math.isfinite(first_estimate.value) and math.isfinite(second_estimate.value)):
        value = 0.0 if first_estimate.value == second_estimate.value else second_estimate.value - first_estimate.value
        return Estimate(value, -math.inf, math.inf)
    value = second_estimate.value - first_estimate.value
    return Estimate(
        value,
        value - math.hypot(second_estimate.value - second_estimate.low, first_estimate.high - first_estimate.value),
        value + math.hypot(second_estimate.high - second_estimate.value, first_estimate.value - first_estimate.low),
    )


def proportion_difference(before: NDArray[np.bool_], after: NDArray[np.bool_], *, paired: bool) -> Estimate:
    """Return the difference of two proportions with Newcombe's interval (Statistics in Medicine 17, 1998).

    It combines Wilson's intervals, whose width is not zero for 0 failures in a few runs.
    """
    first_estimate = proportion(int(np.count_nonzero(before)), before.size)
    second_estimate = proportion(int(np.count_nonzero(after)), after.size)
    correlation = _phi_correlation(before, after) if paired else 0.0
    value = second_estimate.value - first_estimate.value

    def half_width(lower: float, upper: float) -> float:
        return math.sqrt(max(lower * lower - 2.0 * correlation * lower * upper + upper * upper, 0.0))

    return Estimate(
        value,
        value - half_width(second_estimate.value - second_estimate.low, first_estimate.high - first_estimate.value),
        value + half_width(second_estimate.high - second_estimate.value, first_estimate.value - first_estimate.low),
    )


def _phi_correlation(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> float:
    """Return the phi correlation of paired outcomes, with Newcombe's continuity correction."""
    both, neither = np.count_nonzero(before & after), np.count_nonzero(~before & ~after)
    first, second = np.count_nonzero(before & ~after), np.count_nonzero(~before & after)
    margins = float((both + first) * (second + neither) * (both + second) * (first + neither))
    if margins == 0.0:
        return 0.0
    correlation = float(both * neither - first * second)
    return (max(correlation - before.size / 2.0, 0.0) if correlation > 0.0 else correlation) / math.sqrt(margins)


def _bootstrap_interval(value: float, resampled: Array, runs: int) -> Estimate:
    """Return `value` with its bootstrap interval, widened for few runs (Hesterberg, American Statistician 69, 2015)."""
    tail = float(ndtr(stdtrit(runs - 1, 0.025) * math.sqrt(runs / (runs - 1)))) if runs > 1 else 0.0
    low, high = np.quantile(resampled, (tail, 1.0 - tail)).tolist()
    return Estimate(value, low, high)


def _bootstrap_means(values: Array, rng: np.random.Generator) -> Array:
    """Return bootstrap means (drawn with replacement); large samples are drawn in groups."""
    groups = min(values.size, MAX_GROUPS)
    starts = np.arange(groups) * values.size // groups
    sums, sizes = np.add.reduceat(values, starts), np.diff(starts, append=values.size)
    counts = rng.multinomial(groups, np.full(groups, 1.0 / groups), RESAMPLES)
    return np.asarray((counts @ sums) / (counts @ sizes))
