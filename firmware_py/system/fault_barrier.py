"""Keeps a mistake in the link from ending the loop: she steers on, says so, and the next call tries again.

A link that fails again and again is no link: then the mistake goes through, the process ends with
the rudder amidships, and the supervisor starts it anew.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable

from firmware_py.common.records import Event, Severity

MOST, WITHIN_S = 5, 600.0


class FaultBarrier:
    """Makes the calls whose mistakes the rudder does not depend on."""

    def __init__(self, explain: Callable[[str], None]) -> None:
        """Take what writes a line for the engineer, without waiting for anybody to read it."""
        self._explain = explain
        self._mistakes_s: deque[float] = deque(maxlen=MOST)
        self._untold: list[Event] = []

    def call(self, now_s: float, act: Callable[[], None]) -> None:
        """Act; a mistake is noted, and the one that is too much raised."""
        try:
            act()
        except Exception as mistake:
            if len(self._mistakes_s) == MOST and now_s - self._mistakes_s[0] < WITHIN_S:
                raise
            self._mistakes_s.append(now_s)
            for line in "".join(traceback.format_exception(mistake)).splitlines():
                self._explain(line)
            self._untold.append(Event(Severity.CRITICAL, f"Link: {type(mistake).__name__} inside, she steers on"))

    def take_events(self) -> tuple[Event, ...]:
        """Hand over what is to be told since the last call."""
        events, self._untold = tuple(self._untold), []
        return events
