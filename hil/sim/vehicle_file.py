"""The vehicle of a run: read from a file or the standard boat, and written with the ports of the board."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from firmware_py import vehicle as vehicle_format
from firmware_py.common.angles import radians
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import index_of
from firmware_py.devices import SECTIONS
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from firmware_py.vehicle import DeviceEntry, Hull, Vehicle, VehicleError
from hil.devices.emulator import EmulatedDevice
from hil.errors import UsageError
from hil.sim.device_factory import (
    AIS_BAUD,
    COMPASSES,
    INSTRUMENTS,
    POSITION,
    POWER_BAUD,
    POWER_DRIVER,
    SERVOS,
    find_device,
    instrument_entry,
    shared_sections,
)
from hil.sim.world import Mounting

Section = dict[str, Any]

LINK_BAUD = 57600
_NO_PORT, _NO_PWM_PORT = "set by the board", "pwm:/set/by/the/board/0"


def standard_vehicle() -> Vehicle:
    """Return the default boat: an NMEA compass, a Dynamixel servo, and default parameters."""
    return Vehicle(
        name="Ocean Rambler in the box",
        compass=_entry("compass", COMPASSES["nmea"]),
        rudder=_entry("rudder", SERVOS["dynamixel"]),
        position=None,
        hull=Hull(),
        link_urls=(),
        parameters={},
    )


def load(path: Path) -> Vehicle:
    """Read a vehicle file; raise UsageError if it is invalid."""
    try:
        return vehicle_format.load(path)
    except VehicleError as error:
        raise UsageError("\n".join(f"vehicle file {line}" for line in str(error).splitlines())) from None


def with_devices(vehicle: Vehicle, compass: str | None, servo: str | None) -> Vehicle:
    """Replace compass or servo, by the names of COMPASSES and SERVOS; None keeps the present one.

    A gyroscope without north becomes the second compass, beside the present one.
    """
    if compass is not None:
        device, drivers = find_device(COMPASSES, compass), SECTIONS["compass"]
        if device.driver in drivers and not drivers[device.driver].has_north:
            vehicle = replace(vehicle, compass_b=_entry("compass_b", device))
        elif vehicle.compass.driver != device.driver:
            vehicle = replace(vehicle, compass=_entry("compass", device))
    if servo is not None and vehicle.rudder.driver != (device := find_device(SERVOS, servo)).driver:
        vehicle = replace(vehicle, rudder=_entry("rudder", device))
    return vehicle


def _entry(section: str, device: EmulatedDevice) -> DeviceEntry:
    port = _NO_PWM_PORT if device.driver == "pwm" else _NO_PORT
    values = {"driver": device.driver, "port": port, "baud": device.baud}
    try:
        return vehicle_format.read_device(section, values, f"[{section}]")
    except VehicleError as error:
        raise UsageError(f"emulator of driver {device.driver}: {error}") from None


def model_of(vehicle: Vehicle) -> KtModel:
    """Return the ship model of the MDL_ parameters; the tank model provides missing ones."""
    parameter, base = vehicle.parameters.get, OCEAN_RAMBLER
    return KtModel(
        parameter("MDL_K", base.turning_ability_1_s),
        parameter("MDL_T_S", base.turning_lag_s),
        parameter("MDL_ALPHA_S2", base.norrbin_s2),
        0.0,
        parameter("MDL_SPEED", base.speed_m_s),
    )


def mounting_of(vehicle: Vehicle) -> Mounting:
    """Return the mounting of compass and servo that the corrections in the file compensate."""
    parameter = vehicle.parameters.get
    return Mounting(
        radians(parameter("RUD_CENTRE_DEG", 0.0)),
        bool(parameter("RUD_REVERSE", 0.0)),
        radians(parameter("CMP_OFFSET_DEG", 0.0)),
    )


def file_text(vehicle: Vehicle, ports: Mapping[str, str], settings: Mapping[str, float]) -> str:
    """Return the vehicle file with the ports of the board, and `settings` as parameters.

    Without a link port the links are those of the vehicle.
    """
    sections: dict[str, Section] = {
        "vehicle": {"name": vehicle.name},
        "compass": _device_section(vehicle.compass, ports["compass"]),
        **(
            {"compass_b": _device_section(vehicle.compass_b, ports["compass_b"])}
            if vehicle.compass_b is not None and "compass_b" in ports
            else {}
        ),
        **_sensor_sections(vehicle, ports),
        "rudder": _device_section(vehicle.rudder, ports["rudder"]),
        **{
            name: {"driver": POWER_DRIVER, "port": ports[name], "baud": POWER_BAUD}
            for name in ("power", "power_b")
            if name in ports
        },
        **(
            {"rudder_angle": _device_section(vehicle.rudder_angle, ports["rudder_angle"])}
            if vehicle.rudder_angle is not None and "rudder_angle" in ports
            else {}
        ),
        **({"ais": _emulated_section("ais", vehicle.ais, "nmea", ports["ais"], AIS_BAUD)} if "ais" in ports else {}),
        **{
            name: _device_section(instrument_entry(vehicle, name), ports[name]) for name in INSTRUMENTS if name in ports
        },
        "link": {"urls": [f"serial:{ports['link']}:{LINK_BAUD}"] if "link" in ports else list(vehicle.link_urls)},
        "hull": {name: value for name, value in asdict(vehicle.hull).items() if value is not None},
        "parameters": {**vehicle.parameters, **settings},
    }
    return "\n".join(_section_text(name, section) for name, section in sections.items() if section)


def _sensor_sections(vehicle: Vehicle, ports: Mapping[str, str]) -> dict[str, Section]:
    """Return the sections of the receiver and of what the compass serves on its port."""
    compass = vehicle.compass
    rows = dict.fromkeys(shared_sections(vehicle), (compass.driver, ports["compass"], compass.baud))
    if "position" in ports:
        rows["position"] = (POSITION.driver, ports["position"], POSITION.baud)
    return {name: _emulated_section(name, getattr(vehicle, name), *row) for name, row in rows.items()}


def _emulated_section(section: str, vehicle_entry: DeviceEntry | None, driver: str, port: str, baud: int) -> Section:
    """Return the section of an emulated device, with the options of the vehicle's device if its driver is the same."""
    values = {"driver": driver, "port": _NO_PORT, "baud": baud}
    entry = vehicle_format.read_device(section, values, f"[{section}]")
    if vehicle_entry is not None and vehicle_entry.driver == driver:
        entry = replace(entry, options=vehicle_entry.options)
    return _device_section(entry, port)


