"""Two programs timed in turns, so that a load that comes and goes falls on both."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from hil.bench.figure import Figure


@dataclass(frozen=True, slots=True)
class Turns:
    """What each run of either took, in pairs of neighbours."""

    ours: tuple[float, ...]
    theirs: tuple[float, ...]

    @property
    def ratios(self) -> list[float]:
        """Ours by theirs, of each pair, in order of size."""
        return sorted(ours / theirs for ours, theirs in zip(self.ours, self.theirs, strict=True))

    @property
    def ratio(self) -> float:
        """The middle ratio."""
        return statistics.median(self.ratios)

    @property
    def quartiles(self) -> tuple[float, float]:
        """Between what the middle half of the ratios lies."""
        low, _, high = statistics.quantiles(self.ratios, n=4, method="inclusive")
        return low, high

    def figure(self, name: str, unit: str, scale: float, most_ratio: float | None = None) -> Figure:
        """Return the middle of ours beside that of theirs, as a figure; `scale` makes units of what was measured."""
        ours, theirs = (scale * statistics.median(each) for each in (self.ours, self.theirs))
        return Figure(name, unit, ours, theirs, most_ratio=most_ratio, paired_ratio=self.ratio)

    def times_faster(self, name: str, least: float) -> Figure:
        """Return how many times faster ours is, as a figure."""
        return Figure(name, "times", 1.0 / self.ratio, least=least)

    def spread_text(self) -> str:
        """Say from what to what the speed-ups of the pairs went."""
        low, high = 1.0 / self.ratios[-1], 1.0 / self.ratios[0]
        return f"{low:.3g} to {high:.3g} times in {len(self.ours)} pairs of runs, one after the other"


def in_turns(ours: Callable[[int], float], theirs: Callable[[int], float], pairs: int) -> Turns:
    """Run both by turns; each takes the number of the pair and returns what its run took."""
    taken = [(ours(number), theirs(number)) for number in range(pairs)]
    return Turns(tuple(one for one, _ in taken), tuple(other for _, other in taken))
