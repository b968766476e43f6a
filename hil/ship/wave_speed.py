"""The speed as the waves give it: it varies with their groups, and dies with them in a calm.

U = U0 c (1 + g),   g a first-order Gauss-Markov process,   dc/dt = (1 or, in the calm, 0 - c) / 60 s
"""

from __future__ import annotations

import math

from hil.ship.extras import WaveSpeed
from hil.ship.noise import NormalNumbers

MOST = 2.0  # of the mean speed
DYING_S = 60.0  # waves outlast their wind, and a boat of 200 kg her waves, by minutes


class SpeedInWaves:
    """Shares of the mean speed and of the waves, one grid step at a time: `speed` and `waves`, 1 for as they were."""

    def __init__(self, how: WaveSpeed, step_s: float, numbers: NormalNumbers) -> None:
        """Start in the stationary state."""
        self._keep = math.exp(-step_s / how.memory_s)
        self._add = how.spread * math.sqrt(1.0 - self._keep**2)
        self._fade = math.exp(-step_s / DYING_S)
        self._calm_s = (how.calm_at_s, how.calm_at_s + how.calm_for_s)
        self._numbers = numbers
        self._groups = how.spread * numbers.draw()
        self.waves = 1.0
        self.speed = self._speed()

    def step(self, now_s: float) -> None:
        """Move on to the next grid step, that ends at now_s."""
        self._groups = self._keep * self._groups + self._add * self._numbers.draw()
        level = 0.0 if self._calm_s[0] <= now_s < self._calm_s[1] else 1.0
        self.waves = level + self._fade * (self.waves - level)
        self.speed = self._speed()

    def _speed(self) -> float:
        return self.waves * min(max(1.0 + self._groups, 0.0), MOST)
