"""What a run shows while it happens: a picture on a terminal, where rich is installed; nothing in a pipe."""

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
    """What does not change during a run."""

    title: str
    end_s: float
    links: tuple[str, ...]
    lockstep: bool


class Display(Protocol):
    """What a run shows while it goes."""

    def __enter__(self) -> Self:
        """Begin to show."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""

    def update(self, slack_s: float = math.inf) -> None:
        """Show the present state, if it is time to and slack_s is enough for drawing."""


class Silence:
    """Shows nothing."""

    def __enter__(self) -> Self:
        """Begin to show nothing."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""

    def update(self, slack_s: float = math.inf) -> None:
        """Show nothing."""


def make_display(banner: Banner, world: World, station: GroundStation) -> Display:
    """Return the live display on a terminal, and silence in a pipe or where there is nothing to draw with."""
    if not sys.stdout.isatty() or importlib.util.find_spec("rich") is None:
        return Silence()
    from rich.console import Console  # noqa: PLC0415 - a float that tries the box has none

    from hil.sim.live_display import LiveDisplay  # noqa: PLC0415 - likewise

    return LiveDisplay(banner, world, station, Console())
