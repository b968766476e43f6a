"""Compare two campaigns: two versions or two sets of parameters, run by run where their draws are equal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.campaign import statistics
from hil.lab.campaign.statistics import MIN_RUNS, Estimate
from hil.lab.campaign.store import Results
from hil.sim.truth import Array

SEED = 1  # of the bootstrap
SMALL_CHANGE = 0.02  # relevant difference, relative to the mean of the first campaign
SIGNED_SCORE = "mean_deg"  # a signed error: relative changes of its mean have no meaning
# The settling time has outliers of minutes in 1 % of the runs and may be infinite: its mean needs thousands of runs.
BY_MEDIAN = "settling_s"


@dataclass(frozen=True, slots=True)
class Difference:
    """A score of both campaigns and the difference second minus first: means, or medians for the settling time.

    Attributes:
        less: share of the pairs in which the score of the second is lower; None without pairs.
        never: number of runs of each campaign with an infinite score.
        detectable: smallest difference that this number of runs detects with a power of TEST_POWER; None for medians.
        runs_for_small: number of runs that detect SMALL_CHANGE; None for medians and for signed means.
        values: differences of the pairs.
    """

    name: str
    first: float
    second: float
    more: Estimate
    less: float | None
    never: tuple[int, int]
    detectable: float | None
    runs_for_small: int | None
    values: Array


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two campaigns; `pairs` is the number of runs with equal draws, 0 for independent samples."""

    runs: tuple[int, int]
    pairs: int
    failed: tuple[Estimate, Estimate]
    failed_more: Estimate
    differences: tuple[Difference, ...]


def compare(first: Results, second: Results) -> Comparison:
    """Compare two campaigns; raise UsageError if they have too few runs."""
    one, other = _paired_rows(first, second)
    paired = one.size >= MIN_RUNS
    if not paired:
        one, other = np.arange(first.runs), np.arange(second.runs)
    if min(one.size, other.size) < MIN_RUNS:
        raise UsageError(f"too few runs to compare; each campaign needs at least {MIN_RUNS}")
    before, after = (results.failed[rows] != "" for results, rows in ((first, one), (second, other)))
    return Comparison(
        (first.runs, second.runs),
        int(one.size) if paired else 0,
        (statistics.share(int(before.sum()), before.size), statistics.share(int(after.sum()), after.size)),
        statistics.share_difference(before, after, paired=paired),
        tuple(_differences(first, second, (one, other), paired=paired)),
    )


def _paired_rows(first: Results, second: Results) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows with equal number, seed and draws; names that only one campaign draws are ignored."""
    count = min(first.runs, second.runs)
    alike = first.seeds[:count] == second.seeds[:count]
    for name in first.drawn.keys() & second.drawn.keys():
        alike &= first.drawn[name][:count] == second.drawn[name][:count]
    rows = np.flatnonzero(alike)
    return rows, rows


def _differences(
    first: Results, second: Results, rows: tuple[NDArray[np.int64], NDArray[np.int64]], *, paired: bool
) -> Iterator[Difference]:
    for name in (name for name in first.scores if name in second.scores):
        one, other = first.scores[name][rows[0]], second.scores[name][rows[1]]
        never = int(np.count_nonzero(np.isinf(one))), int(np.count_nonzero(np.isinf(other)))
        there = ~np.isnan(one), ~np.isnan(other)
        if paired:
            there = (there[0] & there[1],) * 2
        one, other = one[there[0]], other[there[1]]
        if min(one.size, other.size) < MIN_RUNS:
            continue
        values = _more(one, other) if paired else np.zeros(0)
        less = float(np.mean(values < 0.0)) if paired else None
        if name == BY_MEDIAN:
            more = statistics.median(values) if paired else statistics.median_difference(one, other)
            middles = statistics.median(one).value, statistics.median(other).value
            detectable = runs_for_small = None
        else:
            more = statistics.mean(values, SEED) if paired else statistics.difference(one, other, SEED)
            middles = float(np.mean(one)), float(np.mean(other))
            detectable, runs_for_small = _power(name, middles[0], (values,) if paired else (one, other))
        yield Difference(name, *middles, more, less, never, detectable, runs_for_small, values)


def _more(one: Array, other: Array) -> Array:
    """Return the differences of the pairs; 0 for two infinite values."""
    alike = one == other  # also two infinities
    return np.where(alike, 0.0, other - np.where(alike, 0.0, one))


def _power(name: str, mean: float, samples: Sequence[Array]) -> tuple[float, int | None]:
    """Return the detectable difference of one or two independent samples, and the number of runs for SMALL_CHANGE."""
    spread = math.sqrt(sum(float(np.var(values, ddof=1)) for values in samples))
    detectable = statistics.detectable_difference(spread, min(values.size for values in samples))
    small = SMALL_CHANGE * mean
    return detectable, statistics.runs_to_detect(spread, small) if name != SIGNED_SCORE and small > 0.0 else None


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison for JSON; infinite and unknown values are null."""
    return {
        "runs": list(comparison.runs),
        "pairs": comparison.pairs,
        "failed": [asdict(one) for one in comparison.failed],
        "failed_more": asdict(comparison.failed_more),
        "scores": {
            one.name: {
                "of": "median" if one.name == BY_MEDIAN else "mean",
                "first": _finite(one.first),
                "second": _finite(one.second),
                "more": {name: _finite(value) for name, value in asdict(one.more).items()},
                "less_in": one.less,
                "never": list(one.never),
                "tells": one.detectable,
                "runs_for_2_percent": one.runs_for_small,
            }
            for one in comparison.differences
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
