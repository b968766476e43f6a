"""Detects parts of the autopilot that are stuck; the watchdogs are served only while there are none.

It is called at the end of each tick. Problems that a restart cannot solve do not count: a device that has never sent
anything, or a disk that reports errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from firmware_py.common.records import Progress

# All devices together: one silent device is a fault of its own, all of them suggest a blocked bus or port.
SAMPLES, ACTUATION = "samples", "actuation"
DEVICES_S = 30.0


class StuckError(RuntimeError):
    """A part of the autopilot is stuck (named in the text); the process must be restarted."""


class Liveness:
    """Progress of each part, and the time of its last change."""

    def __init__(self) -> None:
        """Start without progress."""
        self._seen: dict[str, tuple[int, float]] = {}  # by name: work done, time of the last change

    def update(self, parts: Iterable[Progress], now_s: float) -> tuple[Progress, ...]:
        """Update with the progress of the parts; return the parts that are stuck."""
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
    """Return the progress of the sensors [samples] and of the ports [bytes sent] since the start.

    Devices that have never sent anything and closed ports have no work: a restart would not help.
    """
    return [
        Progress(SAMPLES, taken > 0 and any(connected), taken, DEVICES_S),
        Progress(ACTUATION, sent_bytes > 0 and rudder_connected, sent_bytes, DEVICES_S),
    ]
