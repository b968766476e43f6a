"""So many at once, and so many a second in the long run."""

from __future__ import annotations


class TokenBucket:
    """A bucket of tokens that fills again with time."""

    __slots__ = ("_burst", "_left", "_rate_hz", "_updated_s")

    def __init__(self, burst: int, rate_hz: float) -> None:
        """Start full."""
        self._burst = float(burst)
        self._left = float(burst)
        self._rate_hz = rate_hz
        self._updated_s = 0.0

    def take(self, now_s: float) -> bool:
        """Take one, if there is one."""
        self._left = min(self._burst, self._left + max(0.0, now_s - self._updated_s) * self._rate_hz)
        self._updated_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True
