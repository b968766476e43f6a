"""Display of a run on a terminal if rich is installed; none in a pipe."""

from __future__ import annotations

import importlib.util
import math
import sys
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from hil.sim.ground_station import GroundStation
from hil.sim.world import World


@dataclass(frozen=True, slots=True)
class Banner:
    """Values of the display that are constant during a run."""

    title: str
    end_s: float
    links: tuple[str, ...]
    lockstep: bool


class Display(Protocol):
    """A display of the state of a run."""

    def __enter__(self) -> Self:
        """Start the display."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the display."""

    def update(self, slack_s: float = math.inf) -> None:
        """Show the present state if an update is due and slack_s is enough for drawing."""


class NoDisplay:
    """A display that shows nothing."""

    def __enter__(self) -> Self:
        """Start."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""

    def update(self, slack_s: float = math.inf) -> None:
        """Show nothing."""


def make_display(banner: Banner, world: World, station: GroundStation) -> Display:
    """Return the live display on a terminal, and no display in a pipe or without rich."""
    if not sys.stdout.isatty() or importlib.util.find_spec("rich") is None:
        return NoDisplay()
    from rich.console import Console  # noqa: PLC0415 - rich is optional

    from hil.sim.live_display import LiveDisplay  # noqa: PLC0415 - likewise

    return LiveDisplay(banner, world, station, Console())
