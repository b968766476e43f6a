"""When parameters that were set are written: at once, and where a stream comes seldom enough for a flash card."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from firmware_py.common.interfaces import StateWriter
from firmware_py.common.token_bucket import TokenBucket

BURST, RATE_HZ = 1000.0, 0.5  # writes: so many at once, and in a second in the long run
AWAITED_LIMIT: Final = 256  # answers that wait for a write; more are told that it cannot be said


class ParameterKeeper:
    """Gathers what was set and hands it over whole; whoever waits for a write is handed over with it."""

    def __init__(self, keeper: StateWriter) -> None:
        """Take what keeps parameters."""
        self._keeper = keeper
        self._changed: dict[str, float] = {}  # set, and not handed over
        self._unkept: list[Callable[[bool], None]] = []  # who waits for that
        self._bucket = TokenBucket(BURST, RATE_HZ)

    def change(self, name: str, value: float) -> None:
        """Take a value that was set: it is handed over when somebody waits for it, or with the tick."""
        self._changed[name] = value

    def forget(self) -> None:
        """Have all forgotten that was ever set, or none when that cannot be stored."""
        self._hand_over()
        self._keeper.clear_parameters()

    def when_stored(self, call: Callable[[bool], None], now_s: float) -> None:
        """Call back once what was set so far is on disk, or cannot be."""
        if len(self._unkept) >= AWAITED_LIMIT:
            call(False)
            return
        self._unkept.append(call)
        self.update(now_s)

    def update(self, now_s: float, *, last: bool = False) -> None:
        """Hand over what has changed, if there is a write to spare; `last`: nothing comes after it."""
        if self._changed and not last and not self._bucket.spend_one(now_s):
            return
        self._hand_over()

    def _hand_over(self) -> None:
        changed, self._changed = self._changed, {}
        if changed:
            self._keeper.save_parameters(changed)
        unkept, self._unkept = self._unkept, []
        for call in unkept:
            self._keeper.when_parameters_stored(call)
