"""Listens to the devices of a vehicle one by one, without the loop: for `listen` and `check`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from firmware_py.assemble import COMPASSES, POSITIONS, RUDDERS, make_driver
from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.interfaces import Compass, Position, Rudder
from firmware_py.common.records import DeviceHealth, HeadingSample, PositionSample, RudderCommand, RudderFeedback
from firmware_py.sensors.line_tee import LineTee
from firmware_py.system.clock import RealClock
from firmware_py.system.serial_port import PortError, SerialPort
from firmware_py.vehicle import Vehicle

POLL_INTERVAL_S = 0.1
# The servo is asked for its state and told to let go: listening moves nothing.
RELEASED = RudderCommand(0.0, torque_on=False)

Sample = HeadingSample | PositionSample | RudderFeedback


@dataclass(slots=True)
class Heard:
    """One device: its driver or why there is none, and what it has said so far."""

    role: str
    driver: str
    port: str
    device: Compass | Position | Rudder | None = None
    error: str = ""
    count: int = 0
    first_s: float | None = None
    last: Sample | None = None
    health: DeviceHealth | None = None
    line: SerialPort | None = field(default=None, repr=False)

    def rate_hz(self) -> float | None:
        """Samples a second since the first one; None before the second."""
        if self.last is None or self.first_s is None or self.count < 2 or self.last.t_s <= self.first_s:
            return None
        return (self.count - 1) / (self.last.t_s - self.first_s)

    def values(self) -> dict[str, Any]:
        """The latest sample in the units of the bench: degrees."""
        return {} if self.last is None else _VALUES[type(self.last)](self.last)


def _optional(convert: Callable[[float], float], value: float | None, digits: int) -> float | None:
    return None if value is None else round(convert(value), digits)


def _heading_values(sample: HeadingSample) -> dict[str, Any]:
    return {
        f"heading_{sample.reference.name.lower()}_deg": round(compass_degrees(sample.heading_rad), 2),
        "roll_deg": _optional(degrees, sample.roll_rad, 1),
        "pitch_deg": _optional(degrees, sample.pitch_rad, 1),
        "temperature_c": sample.temperature_c,
    }


def _position_values(sample: PositionSample) -> dict[str, Any]:
    return {
        "fix": sample.fix.name,
        "lat_deg": _optional(degrees, sample.latitude_rad, 7),
        "lon_deg": _optional(degrees, sample.longitude_rad, 7),
        "sog_m_s": _optional(float, sample.speed_over_ground_m_s, 2),
        "cog_deg": _optional(compass_degrees, sample.course_over_ground_rad, 1),
        "satellites": sample.satellites,
    }


def _rudder_values(sample: RudderFeedback) -> dict[str, Any]:
    return {
        "shaft_deg": _optional(degrees, sample.shaft_rad, 2),
        "temperature_c": sample.temperature_c,
        "voltage_v": _optional(float, sample.voltage_v, 2),
        "current_a": _optional(float, sample.current_a, 3),
        "hardware_error": sample.hardware_error,
    }


_VALUES: Mapping[type[Any], Callable[[Any], dict[str, Any]]] = {
    HeadingSample: _heading_values,
    PositionSample: _position_values,
    RudderFeedback: _rudder_values,
}


class BenchSession:
    """The devices of a vehicle, opened as far as they can be."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Open each port; a failure stands in that device's record."""
        self._clock = RealClock()
        entries: list[tuple[str, Any, Mapping[str, Any]]] = [
            ("compass", vehicle.compass, COMPASSES),
            ("rudder", vehicle.rudder, RUDDERS),
        ]
        if vehicle.compass_b is not None:
            entries.append(("compass_b", vehicle.compass_b, COMPASSES))
        shared = vehicle.position is not None and vehicle.position.port == vehicle.compass.port
        if vehicle.position is not None and not shared:
            entries.append(("position", vehicle.position, POSITIONS))
        self.heard = [self._open(*entry) for entry in entries]
        if shared:
            self._share(vehicle)

    def _open(self, role: str, entry: Any, drivers: Mapping[str, Any]) -> Heard:
        heard = Heard(role, entry.driver, entry.port)
        line = SerialPort(entry.port, entry.baud)
        try:
            line.open()
        except PortError as error:
            heard.error = str(error)
            return heard
        heard.line = line
        heard.device = make_driver(drivers, role, line, entry)
        return heard

    def _share(self, vehicle: Vehicle) -> None:
        """Give compass and position one view each of their common port."""
        compass, entry = self.heard[0], vehicle.position
        if entry is None:
            return
        position = Heard("position", entry.driver, entry.port, error=compass.error)
        if compass.line is not None:
            tee = LineTee(compass.line)
            compass.device = make_driver(COMPASSES, "compass", tee.first, vehicle.compass)
            position.device = make_driver(POSITIONS, "position", tee.second, entry)
        self.heard.append(position)

    def listen(self, seconds: float | None) -> Iterator[Sequence[Sample]]:
        """Yield what was heard, ten times a second, for so many seconds or without end."""
        clock = self._clock
        while seconds is None or clock.now_s() < seconds:
            end_s = clock.now_s() + POLL_INTERVAL_S
            for heard in self.heard:
                if heard.role == "rudder" and heard.device is not None:
                    heard.device.command(RELEASED, clock.now_s())  # type: ignore[union-attr]
            fresh: list[Sample] = []
            while True:
                now_s = clock.now_s()
                for heard in self.heard:
                    fresh += self._take(heard, now_s)
                if now_s >= end_s:
                    break
                fds = [heard.device.fileno() for heard in self.heard if heard.device is not None]
                clock.wait(end_s, [fd for fd in fds if fd >= 0])
            for heard in self.heard:
                if heard.line is not None:
                    heard.line.reopen(clock.now_s())
            yield fresh

    def _take(self, heard: Heard, now_s: float) -> Sequence[Sample]:
        if heard.device is None:
            return ()
        heard.device.receive(now_s)
        samples: Sequence[Sample] = heard.device.poll()
        heard.health = heard.device.health(now_s)
        if samples:
            heard.first_s = samples[0].t_s if heard.first_s is None else heard.first_s
            heard.count += len(samples)
            heard.last = samples[-1]
        return samples

    def close(self) -> None:
        """Close the ports."""
        for heard in self.heard:
            if heard.line is not None:
                heard.line.close()
