"""Two campaigns side by side: two versions, or two sets of parameters, run by run where they have drawn alike."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.campaign import statistics
from hil.lab.campaign.statistics import LEAST, Estimate
from hil.lab.campaign.table import Results
from hil.sim.truth import Array

SEED = 1  # of the bootstrap
SMALL = 0.02  # of the first's mean: a difference that is worth telling
SIGNED = "mean_deg"  # an error to either side: its mean is no size
# It jumps by minutes in a run of a hundred, and may be never: a mean of it would want thousands of runs.
BY_MEDIAN = "settling_s"


@dataclass(frozen=True, slots=True)
class Difference:
    """A score of both, over the runs that have it, and what the second has more: means; of the settling time medians.

    `less` is the share of the pairs in which the second has less of it; None where there are no pairs. `never` are
    the runs of each in which it was never reached: infinite, which a median holds. `tells` is the least difference
    that so many runs tell four times of five, `runs_for_small` how many runs tell SMALL of the first's mean; None of
    a median, and of a mean that is no size. `values` are the differences of the pairs.
    """

    name: str
    first: float
    second: float
    more: Estimate
    less: float | None
    never: tuple[int, int]
    tells: float | None
    runs_for_small: int | None
    values: Array


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two campaigns; `pairs` is how many runs have drawn alike in both, 0 where they are compared as wholes."""

    runs: tuple[int, int]
    pairs: int
    failed: tuple[Estimate, Estimate]
    failed_more: Estimate
    differences: tuple[Difference, ...]


def compare(first: Results, second: Results) -> Comparison:
    """Compare two campaigns, or raise UsageError where there is too little to say anything."""
    one, other = _paired(first, second)
    paired = one.size >= LEAST
    if not paired:
        one, other = np.arange(first.runs), np.arange(second.runs)
    if min(one.size, other.size) < LEAST:
        raise UsageError(f"too few runs to compare; sail {LEAST} at least")
    before, after = (results.failed[rows] != "" for results, rows in ((first, one), (second, other)))
    return Comparison(
        (first.runs, second.runs),
        int(one.size) if paired else 0,
        (statistics.share(int(before.sum()), before.size), statistics.share(int(after.sum()), after.size)),
        statistics.share_difference(before, after, paired=paired),
        tuple(_differences(first, second, (one, other), paired=paired)),
    )


def _paired(first: Results, second: Results) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the runs of the same number, seed and draws, as far as both draw; the rest is what differs."""
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
        if min(one.size, other.size) < LEAST:
            continue
        values = _more(one, other) if paired else np.zeros(0)
        less = float(np.mean(values < 0.0)) if paired else None
        if name == BY_MEDIAN:
            more = statistics.median(values) if paired else statistics.median_difference(one, other)
            middles = statistics.median(one).value, statistics.median(other).value
            tells = runs_for_small = None
        else:
            more = statistics.mean(values, SEED) if paired else statistics.difference(one, other, SEED)
            middles = float(np.mean(one)), float(np.mean(other))
            tells, runs_for_small = _power(name, middles[0], (values,) if paired else (one, other))
        yield Difference(name, *middles, more, less, never, tells, runs_for_small, values)


def _more(one: Array, other: Array) -> Array:
    """Return the differences of pairs; of two that never came there is none."""
    alike = one == other  # two infinities, too
    return np.where(alike, 0.0, other - np.where(alike, 0.0, one))


def _power(name: str, mean: float, samples: Sequence[Array]) -> tuple[float, int | None]:
    """Return what the runs of a sample, or of two independent ones, tell, and how many would tell SMALL of a mean."""
    spread = math.sqrt(sum(float(np.var(values, ddof=1)) for values in samples))
    tells = statistics.told_from(spread, min(values.size for values in samples))
    least = SMALL * mean
    return tells, statistics.runs_to_tell(spread, least) if name != SIGNED and least > 0.0 else None


def as_json(found: Comparison) -> dict[str, Any]:
    """Return the comparison for other programs; null is what is infinite or cannot be said."""
    return {
        "runs": list(found.runs),
        "pairs": found.pairs,
        "failed": [asdict(one) for one in found.failed],
        "failed_more": asdict(found.failed_more),
        "scores": {
            one.name: {
                "of": "median" if one.name == BY_MEDIAN else "mean",
                "first": _finite(one.first),
                "second": _finite(one.second),
                "more": {name: _finite(value) for name, value in asdict(one.more).items()},
                "less_in": one.less,
                "never": list(one.never),
                "tells": one.tells,
                "runs_for_2_percent": one.runs_for_small,
            }
            for one in found.differences
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
