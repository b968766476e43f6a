"""Gusts of wind on the side of the float, as an angle that is added to the rudder bias (positive turns to port).

Each gust is a pulse peak/2 (1 - cos(2 pi t / length)), the discrete gust of aircraft certification
(14 CFR 25.341). Gusts come at random times and do not overlap.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import TWO_PI

MEAN_PAUSE_S = 60.0  # between gusts: mean of an exponential distribution
MIN_LENGTH_S, MAX_LENGTH_S = 10.0, 40.0


class Gusts:
    """An angle added to the rudder bias, zero between gusts; peaks are Rayleigh distributed, all positive."""

    def __init__(self, strength_rad: float, step_s: float, rng: np.random.Generator) -> None:
        """Start in a pause; strength_rad is the root mean square of the peaks."""
        self._strength_rad = strength_rad
        self._step_s = step_s
        self._rng = rng
        self._step = 0
        self._start_step, self._length_steps, self._peak_rad = 0, 1, 0.0
        if strength_rad != 0.0:
            self._draw()
        self.angle_rad = 0.0

    def step(self) -> None:
        """Advance one grid step."""
        if self._strength_rad == 0.0:
            return
        self._step += 1
        gust_step = self._step - self._start_step
        if gust_step >= self._length_steps:
            self._draw()
            gust_step = self._step - self._start_step
        self.angle_rad = (
            0.0 if gust_step < 0 else 0.5 * self._peak_rad * (1.0 - math.cos(TWO_PI * gust_step / self._length_steps))
        )

    def _draw(self) -> None:
        """Draw start, length and peak of the next gust."""
        self._start_step = self._step + round(self._rng.exponential(MEAN_PAUSE_S) / self._step_s)
        self._length_steps = max(1, round(self._rng.uniform(MIN_LENGTH_S, MAX_LENGTH_S) / self._step_s))
        self._peak_rad = self._strength_rad * math.sqrt(self._rng.exponential(1.0))
