"""Comparison of the bench with a baseline: ratios that are worse by more than their scatter.

The compared value is a figure's steady quantity; its limit follows from the repeats stored with the baseline. Their
logarithms are nearly normal, so a further reading exceeds the upper limit of the prediction interval (Hahn and Meeker,
Statistical Intervals, 1991, 4.7) by chance with a probability of FALSE_ALARM over all that are compared.
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
    """A figure's steady quantity: its baseline, its limit and its present value."""

    measurement: str
    name: str
    was: float
    allowed: float
    now: float
    more_is_better: bool
    counted: bool = False

    @property
    def worse(self) -> bool:
        """Whether the value exceeds the scatter of its repeats; NaN does."""
        return not (self.now >= self.allowed if self.more_is_better else self.now <= self.allowed)

    @property
    def text(self) -> str:
        """One line for the terminal."""
        bound = "at least" if self.more_is_better else "at most"
        verdict = "WORSE" if self.worse else "as before"
        return (
            f"  {self.measurement}: {self.name}: {number(self.was)}x before, {number(self.now)}x now "
            f"({bound} {number(self.allowed)}): {verdict}"
        )


def median(repeats: Sequence[Finding]) -> Finding:
    """Return the median of each figure over findings of one measurement, with all their quantities."""
    last = repeats[-1]
    columns = zip(*(finding.figures for finding in repeats), strict=True)
    return last if len(repeats) == 1 else replace(last, figures=tuple(_median(column) for column in columns))


def _median(column: Sequence[Figure]) -> Figure:
    ordered = sorted(column, key=lambda figure: figure.value if figure.steady is None else figure.steady)
    quantities = tuple(one for figure in column if (one := figure.steady) is not None and _usable(one))
    return replace(ordered[len(ordered) // 2], repeats=quantities)


def baseline_of(entries: Mapping[str, Mapping[str, Any]]) -> Baseline:
    """Return the repeats of the entries of a figure file that have enough repeats."""
    found = {}
    for key, each in entries.items():
        repeats = each.get("repeats") if isinstance(each, Mapping) else None
        if isinstance(repeats, list) and len(repeats) >= MIN_REPEATS and all(map(_usable, repeats)):
            found[key] = tuple(float(one) for one in repeats)
    return found


def measured_in(baseline: Baseline, names: Iterable[str]) -> list[str]:
    """Return the measurements that the baseline contains, or raise UsageError if it contains none."""
    found = [name for name in names if any(key.startswith(f"{key_of(name)}_") for key in baseline)]
    if not found:
        raise UsageError(
            f"--against: no figure in the file has {MIN_REPEATS} repeats or more; "
            f"write some with --repeat {MIN_REPEATS + 2} --figures FILE"
        )
    return found


def compare(baseline: Baseline, findings: Mapping[str, Finding]) -> list[Verdict]:
    """Return a verdict on each figure that is in both."""
    return [
        Verdict(name, figure.name, *_allowed(repeats, len(baseline), figure.more_is_better), quantity,
                figure.more_is_better, figure.unit == COUNTED)
        for name, finding in findings.items()
        for figure in finding.figures
        if (repeats := baseline.get(key_of(name, figure.name))) is not None
        and (quantity := figure.steady) is not None
    ]  # fmt: skip


def _allowed(repeats: Sequence[float], compared: int, more_is_better: bool) -> tuple[float, float]:  # noqa: FBT001
    """Return the median of the repeats and the limit for a further one."""
    logarithms, count = [math.log(one) for one in repeats], len(repeats)
    quantile = float(stdtrit(count - 1, 1.0 - FALSE_ALARM / compared))
    reach = max(quantile * statistics.stdev(logarithms) * math.sqrt(1.0 + 1.0 / count), math.log1p(MIN_TOLERANCE))
    mean = statistics.fmean(logarithms)
    return statistics.median(repeats), math.exp(mean - reach if more_is_better else mean + reach)


def _usable(quantity: object) -> bool:
    return isinstance(quantity, int | float) and math.isfinite(quantity) and quantity > 0.0
