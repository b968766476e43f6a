"""Where the rudder stands on the mean while she runs straight in calm water, from the ticks of her voyages.

Ten minutes in which her heading hardly moves are one observation: the mean measured angle. What wind and waves want of
the rudder changes with the course, so the means of the eighths of the circle count alike; what is left over on all
courses is the linkage's: she steers by a rudder whose amidships is not amidships. It looks on, and sets nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Final

import msgspec

from firmware_py.common.angles import TWO_PI, radians, wrap_pi
from firmware_py.common.records import Inputs

STRETCH_S: Final = 600.0
LONGEST_GAP_S: Final = 10.0
CALM_RAD: Final = radians(6.0)  # standard deviation of the heading over a stretch: more is waves, or a turn
TURNED_RAD: Final = radians(25.0)  # farther from its first heading than this a stretch is none
LEAST_READINGS: Final = 100
SECTORS: Final = 8
ENOUGH_STRETCHES, ENOUGH_SECTORS = 12, 5
ENOUGH_RAD: Final = radians(0.5)


class Centre(msgspec.Struct, frozen=True):
    """By how much the rudder's mean is off amidships, its standard deviation, and of how much that is made."""

    mean_rad: float
    sd_rad: float
    stretches: int
    sectors: int

    @property
    def ready(self) -> bool:
        """Whether it is enough for a proposal."""
        enough = self.stretches >= ENOUGH_STRETCHES and self.sectors >= ENOUGH_SECTORS
        return enough and self.sd_rad <= ENOUGH_RAD


@dataclass(slots=True)
class _Stretch:
    """A stretch under way: sums of what she has turned since its first heading, its square, and the rudder's angle."""

    begun_s: float
    last_s: float
    first_rad: float | None = None
    headings: int = 0
    turned_rad: float = 0.0
    square: float = 0.0
    readings: int = 0
    rudder_rad: float = 0.0


class CentreWatch:
    """Collects the stretches of a voyage."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self.means_rad: list[list[float]] = [[] for _ in range(SECTORS)]
        self.unsteady = 0  # stretches broken off by a turn, or in waves
        self._stretch: _Stretch | None = None

    def take(self, inputs: Inputs, to_rudder: Callable[[float], float], *, steers: bool) -> None:
        """Take a tick in; `to_rudder` makes a rudder angle of the shaft's. While nothing steers, it tells nothing."""
        now_s, stretch = inputs.tick.t_s, self._stretch
        if not steers:
            self._stretch = None
            return
        if stretch is None or not 0.0 <= now_s - stretch.last_s <= LONGEST_GAP_S:
            stretch = self._stretch = _Stretch(now_s, now_s)
        stretch.last_s = now_s
        for heading in inputs.headings:
            if heading.source == 0 and math.isfinite(heading.heading_rad):
                if stretch.first_rad is None:
                    stretch.first_rad = heading.heading_rad
                turned_rad = wrap_pi(heading.heading_rad - stretch.first_rad)
                if abs(turned_rad) > TURNED_RAD:
                    self.unsteady += 1
                    self._stretch = None
                    return
                stretch.headings += 1
                stretch.turned_rad += turned_rad
                stretch.square += turned_rad**2
        for rudder in inputs.rudder:
            if rudder.shaft_rad is not None and math.isfinite(rudder.shaft_rad):
                stretch.readings += 1
                stretch.rudder_rad += to_rudder(rudder.shaft_rad)
        if now_s - stretch.begun_s >= STRETCH_S:
            self._finish(stretch)
            self._stretch = None

    def result(self) -> Centre | None:
        """Return what has been found, None with fewer than two stretches."""
        stretches = [mean for means in self.means_rad for mean in means]
        sailed = [fmean(means) for means in self.means_rad if means]
        if len(stretches) < 2:
            return None
        # Of the sectors' means where there are several: what the wind does differs between them, and is no noise.
        sd_rad = stdev(sailed) / math.sqrt(len(sailed)) if len(sailed) > 1 else stdev(stretches)
        return Centre(fmean(sailed), sd_rad, len(stretches), len(sailed))

    def _finish(self, stretch: _Stretch) -> None:
        if min(stretch.headings, stretch.readings) < LEAST_READINGS or stretch.first_rad is None:
            return
        mean_rad = stretch.turned_rad / stretch.headings
        if stretch.square / stretch.headings - mean_rad**2 > CALM_RAD**2:
            self.unsteady += 1
            return
        sector = int((stretch.first_rad + mean_rad) % TWO_PI / TWO_PI * SECTORS) % SECTORS
        self.means_rad[sector].append(stretch.rudder_rad / stretch.readings)
