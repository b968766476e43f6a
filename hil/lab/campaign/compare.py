"""Compare two campaigns, run by run if their draws are equal; return the result as records, JSON, table and page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.campaign import statistics
from hil.lab.campaign.page import NAMES
from hil.lab.campaign.statistics import MIN_RUNS, Estimate
from hil.lab.campaign.store import Results
from hil.report import page, svg
from hil.report.svg import Interval, format_number
from hil.sim.truth import Array

BOOTSTRAP_SEED = 1
SMALL_CHANGE = 0.02  # relevant difference, relative to the mean of the first campaign
SIGNED_SCORE = "mean_deg"  # a signed error, for which relative changes of the mean are meaningless
# The settling time has outliers of minutes in 1 % of the runs and may be infinite: a mean would need thousands of runs.
BY_MEDIAN = "settling_s"


@dataclass(frozen=True, slots=True)
class Difference:
    """A score of both campaigns and its change, second minus first: means, or medians for the settling time.

    Attributes:
        lower_fraction: fraction of the pairs in which the second score is lower; None without pairs.
        never_counts: numbers of runs of each campaign with an infinite score.
        detectable: smallest difference that this number of runs detects with a power of TEST_POWER; None for medians.
        runs_for_small: number of runs that detect SMALL_CHANGE; None for medians and for signed means.
        pair_changes: changes of the pairs.
    """

    name: str
    first: float
    second: float
    change: Estimate
    lower_fraction: float | None
    never_counts: tuple[int, int]
    detectable: float | None
    runs_for_small: int | None
    pair_changes: Array


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of two campaigns; `pairs` is the number of runs with equal draws, or 0 for independent samples."""

    runs: tuple[int, int]
    pairs: int
    failed_fractions: tuple[Estimate, Estimate]
    failed_difference: Estimate
    differences: tuple[Difference, ...]


def compare(first: Results, second: Results) -> Comparison:
    """Compare two campaigns; raise UsageError if they have too few runs."""
    first_rows = second_rows = _equal_rows(first, second)
    is_paired = first_rows.size >= MIN_RUNS
    if not is_paired:
        first_rows, second_rows = np.arange(first.runs), np.arange(second.runs)
    if min(first_rows.size, second_rows.size) < MIN_RUNS:
        raise UsageError(f"too few runs to compare; each campaign needs at least {MIN_RUNS}")
    first_failed, second_failed = first.failed[first_rows] != "", second.failed[second_rows] != ""
    return Comparison(
        (first.runs, second.runs),
        int(first_rows.size) if is_paired else 0,
        (
            statistics.proportion(int(first_failed.sum()), first_failed.size),
            statistics.proportion(int(second_failed.sum()), second_failed.size),
        ),
        statistics.proportion_difference(first_failed, second_failed, paired=is_paired),
        tuple(_differences(first, second, (first_rows, second_rows), is_paired=is_paired)),
    )


def _equal_rows(first: Results, second: Results) -> NDArray[np.int64]:
    """Return the rows with equal number, seed and draws; names that only one campaign draws are ignored."""
    count = min(first.runs, second.runs)
    is_equal = first.seeds[:count] == second.seeds[:count]
    for name in first.drawn_values.keys() & second.drawn_values.keys():
        is_equal &= first.drawn_values[name][:count] == second.drawn_values[name][:count]
    return np.flatnonzero(is_equal)


