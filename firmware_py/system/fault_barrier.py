"""Keeps an error in the link from ending the loop: the boat steers on, says so, and the next call tries again.

A link that fails again and again is no link: then the error goes through, the process ends with
the rudder amidships, and the supervisor starts it anew.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable

from firmware_py.common.records import Event, Severity

MOST_ERRORS, WITHIN_S = 5, 600.0


class FaultBarrier:
    """Makes the calls whose errors the rudder does not depend on."""

    def __init__(self, explain: Callable[[str], None]) -> None:
        """Take what writes a line for the engineer, without waiting for anybody to read it."""
        self._explain = explain
        self._errors_s: deque[float] = deque(maxlen=MOST_ERRORS)
        self._events: list[Event] = []

    def call(self, now_s: float, act: Callable[[], None]) -> None:
        """Act; an error is noted, and the one that is too much raised."""
        try:
            act()
        except Exception as error:
            if len(self._errors_s) == MOST_ERRORS and now_s - self._errors_s[0] < WITHIN_S:
                raise
            self._errors_s.append(now_s)
            for line in "".join(traceback.format_exception(error)).splitlines():
                self._explain(line)
            self._events.append(Event(Severity.CRITICAL, f"Link: {type(error).__name__} inside, she steers on"))

    def take_events(self) -> tuple[Event, ...]:
        """Hand over the events since the last call."""
        events, self._events = tuple(self._events), []
        return events
