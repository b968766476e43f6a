"""Gusts of wind on the float's side, as a rudder-equivalent angle.

Each gust is a pulse of the form strength/2 (1 - cos(2 pi t / length)), the discrete gust of aircraft certification
(14 CFR 25.341). Gusts come at random times and do not overlap.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import TWO_PI

PAUSE_S = 60.0  # between gusts: mean of an exponential distribution
MIN_LENGTH_S, MAX_LENGTH_S = 10.0, 40.0


class Gusts:
    """A rudder-equivalent angle, zero between gusts; peaks are Rayleigh distributed, all to one side."""

    def __init__(self, strength_rad: float, step_s: float, source: np.random.Generator) -> None:
        """Start in a pause; strength_rad is the root mean square of the peaks."""
        self._strength_rad = strength_rad
        self._step_s = step_s
        self._source = source
        self._step = 0
        self._begin, self._length, self._peak_rad = 0, 1, 0.0
        if strength_rad != 0.0:
            self._draw()
        self.angle_rad = 0.0

    def step(self) -> None:
        """Advance one grid step."""
        if self._strength_rad == 0.0:
            return
        self._step += 1
        since = self._step - self._begin
        if since >= self._length:
            self._draw()
            since = self._step - self._begin
        self.angle_rad = 0.0 if since < 0 else 0.5 * self._peak_rad * (1.0 - math.cos(TWO_PI * since / self._length))

    def _draw(self) -> None:
        """Draw start, length and peak of the next gust."""
        self._begin = self._step + round(self._source.exponential(PAUSE_S) / self._step_s)
        self._length = max(1, round(self._source.uniform(MIN_LENGTH_S, MAX_LENGTH_S) / self._step_s))
        self._peak_rad = self._strength_rad * math.sqrt(self._source.exponential(1.0))
