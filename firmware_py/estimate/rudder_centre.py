"""Offset of the rudder linkage, from the mean rudder angle on straight courses in calm water.

Ten minutes in which the heading hardly changes are one observation: the mean measured angle. Wind and waves need a
rudder angle that depends on the course, so each sector of the circle has the same weight. The mean over all sectors is
the offset of the linkage. It is only proposed, not set.
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
MAX_GAP_S: Final = 10.0  # between ticks; a longer gap begins another stretch
MAX_HEADING_SD_RAD: Final = radians(6.0)  # over a stretch; it is larger in waves or in a turn
MAX_TURN_RAD: Final = radians(25.0)  # from the first heading of a stretch; beyond it the stretch is discarded
MIN_READINGS: Final = 100  # of heading and of rudder, in a stretch
SECTORS: Final = 8  # of the full circle
MIN_STRETCHES, MIN_SECTORS = 12, 5
MAX_SD_RAD: Final = radians(0.5)


class RudderCentre(msgspec.Struct, frozen=True):
    """Mean offset of the rudder from the centre, its standard deviation, and the numbers of stretches and sectors."""

    mean_rad: float
    sd_rad: float
    stretches: int
    sectors: int

    @property
    def ready(self) -> bool:
        """Whether the offset is certain enough to be proposed."""
        is_complete = self.stretches >= MIN_STRETCHES and self.sectors >= MIN_SECTORS
        return is_complete and self.sd_rad <= MAX_SD_RAD


@dataclass(slots=True)
class _Stretch:
    """Stretch in progress: sums of the angle turned since its first heading, of its square, and of the rudder angle.

    `headings` and `readings` are the numbers of headings and of rudder angles in the sums.
    """

    begun_s: float
    last_s: float
    first_rad: float | None = None
    headings: int = 0
    turned_rad: float = 0.0
    square: float = 0.0
    readings: int = 0
    rudder_rad: float = 0.0


class RudderCentreEstimator:
    """Mean rudder angles of the stretches of a voyage."""

    def __init__(self) -> None:
        """Create an estimator without observations."""
        self.means_rad: list[list[float]] = [[] for _ in range(SECTORS)]
        self.unsteady = 0  # number of stretches discarded because of a turn or waves
        self._stretch: _Stretch | None = None

    def take(self, inputs: Inputs, to_rudder: Callable[[float], float], *, steers: bool) -> None:
        """Process a tick; `to_rudder` converts shaft to rudder angles. A tick without steering ends the stretch."""
        now_s, stretch = inputs.tick.t_s, self._stretch
        if not steers:
            self._stretch = None
            return
        if stretch is None or not 0.0 <= now_s - stretch.last_s <= MAX_GAP_S:
            stretch = self._stretch = _Stretch(now_s, now_s)
        stretch.last_s = now_s
        for heading in inputs.headings:
            if heading.source == 0 and math.isfinite(heading.heading_rad):
                if stretch.first_rad is None:
                    stretch.first_rad = heading.heading_rad
                turned_rad = wrap_pi(heading.heading_rad - stretch.first_rad)
                if abs(turned_rad) > MAX_TURN_RAD:
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

    def result(self) -> RudderCentre | None:
        """Return the estimated offset; None with fewer than two stretches."""
        all_means_rad = [mean for means in self.means_rad for mean in means]
        means_rad = [fmean(means) for means in self.means_rad if means]
        if len(all_means_rad) < 2:
            return None
        # With several sectors, that of their means: the effect of the wind differs between sectors.
        sd_rad = stdev(means_rad) / math.sqrt(len(means_rad)) if len(means_rad) > 1 else stdev(all_means_rad)
        return RudderCentre(fmean(means_rad), sd_rad, len(all_means_rad), len(means_rad))

    def _finish(self, stretch: _Stretch) -> None:
        """Store the mean rudder angle of a complete stretch, if it has enough readings and a steady heading."""
        if min(stretch.headings, stretch.readings) < MIN_READINGS or stretch.first_rad is None:
            return
        mean_rad = stretch.turned_rad / stretch.headings
        if stretch.square / stretch.headings - mean_rad**2 > MAX_HEADING_SD_RAD**2:
            self.unsteady += 1
            return
        sector = int((stretch.first_rad + mean_rad) % TWO_PI / TWO_PI * SECTORS) % SECTORS
        self.means_rad[sector].append(stretch.rudder_rad / stretch.readings)
