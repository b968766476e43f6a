"""How fast a radio modem takes what a line brings it: slower by air than the line, and it says so by RADIO_STATUS."""

from __future__ import annotations

_FULL, _FILLING, _EMPTY = 20, 50, 90  # percent of the modem's buffer that is free, as ArduPilot judges it
_HALF, _LESS, _MORE = 0.5, 0.8, 1.15  # of the speed, at each word of the modem: about one a second
_ALL = 100
_SILENT_S = 10.0  # a modem that says nothing for so long is none any more
_LEAST_BYTES_S = 120.0  # heartbeats and answers in any case, whatever a modem (or who forges one) says


class RadioPace:
    """The share of a line's speed that the modem behind it keeps up with."""

    __slots__ = ("_heard_s", "_least", "share")

    def __init__(self, byte_rate: float | None) -> None:
        """Take the speed of the line in bytes a second; a network has no modem in it."""
        self._least = 1.0 if byte_rate is None else min(1.0, _LEAST_BYTES_S / byte_rate)
        self.share = 1.0
        self._heard_s = 0.0

    def hear(self, free_percent: int, now_s: float) -> None:
        """Take how much of its buffer is free; what cannot be tells nothing."""
        if not 0 <= free_percent <= _ALL:
            return
        self._heard_s = now_s
        if free_percent < _FULL:
            self.share *= _HALF
        elif free_percent < _FILLING:
            self.share *= _LESS
        elif free_percent > _EMPTY:
            self.share *= _MORE
        self.share = min(max(self.share, self._least), 1.0)

    def forget(self, now_s: float) -> bool:
        """Go back to all of it where no modem says anything any more; return whether that changes anything."""
        if self.share == 1.0 or now_s - self._heard_s <= _SILENT_S:
            return False
        self.share = 1.0
        return True
