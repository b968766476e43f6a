"""Writes changed parameters: at once, but rate-limited for a stream of changes to protect the flash card."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from firmware_py.common.interfaces import StateWriter
from firmware_py.common.token_bucket import TokenBucket

BURST, RATE_HZ = 1000.0, 0.5  # limit of writes
AWAITED_LIMIT: Final = 256  # callbacks that wait for a write; more are called with False


class ParameterWriter:
    """Collects changed parameters and passes them to the store together with the waiting callbacks."""

    def __init__(self, writer: StateWriter) -> None:
        """Create it with the store of parameters."""
        self._writer = writer
        self._changed: dict[str, float] = {}  # not passed to the store yet
        self._waiting: list[Callable[[bool], None]] = []
        self._bucket = TokenBucket(BURST, RATE_HZ)

    def change(self, name: str, value: float) -> None:
        """Register a changed value; it is passed on with the next tick, or when a callback waits for it."""
        self._changed[name] = value

    def forget(self) -> None:
        """Delete all stored parameters, or none if that fails."""
        self._flush()
        self._writer.clear_parameters()

    def when_stored(self, call: Callable[[bool], None], now_s: float) -> None:
        """Call back when all changes so far are on disk (True) or cannot be stored (False)."""
        if len(self._waiting) >= AWAITED_LIMIT:
            call(False)
            return
        self._waiting.append(call)
        self.update(now_s)

    def update(self, now_s: float, *, last: bool = False) -> None:
        """Pass changes on if the rate limit allows; `last`: in any case."""
        if self._changed and not last and not self._bucket.spend_one(now_s):
            return
        self._flush()

    def _flush(self) -> None:
        changed, self._changed = self._changed, {}
        if changed:
            self._writer.save_parameters(changed)
        waiting, self._waiting = self._waiting, []
        for call in waiting:
            self._writer.when_parameters_stored(call)
