"""A pure delay on the grid of time steps."""

from __future__ import annotations

from collections import deque


class PureDelay:
    """Delay values by a whole number of grid steps; the output is `start` until the first value arrives."""

    def __init__(self, delay_s: float, step_s: float, start: float = 0.0) -> None:
        """Round the delay to the nearest step."""
        self._waiting = deque([start] * round(delay_s / step_s))

    def step(self, value: float) -> float:
        """Add the value of this step and return the delayed one."""
        self._waiting.append(value)
        return self._waiting.popleft()
