"""Opens the ports of the devices of a vehicle and creates their drivers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import msgspec

from firmware_py.common.driver import Driver
from firmware_py.common.interfaces import (
    ByteLine,
    Calibrator,
    Compass,
    Depth,
    Position,
    Power,
    Rudder,
    RudderAngle,
    Vessels,
    Wind,
)
from firmware_py.common.records import DeviceRole
from firmware_py.devices import (
    AIS,
    COMPASSES,
    DEPTHS,
    POSITIONS,
    POWERS,
    RUDDER_ANGLES,
    RUDDERS,
    SECTIONS,
    WINDS,
    calibrator_of,
)
from firmware_py.sensors.line_tee import LineTee
from firmware_py.sensors.second_sensor import SecondSensor
from firmware_py.system.network_line import NetworkLine, TcpLine, UdpLine
from firmware_py.system.port_users import find_port_users
from firmware_py.system.serial_port import PortError, SerialPort
from firmware_py.vehicle import PWM, DeviceEntry, Vehicle

if TYPE_CHECKING:
    from firmware_py.system.pwm_line import PwmLine

REOPEN_AFTER_S = 10.0  # after this time without received bytes, a port is reopened

Line: TypeAlias = "SerialPort | NetworkLine | PwmLine"


def _create_can_line(port: str) -> NetworkLine:
    from firmware_py.system.can_line import can_line  # noqa: PLC0415 - only for a boat with such a port

    return can_line(port)


# The prefixes in vehicle.NETWORK.
_NETWORK: Mapping[str, Callable[[str], NetworkLine]] = {"udp": UdpLine, "tcp": TcpLine, "can": _create_can_line}


class Devices(msgspec.Struct, frozen=True):
    """The drivers of a vehicle and their lines."""

    compass: Compass
    position: Position | None
    rudder: Rudder
    compass_b: Compass | None
    calibrator: Calibrator | None
    power: tuple[Power, ...]
    vessels: Vessels | None
    wind: Wind | None
    depth: Depth | None
    lines: tuple[Line, ...]
    rudder_angle: RudderAngle | None = None


def _ignore_text(_text: str) -> None:
    """Print nothing."""


def open_devices(vehicle: Vehicle, *, wait: bool, report: Callable[[str], None] = _ignore_text) -> Devices:
    """Open the ports and create the drivers.

    Raises PortError for a port that cannot be opened, unless `wait`: then `report` gets the reason, and the port is
    opened when it appears.
    """
    lines: list[Line] = []
    shared = _share_lines(vehicle, lines)
    compass = COMPASSES[vehicle.compass.driver].make(shared["compass"], vehicle.compass.options)
    rudder = RUDDERS[vehicle.rudder.driver].make(_add_line(vehicle.rudder, lines), vehicle.rudder.options)
    position, compass_b = None, None
    if (entry := vehicle.position) is not None:
        position = POSITIONS[entry.driver].make(shared["position"], entry.options)
    if (entry_b := vehicle.compass_b) is not None:
        driver = COMPASSES[entry_b.driver].make(shared["compass_b"], entry_b.options)
        compass_b = SecondSensor(driver, DeviceRole.COMPASS_B)
    power = _create_power_monitors(vehicle, shared, lines)
    vessels, wind, depth = None, None, None
    if (ais := vehicle.ais) is not None:
        vessels = AIS[ais.driver].make(shared["ais"], ais.options)
    if (wind_entry := vehicle.wind) is not None:
        wind = WINDS[wind_entry.driver].make(shared["wind"], wind_entry.options)
    if (depth_entry := vehicle.depth) is not None:
        depth = DEPTHS[depth_entry.driver].make(shared["depth"], depth_entry.options)
    rudder_angle = None
    if (sensor := vehicle.rudder_angle) is not None:
        rudder_angle = RUDDER_ANGLES[sensor.driver].make(shared["rudder_angle"], sensor.options)
    open_lines(lines, wait=wait, report=report)
    calibrator = calibrator_of(vehicle.compass.driver, compass)
    return Devices(
        compass, position, rudder, compass_b, calibrator, power, vessels, wind, depth, tuple(lines), rudder_angle
    )


def _share_lines(vehicle: Vehicle, lines: list[Line]) -> dict[str, ByteLine]:
    """Return the lines of the devices that may share a port, by name.

    Devices that share a port get views of one line, which must be read in this order. New lines are added to `lines`.
    """
    names = ("compass", "compass_b", "position", "power", "rudder_angle", "wind", "depth", "ais")
    entries = {name: getattr(vehicle, name) for name in names}
    users: dict[str, dict[str, DeviceEntry]] = {}
    for name, entry in entries.items():
        if entry is not None:
            users.setdefault(entry.port, {})[name] = entry
    line_views: dict[str, ByteLine] = {}
    for group in users.values():
        line = _add_line(next(iter(group.values())), lines)
        line_views.update(zip(group, share_line(line, len(group)), strict=True))
    return line_views


def share_line(line: ByteLine, count: int) -> list[ByteLine]:
    """Return `count` views of a line; each reads the bytes that the views before it have read."""
    if count == 1:
        return [line]
    tee = LineTee(line)
    return [tee.first_view, *share_line(tee.second_view, count - 1)]


def create_line(port: str, baud: int) -> Line:
    """Return the line of a port of the vehicle file: serial, UDP, TCP, CAN or a PWM output."""
    if port.startswith(PWM):
        from firmware_py.system.pwm_line import PwmLine  # noqa: PLC0415 - only for a servo without serial port

        return PwmLine(port, baud)
    kind = _NETWORK.get(port.partition(":")[0])
    return SerialPort(port, baud, silent_s=REOPEN_AFTER_S) if kind is None else kind(port)


def _add_line(entry: DeviceEntry, lines: list[Line]) -> Line:
    lines.append(create_line(entry.port, entry.baud))
    return lines[-1]


def _create_power_monitors(vehicle: Vehicle, shared: dict[str, ByteLine], lines: list[Line]) -> tuple[Power, ...]:
    """Create the drivers of power monitors; the line of the second one is added to `lines`."""
    monitors: list[Power] = []
    for entry, role in ((vehicle.power, DeviceRole.POWER), (vehicle.power_b, DeviceRole.POWER_B)):
        if entry is not None:
            line = shared["power"] if role is DeviceRole.POWER else _add_line(entry, lines)
            monitor = POWERS[entry.driver].make(line, entry.options)
            monitors.append(monitor if role is DeviceRole.POWER else SecondSensor(monitor, role))
    return tuple(monitors)


def open_lines(lines: Sequence[Line], *, wait: bool, report: Callable[[str], None] = _ignore_text) -> None:
    """Open all lines; on failure close them again and raise PortError, or report the failure if `wait`."""
    try:
        for line in lines:
            try:
                line.open()
            except PortError as error:
                if not wait:
                    raise
                report(f"waiting for {error}")
    except PortError:
        close_all(lines)
        raise


def shared_port_warnings(lines: Sequence[Line]) -> Sequence[str]:
    """Return a warning for each port that is also open in another program."""
    users = find_port_users(line.name for line in lines if isinstance(line, SerialPort) and line.connected)
    return [f"Port {path}: also open in {names}; end that program" for path, names in users.items()]


def package_drivers(vehicle: Vehicle) -> Mapping[str, Driver[Any]]:
    """Return the drivers of installed packages that the vehicle file names, by section."""
    entries = {section: getattr(vehicle, section) for section in SECTIONS}
    return {
        section: SECTIONS[section][entry.driver]
        for section, entry in entries.items()
        if entry is not None and entry.driver not in SECTIONS[section].own
    }


def driver_problems(vehicle: Vehicle) -> Sequence[str]:
    """Return a text for each driver of a package that cannot be used; the boat runs without its device."""
    drivers = package_drivers(vehicle)
    return [f"[{section}]: {driver.problem}" for section, driver in drivers.items() if driver.problem]


def close_all(lines: Sequence[Line]) -> None:
    """Close lines."""
    for line in lines:
        line.close()