def _differences(
    first: Results, second: Results, rows: tuple[NDArray[np.int64], NDArray[np.int64]], *, is_paired: bool
) -> Iterator[Difference]:
    """Yield the difference of each score that both campaigns have for enough runs."""
    for name in (name for name in first.scores if name in second.scores):
        before, after = first.scores[name][rows[0]], second.scores[name][rows[1]]
        never_counts = int(np.count_nonzero(np.isinf(before))), int(np.count_nonzero(np.isinf(after)))
        has_before, has_after = ~np.isnan(before), ~np.isnan(after)
        if is_paired:
            has_before = has_after = has_before & has_after
        before, after = before[has_before], after[has_after]
        if min(before.size, after.size) < MIN_RUNS:
            continue
        changes = _pair_changes(before, after) if is_paired else np.zeros(0)
        lower_fraction = float(np.mean(changes < 0.0)) if is_paired else None
        if name == BY_MEDIAN:
            change = statistics.median(changes) if is_paired else statistics.median_difference(before, after)
            centres = statistics.median(before).value, statistics.median(after).value
            detectable = runs_for_small = None
        else:
            change = (
                statistics.mean(changes, BOOTSTRAP_SEED)
                if is_paired
                else statistics.difference(before, after, BOOTSTRAP_SEED)
            )
            centres = float(np.mean(before)), float(np.mean(after))
            detectable, runs_for_small = _power(name, centres[0], (changes,) if is_paired else (before, after))
        yield Difference(name, *centres, change, lower_fraction, never_counts, detectable, runs_for_small, changes)


def _pair_changes(before: Array, after: Array) -> Array:
    """Return the differences of the pairs; 0 for two infinite values."""
    is_equal = before == after  # also for two infinities
    return np.where(is_equal, 0.0, after - np.where(is_equal, 0.0, before))


def _power(name: str, mean: float, samples: Sequence[Array]) -> tuple[float, int | None]:
    """Return the detectable difference of one or two independent samples, and the number of runs for SMALL_CHANGE."""
    sd = math.sqrt(sum(float(np.var(values, ddof=1)) for values in samples))
    detectable = statistics.detectable_difference(sd, min(values.size for values in samples))
    small_change = SMALL_CHANGE * mean
    if name == SIGNED_SCORE or not small_change > 0.0:
        return detectable, None
    return detectable, statistics.runs_to_detect(sd, small_change)


