"""Page of a campaign: distribution of the scores, sensitivities, worst runs and failed runs."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.lab.campaign import statistics, store
from hil.lab.campaign.store import Results
from hil.report import page, svg
from hil.report.page import Cell
from hil.report.svg import Interval, format_number
from hil.sim.truth import Array

# score -> title and unit
NAMES = {
    "rms_deg": ("rms error", "deg"),
    "mean_deg": ("mean error", "deg"),
    "worst_deg": ("worst error", "deg"),
    "travel_deg_per_h": ("rudder travel", "deg/h"),
    "overshoot_deg": ("overshoot", "deg"),
    "settling_s": ("settling time", "s"),
}
RANKED_SCORES = tuple(name for name in NAMES if name != "mean_deg")  # larger is worse
WORST_RUNS, MAX_FAILED_ROWS, MAX_CHOICES = 3, 50, 20
SENSITIVITY_NOTE = (
    "Spearman's rank correlation of each drawn value with each score, among runs in the same sea, with its 95 % "
    "confidence interval; pale if that contains zero. It shows monotonic dependence only. A run that did not settle "
    "ranks last. Of many pairs, one in twenty is significant by chance."
)
NOTE = (
    "Errors are the heading without wave-frequency yaw minus the goal. Errors and rudder travel are those of the "
    "steady parts of all goals, overshoot and settling time the largest of the run. A histogram counts runs; outliers "
    "are counted at its edges. The vertical lines are the 5, 50 and 95 % quantiles."
)


def text(results: Results, notes: Sequence[str] = ()) -> str:
    """Return the page as HTML, with notes below the specification."""
    return page.page(f"Campaign {results.directory.name}", _parts(results, notes))


def _parts(results: Results, notes: Sequence[str]) -> Iterator[str]:
    failed = statistics.proportion(results.failures, results.runs)
    yield page.paragraph(
        f"{results.runs} runs, {results.failures} failed: {_percent(failed.value)} "
        f"({_percent(failed.low)} to {_percent(failed.high)} with 95 % confidence)",
        "lead",
    )
    yield svg.cards([_histogram_card(name, values) for name, values in results.scores.items()])
    yield page.paragraph(NOTE, "note")
    yield from _sensitivities(results)
    yield from _choices(results)
    yield from _worst_runs(results)
    yield from _failed_runs(results)
    yield page.heading("Specification")
    yield page.verbatim(results.spec)
    yield from (page.paragraph(note, "note") for note in notes)
    yield page.paragraph(
        ", ".join(f"{name} {version}" for name, version in results.identity.get("versions", {}).items()), "note"
    )


def _histogram_card(name: str, values: Array) -> str:
    title, unit = NAMES[name]
    finite = values[np.isfinite(values)]
    never_count = int(np.count_nonzero(np.isinf(values)))
    if not finite.size:
        return svg.card(f"{title}, {unit}", "", "no run has this score")
    low, median, high = np.quantile(finite, (0.05, 0.5, 0.95)).tolist()
    percentiles = f"median {format_number(median)}, 5 to 95 %: {format_number(low)} to {format_number(high)}"
    lines = [f"{percentiles}, largest {format_number(np.max(finite))} {unit}"]
    if never_count:
        lines.append(f"never in {never_count} runs ({_percent(never_count / values.size)})")
    return svg.card(f"{title}, {unit}", svg.histogram(finite, (low, median, high)), *lines)


def _sensitivities(results: Results) -> Iterator[str]:
    # The correlation is computed within each sea, because differences between seas would hide it.
    seas = results.drawn_values.get("scenario", np.zeros(results.runs))
    numbers = {name: values for name, values in results.drawn_values.items() if values.dtype.kind == "f"}
    images = []
    for score, values in results.scores.items():
        correlations = [
            (name, statistics.rank_correlation(drawn_values, values, seas)) for name, drawn_values in numbers.items()
        ]
        rows = [
            Interval(name, estimate.value, estimate.low, estimate.high)
            for name, estimate in correlations
            if estimate is not None
        ]
        if rows:
            rows.sort(key=lambda row: -abs(row.value))
            images.append(svg.card(NAMES[score][0], svg.intervals(rows, 1.0)))
    if images:
        yield page.heading("Sensitivity")
        yield svg.cards(images)
        yield page.paragraph(SENSITIVITY_NOTE, "note")


def _choices(results: Results) -> Iterator[str]:
    """Yield a table of failed runs and medians for each drawn quantity with few different values."""
    choices_by_name = {
        name: np.unique(values) for name, values in results.drawn_values.items() if _has_few_values(values)
    }
    if not choices_by_name:
        return
    yield page.heading("Results by choice")
    head = ("", "runs", "failed", *(f"{title}, {unit}" for title, unit in (NAMES[name] for name in results.scores)))
    rows: list[Sequence[str | Cell]] = [head]
    for name, choices in choices_by_name.items():
        for choice in choices:
            is_chosen = results.drawn_values[name] == choice
            failed = int(np.count_nonzero(results.failed[is_chosen] != ""))
            choice_text = choice if isinstance(choice, str) else f"{choice:g}"
            medians = (_median(values[is_chosen]) for values in results.scores.values())
            rows.append((f"{name} {choice_text}", str(np.count_nonzero(is_chosen)), str(failed), *medians))
    yield page.table(rows)
    yield page.paragraph("Medians over the runs; a run that never settles counts as the largest value.", "note")


def _has_few_values(values: NDArray[Any]) -> bool:
    return len(np.unique(values[: 50 * MAX_CHOICES])) <= MAX_CHOICES and len(np.unique(values)) <= MAX_CHOICES


def _median(values: Array) -> str:
    known = np.sort(values[~np.isnan(values)])
    if not known.size:
        return "-"
    value = float(known[(known.size - 1) // 2])
    return "never" if np.isinf(value) else format_number(value)


def _worst_runs(results: Results) -> Iterator[str]:
    yield page.heading("Worst runs")
    rows: list[Sequence[str | Cell]] = [("", "", _text_cell("draws"))]
    for name in RANKED_SCORES:
        values = results.scores[name]
        known = np.flatnonzero(~np.isnan(values))
        worst = known[np.argsort(-values[known], kind="stable")[:WORST_RUNS]].tolist()
        rows += [
            (f"run {row}", f"{NAMES[name][0]} {_score(name, values[row])}", _draws_cell(results, row)) for row in worst
        ]
    yield page.table(rows)


def _failed_runs(results: Results) -> Iterator[str]:
    failed = np.flatnonzero(results.failed != "")
    if not failed.size:
        return
    yield page.heading("Failed runs")
    rows: list[Sequence[str | Cell]] = [("", _text_cell("reason"), _text_cell("warnings"), _text_cell("draws"))]
    for row in failed[:MAX_FAILED_ROWS].tolist():
        warnings = results.faults[row] or ""
        rows.append((f"run {row}", _text_cell(results.failed[row]), _text_cell(warnings), _draws_cell(results, row)))
    yield page.table(rows)
    if failed.size > MAX_FAILED_ROWS:
        yield page.paragraph(f"First {MAX_FAILED_ROWS} of {failed.size}; {store.RUNS} lists all.", "note")


def command(results: Results, row: int) -> str:
    """Return the command line that repeats a run."""
    out = results.directory / f"run-{row}"
    return shlex.join(("rambler-hil", "campaign", "replay", str(results.directory), str(row), "--out", str(out)))


def _draws_cell(results: Results, row: int) -> Cell:
    texts = [f"{name} {results.text_of(name, row)}" for name in results.drawn_values]
    return Cell(", ".join([f"seed {results.seeds[row]}", *texts]), "words", command(results, row))


def _score(name: str, value: float) -> str:
    return "never" if np.isinf(value) else f"{format_number(value)} {NAMES[name][1]}"


def _text_cell(words: str) -> Cell:
    return Cell(words, "words")


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.3g} %"
