"""Comparison of two campaigns as a table for the terminal and as a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from hil.lab.campaign.compare import BY_MEDIAN, SIGNED_SCORE, Comparison, Difference
from hil.lab.campaign.page import NAMES
from hil.lab.campaign.statistics import Estimate
from hil.lab.campaign.store import Results
from hil.report import page, svg
from hil.report.svg import Interval, format_number

DIFFERENCE = "second minus first"
HEAD = (
    "", "first", "second", DIFFERENCE, "95 % confidence", "lower in", "never settled", "detectable", "runs for 2 %",
)  # fmt: skip
NOTE = (
    "Means over the runs that have the score, and their difference with its 95 % bootstrap interval; for the share of "
    "failed runs, Newcombe's interval. One interval in twenty misses the true value by chance. For the settling time "
    "the table shows medians, which include runs that never settle; their interval is given by two order statistics. "
    "'never settled' counts these runs: first, second. 'detectable' is the smallest difference of the means that this "
    "number of runs detects in 80 % of campaigns; 'runs for 2 %' is the number of runs that detects 2 % of the first "
    "mean. An interval that contains zero does not prove that there is no difference."
)


def cells(comparison: Comparison) -> list[Sequence[str]]:
    """Return the rows of the table, starting with its head."""
    return [HEAD, _failed(comparison), *(_row(one) for one in comparison.differences)]


def lead(first: Results, second: Results, comparison: Comparison) -> str:
    """Return a sentence that names both campaigns and how they are compared."""
    how = (
        f"{comparison.pairs} pairs of runs with equal draws"
        if comparison.pairs
        else "independent samples: their draws differ"
    )
    return f"{first.directory} ({comparison.runs[0]} runs) and {second.directory} ({comparison.runs[1]} runs), {how}"


def text(first: Results, second: Results, comparison: Comparison) -> str:
    """Return the page."""
    return page.page(f"{first.directory.name} and {second.directory.name}", _parts(first, second, comparison))


def _parts(first: Results, second: Results, comparison: Comparison) -> Iterator[str]:
    yield page.paragraph(lead(first, second, comparison), "lead")
    yield page.table(cells(comparison))
    yield page.paragraph(NOTE, "note")
    relative = [_relative(one) for one in _positive_scores(comparison)]
    sizes = svg.card(f"{DIFFERENCE}, relative to the first", svg.intervals(relative))
    spreads = [
        svg.card(
            f"{DIFFERENCE}: {', '.join(NAMES[one.name])}", svg.histogram(one.values[np.isfinite(one.values)], (0.0,))
        )
        for one in comparison.differences
        if np.isfinite(one.values).any()
    ]
    yield svg.cards([sizes, *spreads])
    yield page.heading("What differs")
    yield page.bullets(_differing(first, second))
    for number, results in (("First", first), ("Second", second)):
        yield page.heading(f"{number}: {results.directory}")
        yield page.verbatim(results.spec)


def _positive_scores(comparison: Comparison) -> list[Difference]:
    """Return the differences with a positive, finite mean; signed scores have no relative change."""
    return [
        one
        for one in comparison.differences
        if one.name != SIGNED_SCORE
        and one.first > 0.0
        and all(map(math.isfinite, (one.first, one.more.value, one.more.low, one.more.high)))
    ]


def _relative(one: Difference) -> Interval:
    return Interval(NAMES[one.name][0], *(value / one.first for value in (one.more.value, one.more.low, one.more.high)))


def _row(one: Difference) -> Sequence[str]:
    title, unit = NAMES[one.name]
    return (
        f"{title}, {unit}{' (median)' if one.name == BY_MEDIAN else ''}",
        _value(one.first),
        _value(one.second),
        *_more(one.more),
        "-" if one.less is None else f"{100.0 * one.less:.0f} %",
        f"{one.never[0]}, {one.never[1]}" if any(one.never) else "",
        "-" if one.detectable is None else format_number(one.detectable),
        "-" if one.runs_for_small is None else f"{one.runs_for_small} runs",
    )


def _failed(comparison: Comparison) -> Sequence[str]:
    first, second = (f"{100.0 * one.value:.3g}" for one in comparison.failed)
    more = comparison.failed_more
    parts = Estimate(100.0 * more.value, 100.0 * more.low, 100.0 * more.high)
    return ("failed, %", first, second, *_more(parts), "", "", "", "")


def _more(more: Estimate) -> tuple[str, str]:
    return _signed(more.value), f"{_signed(more.low)} to {_signed(more.high)}"


def _value(value: float) -> str:
    return format_number(value) if math.isfinite(value) else "never"


def _signed(value: float) -> str:
    if math.isinf(value):
        return "+any" if value > 0.0 else "-any"
    return f"+{format_number(value)}" if value > 0.0 else format_number(value)


def _differing(first: Results, second: Results) -> list[str]:
    """Return the lines that only one specification has, and the versions that differ."""
    ours, theirs = first.spec.splitlines(), second.spec.splitlines()
    lines = [f"first: {line}" for line in ours if line not in theirs]
    lines += [f"second: {line}" for line in theirs if line not in ours]
    lines += versions_that_differ(first, second)
    return lines or ["nothing: the same specification and the same versions"]


def versions_that_differ(first: Results, second: Results) -> list[str]:
    """Return a line for each version that differs, and for the programs if any does."""
    before, after = (dict(results.identity.get("versions", {})) for results in (first, second))
    if before != after:
        for versions, results in ((before, first), (after, second)):
            versions["program"] = results.identity.get("program", "unknown")
    return [
        f"{name}: {before.get(name, 'none')}, {after.get(name, 'none')}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
