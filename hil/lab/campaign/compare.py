"""Two campaigns side by side: two versions, or two sets of parameters, run by run where they have drawn alike."""

from __future__ import annotations

from collections.abc import Iterator
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


@dataclass(frozen=True, slots=True)
class Difference:
    """A score of both, means over the runs that have it in both, and what the second has more.

    `less` is the share of the pairs in which the second has less of it; None where there are no pairs. `never` are
    the runs of each in which it was never reached, which no mean holds. `values` are the differences of the pairs.
    """

    name: str
    first: float
    second: float
    more: Estimate
    less: float | None
    never: tuple[int, int]
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
        if paired:
            there = np.isfinite(one) & np.isfinite(other)
            one, other = one[there], other[there]
        else:
            one, other = one[np.isfinite(one)], other[np.isfinite(other)]
        if min(one.size, other.size) < LEAST:
            continue
        values = other - one if paired else np.zeros(0)
        more = statistics.mean(values, SEED) if paired else statistics.difference(one, other, SEED)
        less = float(np.mean(values < 0.0)) if paired else None
        yield Difference(name, float(np.mean(one)), float(np.mean(other)), more, less, never, values)


def as_json(found: Comparison) -> dict[str, Any]:
    """Return the comparison for other programs."""
    return {
        "runs": list(found.runs),
        "pairs": found.pairs,
        "failed": [asdict(one) for one in found.failed],
        "failed_more": asdict(found.failed_more),
        "scores": {
            one.name: {
                "first": one.first,
                "second": one.second,
                "more": asdict(one.more),
                "less_in": one.less,
                "never": list(one.never),
            }
            for one in found.differences
        },
    }
