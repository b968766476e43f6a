"""Handlers of all signals, because a signal must not stop the autopilot with the rudder deflected.

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
    """The action on a signal; the text is part of the reference page."""

    STOP = "reported and logged; the rudder is made safe; exit code 0"
    CONTINUE = "ignored, reported once"
    IGNORE = "ignored"


# SIGTTIN and SIGTTOU would call a handler endlessly, so the kernel ignores them. SIGXCPU is sent shortly before the
# limit of processor time is reached. Real-time signals are handled like the last row.
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
    """A context manager that handles the signals of this process; for the main thread."""

    def __init__(self) -> None:
        """Initialise without received signals."""
        self.is_stopping = False
        self._signals: deque[int] = deque()
        self._previous_handlers: dict[int, object] = {}

    def __enter__(self) -> Self:
        """Install the handlers."""
        handlers: dict[Action, Handler] = {
            Action.STOP: self._stop,
            Action.CONTINUE: self._continue,
            Action.IGNORE: signal.SIG_IGN,
        }
        for number in (*TABLE, *range(signal.SIGRTMIN, signal.SIGRTMAX + 1)):
            action = TABLE[number] if isinstance(number, signal.Signals) else Action.CONTINUE
            self._previous_handlers[number] = signal.signal(number, handlers[action])
        signal.pthread_sigmask(signal.SIG_UNBLOCK, self._previous_handlers)  # blocked by `block` before a restart
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the handlers; if stopping, ignore all signals instead, so that none changes the exit code."""
        for number, previous_handler in self._previous_handlers.items():
            signal.signal(number, signal.SIG_IGN if self.is_stopping else previous_handler)  # type: ignore[arg-type]

    def block(self) -> None:
        """Block the signals until the program that replaces this one handles them."""
        signal.pthread_sigmask(signal.SIG_BLOCK, self._previous_handlers)

    def take_events(self) -> tuple[Event, ...]:
        """Return the events of the signals since the last call."""
        return tuple(_event(self._signals.popleft()) for _ in range(len(self._signals)))

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        if not self.is_stopping:  # only the first one is reported
            self._signals.append(number)
        self.is_stopping = True

    def _continue(self, number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # further ones are not reported
        self._signals.append(number)


def _event(number: int) -> Event:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"SIGRTMIN+{number - signal.SIGRTMIN}"
    known_signal = signal.Signals(number) if number in TABLE else None
    if known_signal is not None and TABLE[known_signal] is Action.STOP:
        return Event(Severity.WARNING, f"{name}: autopilot ends, rudder centred")
    reason = "not used" if known_signal is None else REASONS.get(known_signal, "not used")
    return Event(Severity.WARNING, f"{name}: {reason}; autopilot continues")
