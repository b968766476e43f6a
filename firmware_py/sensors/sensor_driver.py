"""Common part of the drivers of sensors: line, monitor, and the samples until the next poll."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceHealth, DeviceRole
from firmware_py.sensors.device_monitor import SILENT_AFTER_S, DeviceMonitor

SampleT = TypeVar("SampleT")

MAX_SAMPLES = 512  # between two polls; more than in one read of 4096 bytes


class SensorDriver(Generic[SampleT]):
    """A subclass reads `_line` in `receive`, reports to `_monitor`, and appends to `_samples`."""

    def __init__(self, line: ByteLine, role: DeviceRole, silent_after_s: float = SILENT_AFTER_S) -> None:
        """Store the line; `silent_after_s` is the minimum timeout of the monitor."""
        self._line = line
        self._monitor = DeviceMonitor(line, role, silent_after_s)
        self._samples: deque[SampleT] = deque(maxlen=MAX_SAMPLES)

    def fileno(self) -> int:
        """Return the descriptor of the line, or -1."""
        return self._line.fileno()

    def poll(self) -> Sequence[SampleT]:
        """Return the samples since the last poll, oldest first."""
        samples = tuple(self._samples)
        self._samples.clear()
        return samples

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the device."""
        return self._monitor.health(now_s)
