"""Keeping a run at a multiple of real time."""

from __future__ import annotations

import math
import time


class Pacer:
    """Sleeps until the wall clock has caught up with the simulated one, counted from the first call: no drift."""

    def __init__(self, speed: float) -> None:
        """Take how many simulated seconds pass in a second; infinity for as fast as it goes."""
        self.keep(speed)

    def keep(self, speed: float) -> None:
        """Keep to another speed from the next call on."""
        self._speed = speed
        self._start: tuple[float, float] | None = None

    def wait(self, simulated_s: float) -> None:
        """Sleep, if need be, until simulated_s is due."""
        if not math.isfinite(self._speed):
            return
        now_s = time.monotonic()
        if self._start is None:
            self._start = (now_s, simulated_s)
        ahead_s = self._start[0] + (simulated_s - self._start[1]) / self._speed - now_s
        if ahead_s > 0.0:
            time.sleep(ahead_s)
