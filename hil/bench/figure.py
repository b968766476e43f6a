"""One measured figure, beside its bare limit, its aim and its peers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

TIMES: Final = "times"  # the unit of what is a ratio to something measured in the same run


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the result.

    `bare` is what the machine gives to a program that does nothing else. The aim is a
    most or a least for the figure itself, or a most for its ratio to the bare limit. `peer` is
    the same figure of other autopilots, in words. `paired_ratio` stands for the ratio of both
    where they were measured in turns: the middle of the ratios of neighbours, which a load that
    comes and goes does not shift. `repeats` are the steady quantities of all repeats, where it was measured more than
    once.
    """

    name: str
    unit: str
    value: float
    bare: float | None = None
    most: float | None = None
    most_ratio: float | None = None
    peer: str = ""
    least: float | None = None
    paired_ratio: float | None = None
    repeats: tuple[float, ...] = ()

    @property
    def ratio(self) -> float | None:
        """The figure by its bare limit; None without one, or where that is zero."""
        if self.paired_ratio is not None:
            return self.paired_ratio
        return self.value / self.bare if self.bare else None

    @property
    def steady(self) -> float | None:
        """What of it another machine, or a busy hour, changes least: its ratio, or itself where it is one already."""
        return self.value if self.unit == TIMES else self.ratio

    @property
    def more_is_better(self) -> bool:
        """Whether it worsens by falling."""
        return self.unit == TIMES or self.least is not None

    @property
    def met(self) -> bool | None:
        """Whether the aim is met; None without an aim."""
        if self.most is not None:
            return self.value <= self.most
        if self.least is not None:
            return self.value >= self.least
        if self.most_ratio is not None:
            return self.ratio is not None and self.ratio <= self.most_ratio
        return None


@dataclass(frozen=True, slots=True)
class Finding:
    """What a measurement found: its figures, and in words how they were got."""

    title: str
    figures: tuple[Figure, ...]
    notes: tuple[str, ...] = ()
