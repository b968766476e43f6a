"""Second compass or power monitor: marks the samples and health of a driver as those of the second device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

from msgspec.structs import replace

from firmware_py.common.interfaces import Device
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample, PowerSample

SampleT = TypeVar("SampleT", HeadingSample, PowerSample)
SampleT_co = TypeVar("SampleT_co", HeadingSample, PowerSample, covariant=True)


class Sensor(Device, Protocol[SampleT_co]):
    """A device whose samples have a source number."""

    def poll(self) -> Sequence[SampleT_co]:
        """Return the samples since the last poll, oldest first."""


class SecondSensor(Generic[SampleT]):
    """A driver of a second compass or power monitor."""

    def __init__(self, sensor: Sensor[SampleT], role: DeviceRole) -> None:
        """Store the driver; `role` is the role of its health records."""
        self._sensor: Sensor[SampleT] = sensor
        self._role = role

    def fileno(self) -> int:
        """Return the descriptor to wait for, or -1."""
        return self._sensor.fileno()

    def receive(self, now_s: float) -> None:
        """Read the received bytes."""
        self._sensor.receive(now_s)

    def poll(self) -> Sequence[SampleT]:
        """Return the samples since the last poll with source 1."""
        return tuple(replace(sample, source=1) for sample in self._sensor.poll())

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the device in its role."""
        return replace(self._sensor.health(now_s), role=self._role)
