"""Detects parts of the autopilot that are stuck; the watchdogs are served only while no part is stuck.

It is called at the end of each tick. Problems that a restart cannot solve are ignored: a device that has never sent
anything, and a disk that reports errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from firmware_py.common.records import Progress

# Samples of all devices together: a single silent device is a fault, all of them are a blocked bus or port.
SAMPLES, ACTUATION = "samples", "actuation"
DEVICES_S = 30.0  # time without progress after which they are stuck


class StuckError(RuntimeError):
    """A part of the autopilot is stuck, and the process must restart; the text names the part."""


class Liveness:
    """Progress of each part, and the time of its last change."""

    def __init__(self) -> None:
        """Create the record without progress."""
        self._progress: dict[str, tuple[int, float]] = {}  # by name: work done, time of its last change

    def update(self, parts: Iterable[Progress], now_s: float) -> tuple[Progress, ...]:
        """Store the progress of the parts; return those that are stuck."""
        return tuple(part for part in parts if self._is_stuck(part, now_s))

    def _is_stuck(self, part: Progress, now_s: float) -> bool:
        if not part.alive:
            return True
        done, since_s = self._progress.get(part.name, (-1, now_s))
        if not part.has_work or part.done != done:
            self._progress[part.name] = part.done, now_s
            return False
        return now_s - since_s > part.patience_s


def devices_progress(
    sample_count: int, sent_bytes: int, connected: Sequence[bool], *, rudder_connected: bool
) -> list[Progress]:
    """Return the progress of the sensors (number of samples) and of the servo port (bytes sent) since the start.

    Devices that have never sent anything and closed ports have no work, because a restart would not help.
    """
    return [
        Progress(SAMPLES, sample_count > 0 and any(connected), sample_count, DEVICES_S),
        Progress(ACTUATION, sent_bytes > 0 and rudder_connected, sent_bytes, DEVICES_S),
    ]
