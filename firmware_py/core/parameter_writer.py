"""Writes changed parameters at once; a stream of changes is rate-limited, to protect the flash card."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from firmware_py.common.interfaces import StateWriter
from firmware_py.common.token_bucket import TokenBucket

BURST, RATE_HZ = 1000.0, 0.5  # limits of a token bucket for writes
MAX_AWAITED: Final = 256  # callbacks that wait for a write; further ones are called with False


class ParameterWriter:
    """Changed parameters and callbacks that wait for the next write."""

    def __init__(self, writer: StateWriter) -> None:
        """Create it with the store for the parameters."""
        self._writer = writer
        self._changed: dict[str, float] = {}  # not yet passed to the store
        self._callbacks: list[Callable[[bool], None]] = []
        self._bucket = TokenBucket(BURST, RATE_HZ)

    def change(self, name: str, value: float) -> None:
        """Register a changed value; it is written in the next tick, or earlier if a callback waits for it."""
        self._changed[name] = value

    def forget(self) -> None:
        """Delete all stored parameters, after earlier changes are passed to the store."""
        self._flush()
        self._writer.clear_parameters()

    def when_stored(self, call: Callable[[bool], None], now_s: float) -> None:
        """Call back when all changes so far are on disk (True), or cannot be stored (False)."""
        if len(self._callbacks) >= MAX_AWAITED:
            call(False)
            return
        self._callbacks.append(call)
        self.update(now_s)

    def update(self, now_s: float, *, last: bool = False) -> None:
        """Pass the changes to the store if the rate limit permits; `last`: in any case."""
        if self._changed and not last and not self._bucket.spend_one(now_s):
            return
        self._flush()

    def _flush(self) -> None:
        changed, self._changed = self._changed, {}
        if changed:
            self._writer.save_parameters(changed)
        callbacks, self._callbacks = self._callbacks, []
        for call in callbacks:
            self._writer.when_parameters_stored(call)
