"""So much at once, and so much a second in the long run."""

from __future__ import annotations

import math


class TokenBucket:
    """A bucket of tokens that fills again with time; what a token is (an answer, a byte) is its owner's business."""

    __slots__ = ("_burst", "_level", "_longest_s", "_rate_hz", "_updated_s")

    def __init__(self, burst: float, rate_hz: float, *, full: bool = True, longest_s: float = math.inf) -> None:
        """Take how many tokens it holds and how many come in a second.

        It starts full or empty. However long nobody has looked, it gains no more than in `longest_s`.
        """
        self._burst = float(burst)
        self._level = self._burst if full else 0.0
        self._rate_hz = rate_hz
        self._longest_s = longest_s
        self._updated_s = 0.0

    def level(self, now_s: float) -> float:
        """Fill it up to now and return how many tokens are in it; below 0 after too much was spent."""
        elapsed_s = min(max(0.0, now_s - self._updated_s), self._longest_s)
        self._updated_s = now_s
        self._level = min(self._burst, self._level + elapsed_s * self._rate_hz)
        return self._level

    def pace(self, rate_hz: float, now_s: float) -> None:
        """Fill it faster or slower from now on."""
        self.level(now_s)
        self._rate_hz = rate_hz

    def spend(self, count: float) -> None:
        """Take tokens out."""
        self._level -= count

    def spend_one(self, now_s: float) -> bool:
        """Take one token out if there is one; False when there is none."""
        if self.level(now_s) < 1.0:
            return False
        self.spend(1.0)
        return True
