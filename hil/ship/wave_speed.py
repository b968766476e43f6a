"""Speed of the boat from wave power: it varies with the wave groups and decays with the waves in a calm.

    U = U0 c (1 + g)      dc/dt = (c_target - c) / 60 s

g is a first-order Gauss-Markov process; c is the wave amplitude relative to its mean; c_target is 0 in a calm, else 1.
"""

from __future__ import annotations

import math

from hil.ship.disturbances import WaveSpeed
from hil.ship.noise import NormalNumbers

MAX_SPEED_RATIO = 2.0
DECAY_S = 60.0  # waves outlast their wind, and a boat of 200 kg slows down, within minutes


class SpeedInWaves:
    """Ratios of speed and wave amplitude to their means, one grid step at a time."""

    def __init__(self, options: WaveSpeed, step_s: float, numbers: NormalNumbers) -> None:
        """Start in the stationary state."""
        self._correlation = math.exp(-step_s / options.memory_s)
        self._noise_gain = options.spread * math.sqrt(1.0 - self._correlation**2)
        self._decay = math.exp(-step_s / DECAY_S)
        self._calm_interval_s = (options.calm_at_s, options.calm_at_s + options.calm_for_s)
        self._numbers = numbers
        self._group_ratio = options.spread * numbers.draw()
        self.wave_ratio = 1.0
        self.speed_ratio = self._speed_ratio()

    def step(self, now_s: float) -> None:
        """Advance one grid step, which ends at now_s."""
        self._group_ratio = self._correlation * self._group_ratio + self._noise_gain * self._numbers.draw()
        target = 0.0 if self._calm_interval_s[0] <= now_s < self._calm_interval_s[1] else 1.0
        self.wave_ratio = target + self._decay * (self.wave_ratio - target)
        self.speed_ratio = self._speed_ratio()

    def _speed_ratio(self) -> float:
        return self.wave_ratio * min(max(1.0 + self._group_ratio, 0.0), MAX_SPEED_RATIO)