def _device_section(entry: DeviceEntry, port: str) -> Section:
    """Return the section of a device, with the options that differ from the defaults of the driver."""
    options = {row.name: getattr(entry.options, row.name) for row in fields(entry.options)}
    defaults = {row.name: row.default for row in fields(entry.options)}
    changed = {name: value for name, value in options.items() if value != defaults[name]}
    return {"driver": entry.driver, "port": port, "baud": entry.baud, **changed}


def parse_settings(pairs: Sequence[str]) -> dict[str, float]:
    """Parse NAME=VALUE pairs and check them against the parameter table; raise UsageError for an invalid one."""
    settings: dict[str, float] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        try:
            value = float(text) if equals else math.nan
        except ValueError:
            raise UsageError(f"--set {pair[:60]}: {text[:30]!r} is not a number; write NAME=VALUE") from None
        if not equals:
            raise UsageError(f"--set {pair[:60]}: write NAME=VALUE, as in CTL_K1=30")
        try:
            settings[name] = TABLE[index_of(name)].check(value)
        except ParameterError as error:
            raise UsageError(f"--set {error}") from None
    return settings


def _section_text(name: str, section: Section) -> str:
    lines = [f"[{name}]"]
    # JSON strings, numbers, booleans and lists of strings are valid TOML.
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False, default=str)}" for key, value in section.items()]
    return "\n".join(lines) + "\n"
