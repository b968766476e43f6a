"""Signals while code is compiled: they wait until they can be raised."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from typing import Any

from numba.core import event


class HeldSignals(event.Listener):
    """Holds signals back while the main thread is in the compiler: raised in what LLVM calls back, they would be lost.

    They come when the compiler, or one of its parts, has ended.
    """

    def __init__(self) -> None:
        """Hold none yet."""
        self._depth = 0
        self._due: int | None = None
        self._before: dict[int, Any] = {}

    def on_start(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Hold them from now on."""
        if threading.current_thread() is not threading.main_thread():
            return
        if not self._depth:
            self._before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
            self._set(lambda number, _frame: setattr(self, "_due", number))
        self._depth += 1

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - numba's signature
        """Let the one that came meanwhile do what it does."""
        if threading.current_thread() is not threading.main_thread():
            return
        self._depth -= 1
        if not self._depth:
            self._set(None)
        due, self._due = self._due, None
        if due is not None:
            self._before[due](due, None)

    def _set(self, handler: Callable[[int, object], None] | None) -> None:
        for number, before in self._before.items():
            if callable(before):  # else it is the system's, which ends the program at once
                signal.signal(number, before if handler is None else handler)
