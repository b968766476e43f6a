"""Token bucket for rate limits."""

from __future__ import annotations

import math


class TokenBucket:
    """A bucket of tokens (messages, bytes, ...) that is refilled at a constant rate."""

    __slots__ = ("_burst", "_full_rate_hz", "_level", "_max_elapsed_s", "_rate_hz", "_updated_s")

    def __init__(self, burst: float, rate_hz: float, *, is_full: bool = True, max_elapsed_s: float = math.inf) -> None:
        """Create a bucket with capacity `burst` and fill rate `rate_hz`, full or empty.

        Between two calls, at most the tokens of `max_elapsed_s` are added.
        """
        self._burst = float(burst)
        self._level = self._burst if is_full else 0.0
        self._rate_hz = self._full_rate_hz = rate_hz
        self._max_elapsed_s = max_elapsed_s
        self._updated_s = 0.0

    def level(self, now_s: float) -> float:
        """Refill up to now and return the number of tokens; negative after overspending."""
        elapsed_s = min(max(0.0, now_s - self._updated_s), self._max_elapsed_s)
        self._updated_s = now_s
        self._level = min(self._burst, self._level + elapsed_s * self._rate_hz)
        return self._level

    def set_rate_share(self, share: float, now_s: float) -> None:
        """Reduce the fill rate to a share (0 to 1) of the initial rate."""
        self.level(now_s)
        self._rate_hz = share * self._full_rate_hz

    def spend(self, count: float) -> None:
        """Remove tokens."""
        self._level -= count

    def spend_one(self, now_s: float) -> bool:
        """Remove one token and return True, or return False if there is none."""
        if self.level(now_s) < 1.0:
            return False
        self.spend(1.0)
        return True
