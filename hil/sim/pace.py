"""Pacing of a run at a multiple of real time."""

from __future__ import annotations

import math
import time


class Pacer:
    """Sleep until the simulated time is due on the wall clock; both count from the first call, so there is no drift."""

    def __init__(self, speed: float) -> None:
        """Set the simulated seconds per second; infinity for as fast as possible."""
        self.set_speed(speed)

    def set_speed(self, speed: float) -> None:
        """Change the speed from the next call on."""
        self._speed = speed
        self._start: tuple[float, float] | None = None

    def wait(self, simulated_s: float) -> None:
        """Sleep until simulated_s is due."""
        if not math.isfinite(self._speed):
            return
        now_s = time.monotonic()
        if self._start is None:
            self._start = (now_s, simulated_s)
        remaining_s = self._start[0] + (simulated_s - self._start[1]) / self._speed - now_s
        if remaining_s > 0.0:
            time.sleep(remaining_s)
