"""Keeps a mistake in the link from ending the loop: she steers on, says so, and the next call tries again.

A link that fails again and again is no link: then the mistake goes through, the process ends with
the rudder amidships, and the supervisor starts it anew.
"""

from __future__ import annotations

import traceback
from collections import deque
from collections.abc import Callable, Sequence

from firmware_py.ports import Link
from firmware_py.records import Event, Output, Severity

MOST, WITHIN_S = 5, 600.0


class Shelter:
    """A ports.Link around another."""

    def __init__(self, link: Link, tell: Callable[[Event], None]) -> None:
        """Take the link and who is told of its mistakes."""
        self._link = link
        self._tell = tell
        self._mistakes_s: deque[float] = deque(maxlen=MOST)

    @property
    def busy(self) -> bool:
        """Whether something already read still waits for `service`."""
        return self._link.busy

    @property
    def station_s(self) -> float | None:
        """When a ground station was last heard, None when none has been."""
        return self._link.station_s

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors whose readability `service` wants."""
        return self._link.descriptors()

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Serve the link."""
        try:
            self._link.service(now_s, ready)
        except Exception as mistake:  # noqa: BLE001 - whatever it is, the rudder does not depend on it
            self._note(mistake, now_s)

    def publish(self, output: Output, now_s: float) -> None:
        """Give the link a tick's output."""
        try:
            self._link.publish(output, now_s)
        except Exception as mistake:  # noqa: BLE001
            self._note(mistake, now_s)

    def _note(self, mistake: Exception, now_s: float) -> None:
        if len(self._mistakes_s) == MOST and now_s - self._mistakes_s[0] < WITHIN_S:
            raise mistake
        self._mistakes_s.append(now_s)
        traceback.print_exception(mistake)
        self._tell(Event(Severity.CRITICAL, f"Link: {type(mistake).__name__} inside, she steers on"))
