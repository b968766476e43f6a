"""What each signal does to an autopilot under way: a boat must not stop with her rudder over because of one.

The kernel's own answer to most of them is to end or to halt the process wherever it is.
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
    """What is done; the text is that of the reference page."""

    STOP = "told and logged, makes the rudder safe and ends, exit code 0"
    CONTINUE = "sails on, told once"
    IGNORE = "sails on"


# A handler would be called for ever by a terminal that stops who writes to it, so those are ignored in the kernel.
# SIGXCPU is the last warning before a limit of processor time kills. Real-time signals are like the last row.
TABLE: Mapping[signal.Signals, Action] = {
    **dict.fromkeys((signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGXCPU), Action.STOP),
    **dict.fromkeys((signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTTIN, signal.SIGTTOU), Action.IGNORE),
    **dict.fromkeys((signal.SIGHUP, signal.SIGTSTP, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM), Action.CONTINUE),
    **dict.fromkeys(
        (signal.SIGVTALRM, signal.SIGPROF, signal.SIGIO, signal.SIGPWR, signal.SIGSTKFLT), Action.CONTINUE
    ),
}  # fmt: skip
REASONS = {signal.SIGHUP: "the terminal has gone", signal.SIGTSTP: "halting is refused"}


class Signals:
    """Takes the signals of this process from the first moment on; a context, of the main thread."""

    def __init__(self) -> None:
        """Begin without any."""
        self.stopping = False
        self._told: deque[int] = deque()
        self._before: dict[int, object] = {}

    def __enter__(self) -> Self:
        """Take them over."""
        handlers: dict[Action, Handler] = {
            Action.STOP: self._stop,
            Action.CONTINUE: self._continue,
            Action.IGNORE: signal.SIG_IGN,
        }
        for number in (*TABLE, *range(signal.SIGRTMIN, signal.SIGRTMAX + 1)):
            act = TABLE[number] if isinstance(number, signal.Signals) else Action.CONTINUE
            self._before[number] = signal.signal(number, handlers[act])
        signal.pthread_sigmask(signal.SIG_UNBLOCK, self._before)  # what has waited since `hold`
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give them back; when it is told to stop, nothing shall change the exit code any more."""
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self.stopping else before)  # type: ignore[arg-type]

    def hold(self) -> None:
        """Have signals wait until the program that is started in place of this one takes them."""
        signal.pthread_sigmask(signal.SIG_BLOCK, self._before)

    def take_events(self) -> tuple[Event, ...]:
        """Hand over what is to be told of the signals since the last call."""
        return tuple(_event(self._told.popleft()) for _ in range(len(self._told)))

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        if not self.stopping:  # the first is what ends her
            self._told.append(number)
        self.stopping = True

    def _continue(self, number: int, _frame: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # told once; a flood of them costs nothing
        self._told.append(number)


def _event(number: int) -> Event:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"SIGRTMIN+{number - signal.SIGRTMIN}"
    known = signal.Signals(number) if number in TABLE else None
    if known is not None and TABLE[known] is Action.STOP:
        return Event(Severity.WARNING, f"{name}: she ends, the rudder goes amidships")
    reason = "it means nothing here" if known is None else REASONS.get(known, "it means nothing here")
    return Event(Severity.WARNING, f"{name}: {reason}, she sails on")
