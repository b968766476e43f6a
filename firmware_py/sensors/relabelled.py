"""A second compass: any compass driver, its samples and health marked as compass B's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from firmware_py.common.interfaces import Compass
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample


class RelabelledCompass:
    """An interfaces.Compass around another."""

    def __init__(self, compass: Compass) -> None:
        """Take the driver."""
        self._compass = compass

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._compass.fileno()

    def receive(self, now_s: float) -> None:
        """Read what has arrived."""
        self._compass.receive(now_s)

    def poll(self) -> Sequence[HeadingSample]:
        """The samples since the last poll, as of source 1."""
        return tuple(replace(sample, source=1) for sample in self._compass.poll())

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the device as compass B."""
        return replace(self._compass.health(now_s), role=DeviceRole.COMPASS_B)
