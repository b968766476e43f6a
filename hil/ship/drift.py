"""Slow variation of the rudder bias (first-order Gauss-Markov process)."""

from __future__ import annotations

import math

from hil.ship.noise import NormalNumbers

TIME_CONSTANT_S = 100.0


class RudderDrift:
    """A stationary random angle on a fixed grid."""

    def __init__(
        self, spread_rad: float, step_s: float, numbers: NormalNumbers, memory_s: float = TIME_CONSTANT_S
    ) -> None:
        """Start in the stationary state; spread_rad is the standard deviation, memory_s the time constant."""
        self._correlation = math.exp(-step_s / memory_s)
        self._noise_rad = spread_rad * math.sqrt(1.0 - self._correlation**2)
        self._numbers = numbers
        self.angle_rad = spread_rad * numbers.draw()

    def step(self) -> None:
        """Advance one grid step."""
        self.angle_rad = self._correlation * self.angle_rad + self._noise_rad * self._numbers.draw()
