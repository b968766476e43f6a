"""Handling of each signal: a signal must not stop the autopilot with the rudder deflected.

The default action of the kernel for most signals is to end or to stop the process at once.
"""

from __future__ import annotations

import signal
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from types import FrameType, TracebackType
from typing import Self

from firmware_py.common.records import Event, Severity

Handler = Callable[[int, FrameType | None], None] | signal.Handlers


class Action(Enum):
    """The action; the text is on the reference page."""

    STOP = "reported and logged; the rudder is made safe; exit code 0"
    CONTINUE = "ignored, reported once"
    IGNORE = "ignored"


# SIGTTIN and SIGTTOU would call a handler endlessly, so those are ignored in the kernel. SIGXCPU is the last warning
# before the limit of processor time. Real-time signals are like the last row.
TABLE: Mapping[signal.Signals, Action] = {
    **dict.fromkeys((signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGXCPU), Action.STOP),
    **dict.fromkeys((signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTTIN, signal.SIGTTOU), Action.IGNORE),
    **dict.fromkeys((signal.SIGHUP, signal.SIGTSTP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM), Action.CONTINUE),
    **dict.fromkeys(
        (signal.SIGVTALRM, signal.SIGPROF, signal.SIGIO, signal.SIGPWR, signal.SIGSTKFLT), Action.CONTINUE
    ),
}  # fmt: skip
REASONS = {signal.SIGHUP: "terminal closed", signal.SIGTSTP: "suspending refused"}


class Signals:
    """A context manager of the main thread that handles the signals of this process."""

    def __init__(self) -> None:
        """Start without signals."""
        self.stopping = False
        self._signals: deque[int] = deque()
        self._before: dict[int, object] = {}

    def __enter__(self) -> Self:
        """Install the handlers."""
        handlers: dict[Action, Handler] = {
            Action.STOP: self._stop,
            Action.CONTINUE: self._continue,
            Action.IGNORE: signal.SIG_IGN,
        }
        for number in (*TABLE, *range(signal.SIGRTMIN, signal.SIGRTMAX + 1)):
            act = TABLE[number] if isinstance(number, signal.Signals) else Action.CONTINUE
            self._before[number] = signal.signal(number, handlers[act])
        signal.pthread_sigmask(signal.SIG_UNBLOCK, self._before)  # blocked since `hold`
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the handlers; while stopping, ignore all signals so that none changes the exit code."""
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.stopping else before)  # type: ignore[arg-type]

    def hold(self) -> None:
        """Block signals until the program that replaces this one handles them."""
        signal.pthread_sigmask(signal.SIG_BLOCK, self._before)

    def take_events(self) -> tuple[Event, ...]:
        """Return the events of the signals since the last call."""
        return tuple(_event(self._signals.popleft()) for _ in range(len(self._signals)))

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        if not self.stopping:  # only the first one is reported
            self._signals.append(number)
        self.stopping = True

    def _continue(self, number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # reported once; further ones have no cost
        self._signals.append(number)


def _event(number: int) -> Event:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"SIGRTMIN+{number - signal.SIGRTMIN}"
    known = signal.Signals(number) if number in TABLE else None
    if known is not None and TABLE[known] is Action.STOP:
        return Event(Severity.WARNING, f"{name}: autopilot ends, rudder centred")
    reason = "not used" if known is None else REASONS.get(known, "not used")
    return Event(Severity.WARNING, f"{name}: {reason}; autopilot continues")
