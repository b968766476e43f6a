"""A pure delay on the grid: what goes in comes out so many steps later."""

from __future__ import annotations

from collections import deque


class PureDelay:
    """Holds values back for a whole number of grid steps; before the first has come through it gives `start`."""

    def __init__(self, delay_s: float, step_s: float, start: float = 0.0) -> None:
        """Take the delay to the nearest step."""
        self._waiting = deque([start] * round(delay_s / step_s))

    def step(self, value: float) -> float:
        """Put in this step's value and take out the one that is due."""
        self._waiting.append(value)
        return self._waiting.popleft()
