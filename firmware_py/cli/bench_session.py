"""Read the devices of a vehicle without the control loop, for `listen` and `check`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from firmware_py.assemble.devices import Line, create_line, share_line, shared_port_warnings
from firmware_py.common.interfaces import Compass, Depth, Position, Power, Rudder, RudderAngle, Vessels, Wind
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    HeadingSample,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    WindSample,
)
from firmware_py.common.vessels import VesselIdentity, VesselPosition
from firmware_py.devices import SECTIONS
from firmware_py.system.clock import RealClock
from firmware_py.system.readings import (
    depth_values,
    device_values,
    heading_values,
    identity_values,
    position_values,
    power_values,
    rudder_angle_values,
    rudder_values,
    vessel_values,
    wind_values,
)
from firmware_py.system.serial_port import PortError
from firmware_py.vehicle import DeviceEntry, Vehicle

POLL_INTERVAL_S = 0.1
MIN_RATE_DURATION_S = 0.5  # covered by the samples of a rate; two messages in one read would give a high rate
# The servo is polled with torque off, so that listening does not move it.
RELEASE_COMMAND = RudderCommand(0.0, torque_on=False)
# Devices on one port are read in this order.
SECTION_ORDER = (
    "compass",
    "rudder",
    "compass_b",
    "power",
    "power_b",
    "position",
    "rudder_angle",
    "wind",
    "depth",
    "ais",
)

Sample = (
    HeadingSample
    | PositionSample
    | RudderFeedback
    | PowerSample
    | VesselPosition
    | VesselIdentity
    | WindSample
    | DepthSample
    | RudderAngleSample
)


@dataclass(slots=True)
class BenchDevice:
    """A device: its driver or the error, number of samples, time of the first one, and the last one.

    `role` is its section in the vehicle file.
    """

    role: str
    driver_name: str
    port: str
    driver: Compass | Position | Rudder | Power | Vessels | Wind | Depth | RudderAngle | None = None
    error: str = ""
    sample_count: int = 0
    first_sample_s: float = math.inf
    last_sample: Sample | None = None
    health: DeviceHealth | None = None
    line: Line | None = field(default=None, repr=False)

    def rate_hz(self) -> float | None:
        """Return the mean sample rate; None before the samples cover MIN_RATE_DURATION_S."""
        if self.last_sample is None:
            return None
        duration_s = self.last_sample.t_s - self.first_sample_s
        return (self.sample_count - 1) / duration_s if duration_s >= MIN_RATE_DURATION_S else None

    def values(self) -> dict[str, Any]:
        """Return the values of the last sample by name, angles in degrees."""
        return {} if self.last_sample is None else _FORMATTERS[type(self.last_sample)](self.last_sample)

    def record(self) -> dict[str, Any]:
        """Return the state of the device and the values of its last sample."""
        state = device_values(self.role, self.driver_name, self.port, self.health, self.rate_hz(), self.error)
        return state | self.values()


_FORMATTERS: Mapping[type[Any], Callable[[Any], dict[str, Any]]] = {
    HeadingSample: heading_values,
    PositionSample: position_values,
    RudderFeedback: rudder_values,
    PowerSample: power_values,
    VesselPosition: vessel_values,
    VesselIdentity: identity_values,
    WindSample: wind_values,
    DepthSample: depth_values,
    RudderAngleSample: rudder_angle_values,
}


def open_devices(group: Sequence[tuple[str, DeviceEntry]]) -> list[BenchDevice]:
    """Open the port that these devices share and create their drivers; on failure set the error of each device."""
    devices = [BenchDevice(section, entry.driver, entry.port) for section, entry in group]
    _, first_entry = group[0]
    line = create_line(first_entry.port, first_entry.baud)
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
    for device, (section, entry), view in zip(devices, group, share_line(line, len(group)), strict=True):
        device.driver = SECTIONS[section][entry.driver].make(view, entry.options)
    return devices


class BenchSession:
    """The devices of a vehicle; a device whose port cannot be opened has an error text."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Open each port; a failure sets the error of its devices."""
        self._clock = RealClock()
        groups: dict[str, list[tuple[str, DeviceEntry]]] = {}
        for section in SECTION_ORDER:
            if (entry := getattr(vehicle, section)) is not None:
                groups.setdefault(entry.port, []).append((section, entry))
        self.devices = [device for group in groups.values() for device in open_devices(group)]

    def listen(self, seconds: float | None) -> Iterator[Sequence[Sample]]:
        """Yield the new samples ten times a second, until `seconds` have passed; None: without end."""
        clock = self._clock
        while seconds is None or clock.now_s() < seconds:
            end_s = clock.now_s() + POLL_INTERVAL_S
            for device in self.devices:
                if device.role == "rudder" and device.driver is not None:
                    device.driver.command(RELEASE_COMMAND, clock.now_s())  # type: ignore[union-attr]
            samples: list[Sample] = []
            while True:
                now_s = clock.now_s()
                for device in self.devices:
                    samples += self._receive(device, now_s)
                if now_s >= end_s:
                    break
                fds = [device.driver.fileno() for device in self.devices if device.driver is not None]
                clock.wait(end_s, [fd for fd in fds if fd >= 0])
            for device in self.devices:
                if device.line is not None:
                    device.line.reopen(clock.now_s())
            yield samples

    def _receive(self, device: BenchDevice, now_s: float) -> Sequence[Sample]:
        """Return the new samples of a device and update its statistics."""
        if device.driver is None:
            return ()
        device.driver.receive(now_s)
        samples: Sequence[Sample] = device.driver.poll()
        device.health = device.driver.health(now_s)
        if samples:
            device.first_sample_s = min(device.first_sample_s, samples[0].t_s)
            device.sample_count += len(samples)
            device.last_sample = samples[-1]
        return samples

    def close(self) -> None:
        """Close the ports."""
        for device in self.devices:
            if device.line is not None:
                device.line.close()