def as_json(comparison: Comparison) -> dict[str, Any]:
    """Return the comparison for JSON; infinite and unknown values are null."""
    return {
        "runs": list(comparison.runs),
        "pairs": comparison.pairs,
        "failed": [asdict(fraction) for fraction in comparison.failed_fractions],
        "failed_more": asdict(comparison.failed_difference),
        "scores": {
            difference.name: {
                "of": "median" if difference.name == BY_MEDIAN else "mean",
                "first": _finite(difference.first),
                "second": _finite(difference.second),
                "more": {name: _finite(value) for name, value in asdict(difference.change).items()},
                "less_in": difference.lower_fraction,
                "never": list(difference.never_counts),
                "tells": difference.detectable,
                "runs_for_2_percent": difference.runs_for_small,
            }
            for difference in comparison.differences
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


CHANGE_TITLE = "second minus first"
HEADER = (
    "", "first", "second", CHANGE_TITLE, "95 % confidence", "lower in", "never settled", "detectable", "runs for 2 %",
)  # fmt: skip
NOTE = (
    "Means over the runs that have the score, and their difference with its 95 % bootstrap interval; for the share of "
    "failed runs, Newcombe's interval. One interval in twenty misses the true value by chance. For the settling time "
    "the table shows medians, which include runs that never settle; their interval is given by two order statistics. "
    "'never settled' counts these runs: first, second. 'detectable' is the smallest difference of the means that this "
    "number of runs detects in 80 % of campaigns; 'runs for 2 %' is the number of runs that detects 2 % of the first "
    "mean. An interval that contains zero does not prove that there is no difference."
)


def table_rows(comparison: Comparison) -> list[Sequence[str]]:
    """Return the rows of the table; the first one is the header."""
    return [HEADER, _failed_row(comparison), *(_row(difference) for difference in comparison.differences)]


def summary(first: Results, second: Results, comparison: Comparison) -> str:
    """Return a sentence that names both campaigns and how they are compared."""
    method = (
        f"{comparison.pairs} pairs of runs with equal draws"
        if comparison.pairs
        else "independent samples: their draws differ"
    )
    return f"{first.directory} ({comparison.runs[0]} runs) and {second.directory} ({comparison.runs[1]} runs), {method}"


def page_text(first: Results, second: Results, comparison: Comparison) -> str:
    """Return the comparison as an HTML page."""
    return page.page(f"{first.directory.name} and {second.directory.name}", _page_parts(first, second, comparison))


def _page_parts(first: Results, second: Results, comparison: Comparison) -> Iterator[str]:
    yield page.paragraph(summary(first, second, comparison), "lead")
    yield page.table(table_rows(comparison))
    yield page.paragraph(NOTE, "note")
    relative_changes = [_relative_change(difference) for difference in _positive_scores(comparison)]
    size_card = svg.card(f"{CHANGE_TITLE}, relative to the first", svg.intervals(relative_changes))
    histogram_cards = [
        svg.card(
            f"{CHANGE_TITLE}: {', '.join(NAMES[difference.name])}",
            svg.histogram(difference.pair_changes[np.isfinite(difference.pair_changes)], (0.0,)),
        )
        for difference in comparison.differences
        if np.isfinite(difference.pair_changes).any()
    ]
    yield svg.cards([size_card, *histogram_cards])
    yield page.heading("What differs")
    yield page.bullets(_changed_lines(first, second))
    for number, results in (("First", first), ("Second", second)):
        yield page.heading(f"{number}: {results.directory}")
        yield page.verbatim(results.spec)


def _positive_scores(comparison: Comparison) -> list[Difference]:
    """Return the differences with a positive, finite mean; signed scores have no relative change."""
    return [
        difference
        for difference in comparison.differences
        if difference.name != SIGNED_SCORE
        and difference.first > 0.0
        and all(
            map(
                math.isfinite,
                (difference.first, difference.change.value, difference.change.low, difference.change.high),
            )
        )
    ]


def _relative_change(difference: Difference) -> Interval:
    return Interval(
        NAMES[difference.name][0],
        *(
            value / difference.first
            for value in (difference.change.value, difference.change.low, difference.change.high)
        ),
    )


def _row(difference: Difference) -> Sequence[str]:
    title, unit = NAMES[difference.name]
    return (
        f"{title}, {unit}{' (median)' if difference.name == BY_MEDIAN else ''}",
        _value(difference.first),
        _value(difference.second),
        *_change_cells(difference.change),
        "-" if difference.lower_fraction is None else f"{100.0 * difference.lower_fraction:.0f} %",
        f"{difference.never_counts[0]}, {difference.never_counts[1]}" if any(difference.never_counts) else "",
        "-" if difference.detectable is None else format_number(difference.detectable),
        "-" if difference.runs_for_small is None else f"{difference.runs_for_small} runs",
    )


def _failed_row(comparison: Comparison) -> Sequence[str]:
    first, second = (f"{100.0 * fraction.value:.3g}" for fraction in comparison.failed_fractions)
    change = comparison.failed_difference
    percent = Estimate(100.0 * change.value, 100.0 * change.low, 100.0 * change.high)
    return ("failed, %", first, second, *_change_cells(percent), "", "", "", "")


def _change_cells(change: Estimate) -> tuple[str, str]:
    return _signed(change.value), f"{_signed(change.low)} to {_signed(change.high)}"


def _value(value: float) -> str:
    return format_number(value) if math.isfinite(value) else "never"


def _signed(value: float) -> str:
    if math.isinf(value):
        return "+any" if value > 0.0 else "-any"
    return f"+{format_number(value)}" if value > 0.0 else format_number(value)


def _changed_lines(first: Results, second: Results) -> list[str]:
    """Return the lines that only one specification has, and the versions that differ."""
    first_lines, second_lines = first.spec.splitlines(), second.spec.splitlines()
    lines = [f"first: {line}" for line in first_lines if line not in second_lines]
    lines += [f"second: {line}" for line in second_lines if line not in first_lines]
    lines += changed_versions(first, second)
    return lines or ["nothing: the same specification and the same versions"]


def changed_versions(first: Results, second: Results) -> list[str]:
    """Return a line for each version that differs; with any difference, also one for the programs."""
    before, after = (dict(results.identity.get("versions", {})) for results in (first, second))
    if before != after:
        for versions, results in ((before, first), (after, second)):
            versions["program"] = results.identity.get("program", "unknown")
    return [
        f"{name}: {before.get(name, 'none')}, {after.get(name, 'none')}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
