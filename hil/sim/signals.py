"""Handling of Ctrl-C and SIGTERM in the harness."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def stop_signal_handler() -> Iterator[Callable[[], bool]]:
    """Handle Ctrl-C and SIGTERM; yield a function that returns whether one has arrived.

    A second signal has its usual effect.
    """
    is_stopped = False
    previous_handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def stop(number: int, _frame: object) -> None:
        nonlocal is_stopped
        is_stopped = True
        signal.signal(number, previous_handlers[signal.Signals(number)])

    for number in previous_handlers:
        signal.signal(number, stop)
    try:
        yield lambda: is_stopped
    finally:
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


@contextmanager
def interruptible() -> Iterator[None]:
    """Make SIGTERM raise KeyboardInterrupt like Ctrl-C, so that context managers close all processes and ports.

    This has no effect outside the main thread.
    """

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    try:
        previous_handler = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous_handler)
