"""Prevents that an error in the link ends the loop: it is reported, and the next call tries again.

If MAX_ERRORS errors occurred within ERROR_WINDOW_S, the next one is raised: the process ends with the rudder centred,
and the service manager restarts it.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable

from firmware_py.common.records import Event, Severity

MAX_ERRORS, ERROR_WINDOW_S = 5, 600.0


class FaultBarrier:
    """Calls functions whose errors must not affect steering."""

    def __init__(self, print_line: Callable[[str], None]) -> None:
        """Store the function that prints a line of a traceback without blocking."""
        self._print_line = print_line
        self._errors_s: deque[float] = deque(maxlen=MAX_ERRORS)
        self._events: list[Event] = []

    def call(self, now_s: float, function: Callable[[], None]) -> None:
        """Call a function; store an error as an event, or raise it after too many errors."""
        try:
            function()
        except Exception as error:
            if len(self._errors_s) == MAX_ERRORS and now_s - self._errors_s[0] < ERROR_WINDOW_S:
                raise
            self._errors_s.append(now_s)
            for line in "".join(traceback.format_exception(error)).splitlines():
                self._print_line(line)
            text = f"Link error {type(error).__name__}; autopilot unaffected"
            self._events.append(Event(Severity.CRITICAL, text))

    def take_events(self) -> tuple[Event, ...]:
        """Return the events since the last call."""
        events, self._events = tuple(self._events), []
        return events
