"""The comparison of two campaigns in words: for the terminal and as a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from hil.lab.campaign.compare import BY_MEDIAN, SIGNED, Comparison, Difference
from hil.lab.campaign.page import NAMES
from hil.lab.campaign.statistics import Estimate
from hil.lab.campaign.table import Results
from hil.report import page, svg
from hil.report.svg import Interval, shown

MORE = "second less first"
HEAD = ("", "first", "second", MORE, "95 % confidence", "less in", "never", "tells", "2 % by")
NOTE = (
    "Means over the runs that have the score, and by how much the second's is larger, with the 95 % interval of the "
    "bootstrap, of the share that failed Newcombe's. Each stands by itself: one in twenty misses by chance. Of the "
    "settling time it is the median, of the pairs' differences too, which holds what never settles; its ends are two "
    "values of the order. How many never did is counted: first, second. 'tells' is the least difference of the means "
    "that so many runs tell four times of five, '2 % by' how many runs would tell 2 % of the first's mean so: an "
    "interval that holds zero does not say that there is none."
)


def cells(found: Comparison) -> list[Sequence[str]]:
    """Return the table, its head first."""
    return [HEAD, _failed(found), *(_row(one) for one in found.differences)]


def lead(first: Results, second: Results, found: Comparison) -> str:
    """Say what is compared."""
    how = f"{found.pairs} runs that have drawn alike, one by one" if found.pairs else "as wholes: they drew differently"
    return f"{first.directory} ({found.runs[0]} runs) and {second.directory} ({found.runs[1]} runs), {how}"


def text(first: Results, second: Results, found: Comparison) -> str:
    """Return the page."""
    return page.page(f"{first.directory.name} and {second.directory.name}", _parts(first, second, found))


def _parts(first: Results, second: Results, found: Comparison) -> Iterator[str]:
    yield page.paragraph(lead(first, second, found), "lead")
    yield page.table(cells(found))
    yield page.paragraph(NOTE, "note")
    sizes = svg.card(f"{MORE}, in parts of the first's", svg.intervals([_relative(one) for one in _sized(found)]))
    spreads = [
        svg.card(f"{MORE}: {', '.join(NAMES[one.name])}", svg.histogram(one.values[np.isfinite(one.values)], (0.0,)))
        for one in found.differences
        if np.isfinite(one.values).any()
    ]
    yield svg.cards([sizes, *spreads])
    yield page.heading("What differs")
    yield page.bullets(_differing(first, second))
    for number, results in (("First", first), ("Second", second)):
        yield page.heading(f"{number}: {results.directory}")
        yield page.verbatim(results.spec)


def _sized(found: Comparison) -> list[Difference]:
    """Return those whose mean is a size; an error to either side is none."""
    return [
        one
        for one in found.differences
        if one.name != SIGNED
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
        "-" if one.tells is None else shown(one.tells),
        "-" if one.runs_for_small is None else f"{one.runs_for_small} runs",
    )


def _failed(found: Comparison) -> Sequence[str]:
    first, second = (f"{100.0 * one.value:.3g}" for one in found.failed)
    more = found.failed_more
    parts = Estimate(100.0 * more.value, 100.0 * more.low, 100.0 * more.high)
    return ("failed, %", first, second, *_more(parts), "", "", "", "")


def _more(more: Estimate) -> tuple[str, str]:
    return _signed(more.value), f"{_signed(more.low)} to {_signed(more.high)}"


def _value(value: float) -> str:
    return shown(value) if math.isfinite(value) else "never"


def _signed(value: float) -> str:
    if math.isinf(value):
        return "+any" if value > 0.0 else "-any"
    return f"+{shown(value)}" if value > 0.0 else shown(value)


def _differing(first: Results, second: Results) -> list[str]:
    """Return the lines of the specifications that only one has, and the versions that differ."""
    ours, theirs = first.spec.splitlines(), second.spec.splitlines()
    lines = [f"first: {line}" for line in ours if line not in theirs]
    lines += [f"second: {line}" for line in theirs if line not in ours]
    lines += versions_that_differ(first, second)
    return lines or ["nothing: the same specification and the same versions"]


def versions_that_differ(first: Results, second: Results) -> list[str]:
    """Return a line for each version that is another in the second campaign, and what programs those are."""
    before, after = (dict(results.identity.get("versions", {})) for results in (first, second))
    if before != after:
        for versions, results in ((before, first), (after, second)):
            versions["program"] = results.identity.get("program", "unknown")
    return [
        f"{name}: {before.get(name, 'none')}, {after.get(name, 'none')}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]
