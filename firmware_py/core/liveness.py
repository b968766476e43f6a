"""Judges whether the autopilot still does its work: a watchdog is told only while nothing of it is stuck.

That a tick has been computed and the rudder commanded shows in that somebody asks here at the end of it. What a
restart cannot mend is no reason for one: a device that has never spoken, a disk that answers with errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from firmware_py.common.records import Progress

# All devices at once: one that is silent is a fault with a row of its own, all of them are rather a wedged bus or port.
SAMPLES, ACTUATION = "samples", "actuation"
DEVICES_S = 30.0


class StuckError(RuntimeError):
    """A part of the autopilot does nothing any more; the text names it. The process is to be started anew."""


class Liveness:
    """Remembers how much each part had done, and when that last changed."""

    def __init__(self) -> None:
        """Start with nothing seen."""
        self._seen: dict[str, tuple[int, float]] = {}  # by name: done, and since when it is owed

    def update(self, parts: Iterable[Progress], now_s: float) -> tuple[Progress, ...]:
        """Take what each part has done by now; return those that are stuck."""
        return tuple(part for part in parts if self._is_stuck(part, now_s))

    def _is_stuck(self, part: Progress, now_s: float) -> bool:
        if not part.alive:
            return True
        done, since_s = self._seen.get(part.name, (-1, now_s))
        if not part.has_work or part.done != done:
            self._seen[part.name] = part.done, now_s
            return False
        return now_s - since_s > part.patience_s


def devices_progress(
    taken: int, sent_bytes: int, connected: Sequence[bool], *, rudder_connected: bool
) -> list[Progress]:
    """Return what has come from all devices [samples] and what has gone out to the ports [bytes] since the start.

    Nothing is owed by devices that have never spoken, nor while no port is open: there a restart would change nothing.
    """
    return [
        Progress(SAMPLES, taken > 0 and any(connected), taken, DEVICES_S),
        Progress(ACTUATION, sent_bytes > 0 and rudder_connected, sent_bytes, DEVICES_S),
    ]
