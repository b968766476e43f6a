"""Comparison of the bench with a baseline: ratios that are worse by more than their scatter.

The limit of a compared quantity is computed from the repeats stored with the baseline. Their logarithms are nearly
normal, so a further reading exceeds the upper limit of the prediction interval (Hahn and Meeker, Statistical Intervals,
1991, 4.7) by chance with a probability of FALSE_ALARM over all that are compared.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from scipy.special import stdtrit  # scipy.stats takes a second to import

from hil.bench.figure import Figure, Finding
from hil.bench.report import number
from hil.errors import UsageError
from hil.report.figure_file import COUNTED, key_of

MIN_REPEATS: Final = 5
FALSE_ALARM: Final = 0.01
MIN_TOLERANCE: Final = 0.02  # counts have no scatter, but may grow slightly with each change
WORSE_IN_A_ROW: Final = 3  # a temporary load does not affect all repetitions
Baseline = Mapping[str, Sequence[float]]


@dataclass(frozen=True, slots=True)
class Verdict:
    """A compared quantity of a figure: its baseline, its limit and its present value."""

    measurement: str
    name: str
    baseline: float
    limit: float
    present: float
    more_is_better: bool
    is_count: bool = False

    @property
    def is_worse(self) -> bool:
        """True if the value is beyond the limit, or NaN."""
        return not (self.present >= self.limit if self.more_is_better else self.present <= self.limit)

    @property
    def text(self) -> str:
        """One line for the terminal."""
        bound = "at least" if self.more_is_better else "at most"
        verdict = "WORSE" if self.is_worse else "as before"
        return (
            f"  {self.measurement}: {self.name}: {number(self.baseline)}x before, {number(self.present)}x now "
            f"({bound} {number(self.limit)}): {verdict}"
        )


def median(repeats: Sequence[Finding]) -> Finding:
    """Return the median of each figure over findings of one measurement, with the quantities of all repeats."""
    last = repeats[-1]
    columns = zip(*(finding.figures for finding in repeats), strict=True)
    return last if len(repeats) == 1 else replace(last, figures=tuple(_median(column) for column in columns))


def _median(column: Sequence[Figure]) -> Figure:
    ordered = sorted(
        column, key=lambda figure: figure.value if figure.compared_quantity is None else figure.compared_quantity
    )
    quantities = tuple(
        value for figure in column if (value := figure.compared_quantity) is not None and _is_valid(value)
    )
    return replace(ordered[len(ordered) // 2], repeats=quantities)


def baseline_of(entries: Mapping[str, Mapping[str, Any]]) -> Baseline:
    """Return the repeats of the entries of a figure file that have enough repeats."""
    baseline = {}
    for key, entry in entries.items():
        repeats = entry.get("repeats") if isinstance(entry, Mapping) else None
        if isinstance(repeats, list) and len(repeats) >= MIN_REPEATS and all(map(_is_valid, repeats)):
            baseline[key] = tuple(float(value) for value in repeats)
    return baseline


def measurements_in(baseline: Baseline, names: Iterable[str]) -> list[str]:
    """Return the measurements in the baseline; raise UsageError if it contains none."""
    selected = [name for name in names if any(key.startswith(f"{key_of(name)}_") for key in baseline)]
    if not selected:
        raise UsageError(
            f"--against: no figure in the file has {MIN_REPEATS} repeats or more; "
            f"write some with --repeat {MIN_REPEATS + 2} --figures FILE"
        )
    return selected


def compare(baseline: Baseline, findings: Mapping[str, Finding]) -> list[Verdict]:
    """Return a verdict on each figure that is in baseline and findings."""
    return [
        Verdict(name, figure.name, *_median_and_limit(repeats, len(baseline), figure.more_is_better), quantity,
                figure.more_is_better, figure.unit == COUNTED)
        for name, finding in findings.items()
        for figure in finding.figures
        if (repeats := baseline.get(key_of(name, figure.name))) is not None
        and (quantity := figure.compared_quantity) is not None
    ]  # fmt: skip


def _median_and_limit(repeats: Sequence[float], comparisons: int, more_is_better: bool) -> tuple[float, float]:  # noqa: FBT001
    """Return the median of the repeats and the limit for a further one."""
    logarithms, count = [math.log(value) for value in repeats], len(repeats)
    quantile = float(stdtrit(count - 1, 1.0 - FALSE_ALARM / comparisons))
    margin = max(quantile * statistics.stdev(logarithms) * math.sqrt(1.0 + 1.0 / count), math.log1p(MIN_TOLERANCE))
    mean = statistics.fmean(logarithms)
    return statistics.median(repeats), math.exp(mean - margin if more_is_better else mean + margin)


def _is_valid(quantity: object) -> bool:
    return isinstance(quantity, int | float) and math.isfinite(quantity) and quantity > 0.0
