"""A second device of a sort: any driver, its samples and health marked as those of the second."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from msgspec.structs import replace

from firmware_py.common.interfaces import Device
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample, PowerSample

SampleT = TypeVar("SampleT", HeadingSample, PowerSample)
SampleT_co = TypeVar("SampleT_co", HeadingSample, PowerSample, covariant=True)


class Sensor(Device, Protocol[SampleT_co]):
    """What gives samples that say of which device they are."""

    def poll(self) -> Sequence[SampleT_co]:
        """The samples since the last poll, oldest first."""


class Relabelled(Generic[SampleT]):
    """A compass or power monitor around another."""

    def __init__(self, sensor: Sensor[SampleT], role: DeviceRole) -> None:
        """Take the driver, and the role of the second."""
        self._sensor: Sensor[SampleT] = sensor
        self._role = role

    def fileno(self) -> int:
        """The descriptor whose bytes `receive` wants, or -1."""
        return self._sensor.fileno()

    def receive(self, now_s: float) -> None:
        """Read what has arrived."""
        self._sensor.receive(now_s)

    def poll(self) -> Sequence[SampleT]:
        """The samples since the last poll, as of source 1."""
        return tuple(replace(sample, source=1) for sample in self._sensor.poll())

    def health(self, now_s: float) -> DeviceHealth:
        """The state of the device, in its role."""
        return replace(self._sensor.health(now_s), role=self._role)
