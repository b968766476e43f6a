"""The motion to and fro that waves give the float, and so the satellite receiver on it."""

from __future__ import annotations

import math

from firmware_py.common.angles import TWO_PI
from hil.ship.noise import NormalNumbers
from hil.ship.waves import WaveYaw


class Orbit:
    """The horizontal part of the orbital motion at the surface: along the way that the waves run.

    `velocity_m_s` is its standard deviation; a wave of height H and period T gives pi H / T at its crest.
    """

    def __init__(
        self, velocity_m_s: float, period_s: float, toward_rad: float, step_s: float, numbers: NormalNumbers
    ) -> None:
        """Start in the stationary state; no velocity or no period is a sea without waves."""
        calm = velocity_m_s <= 0.0 or period_s <= 0.0
        # Of a narrow band: the displacement is the velocity by the circular frequency.
        spread_m = 0.0 if calm else velocity_m_s * period_s / TWO_PI
        self._process = WaveYaw(spread_m, period_s, step_s, numbers)
        self._north, self._east = math.cos(toward_rad), math.sin(toward_rad)

    def step(self) -> None:
        """Move on to the next grid step."""
        self._process.step()

    def position_m(self, offset_s: float) -> tuple[float, float]:
        """Return the displacement north and east."""
        along_m = self._process.angle_rad(offset_s)
        return along_m * self._north, along_m * self._east

    def velocity_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity north and east."""
        along_m_s = self._process.rate_rad_s(offset_s)
        return along_m_s * self._north, along_m_s * self._east
