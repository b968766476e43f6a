"""Reads the devices of a vehicle without the control loop, for `listen` and `check`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from firmware_py.assemble.devices import Line, line_of, line_views_of, shared_port_warnings
from firmware_py.common.interfaces import Compass, Position, Power, Rudder, Vessels
from firmware_py.common.records import (
    DeviceHealth,
    HeadingSample,
    PositionSample,
    PowerSample,
    RudderCommand,
    RudderFeedback,
)
from firmware_py.common.vessels import VesselIdentity, VesselPosition
from firmware_py.devices import SECTIONS
from firmware_py.system.clock import RealClock
from firmware_py.system.readings import (
    device_values,
    heading_values,
    identity_values,
    position_values,
    power_values,
    rudder_values,
    vessel_values,
)
from firmware_py.system.serial_port import PortError
from firmware_py.vehicle import DeviceEntry, Vehicle

POLL_INTERVAL_S = 0.1
# The servo is polled with torque off, so that listening does not move it.
RELEASED = RudderCommand(0.0, torque_on=False)

Sample = HeadingSample | PositionSample | RudderFeedback | PowerSample | VesselPosition | VesselIdentity


@dataclass(slots=True)
class BenchDevice:
    """One device: its driver or the error, and the samples received."""

    role: str
    driver_name: str
    port: str
    driver: Compass | Position | Rudder | Power | Vessels | None = None
    error: str = ""
    count: int = 0
    first_s: float | None = None
    last: Sample | None = None
    health: DeviceHealth | None = None
    line: Line | None = field(default=None, repr=False)

    def rate_hz(self) -> float | None:
        """Return the samples per second since the first one; None before the second."""
        if self.last is None or self.first_s is None or self.count < 2 or self.last.t_s <= self.first_s:
            return None
        return (self.count - 1) / (self.last.t_s - self.first_s)

    def values(self) -> dict[str, Any]:
        """Return the latest sample in degrees."""
        return {} if self.last is None else _VALUES[type(self.last)](self.last)

    def record(self) -> dict[str, Any]:
        """Return the state of the device and its latest sample."""
        state = device_values(self.role, self.driver_name, self.port, self.health, self.rate_hz(), self.error)
        return state | self.values()


_VALUES: Mapping[type[Any], Callable[[Any], dict[str, Any]]] = {
    HeadingSample: heading_values,
    PositionSample: position_values,
    RudderFeedback: rudder_values,
    PowerSample: power_values,
    VesselPosition: vessel_values,
    VesselIdentity: identity_values,
}


def open_devices(group: Sequence[tuple[str, DeviceEntry]]) -> list[BenchDevice]:
    """Open the port that the devices share and give each a view of it; on failure set the error of all."""
    devices = [BenchDevice(section, entry.driver, entry.port) for section, entry in group]
    line = line_of(group[0][1].port, group[0][1].baud)
    try:
        line.open()
    except PortError as error:
        for device in devices:
            device.error = str(error)
        return devices
    devices[0].line = line
    for text in shared_port_warnings([line]):
        for device in devices:
            device.error = text
    for device, (section, entry), view in zip(devices, group, line_views_of(line, len(group)), strict=True):
        device.driver = SECTIONS[section][entry.driver].make(view, entry.options)
    return devices


class BenchSession:
    """The devices of a vehicle; those that cannot be opened carry the error."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Open each port; a failure is stored in the device."""
        self._clock = RealClock()
        groups: dict[str, list[tuple[str, DeviceEntry]]] = {}
        for section in ("compass", "rudder", "compass_b", "power", "power_b", "position", "ais"):
            if (entry := getattr(vehicle, section)) is not None:
                groups.setdefault(entry.port, []).append((section, entry))
        self.devices = [device for group in groups.values() for device in open_devices(group)]

    def listen(self, seconds: float | None) -> Iterator[Sequence[Sample]]:
        """Yield the new samples ten times a second, for the given seconds or without end."""
        clock = self._clock
        while seconds is None or clock.now_s() < seconds:
            end_s = clock.now_s() + POLL_INTERVAL_S
            for device in self.devices:
                if device.role == "rudder" and device.driver is not None:
                    device.driver.command(RELEASED, clock.now_s())  # type: ignore[union-attr]
            fresh: list[Sample] = []
            while True:
                now_s = clock.now_s()
                for device in self.devices:
                    fresh += self._collect(device, now_s)
                if now_s >= end_s:
                    break
                fds = [device.driver.fileno() for device in self.devices if device.driver is not None]
                clock.wait(end_s, [fd for fd in fds if fd >= 0])
            for device in self.devices:
                if device.line is not None:
                    device.line.reopen(clock.now_s())
            yield fresh

    def _collect(self, device: BenchDevice, now_s: float) -> Sequence[Sample]:
        if device.driver is None:
            return ()
        device.driver.receive(now_s)
        samples: Sequence[Sample] = device.driver.poll()
        device.health = device.driver.health(now_s)
        if samples:
            device.first_s = samples[0].t_s if device.first_s is None else device.first_s
            device.count += len(samples)
            device.last = samples[-1]
        return samples

    def close(self) -> None:
        """Close the ports."""
        for device in self.devices:
            if device.line is not None:
                device.line.close()
