"""The vehicle file of a run: a given one, or the standard boat, with the ports of the board in it."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from firmware_py.common.angles import radians
from firmware_py.common.parameters import TABLE, ParameterError, index_of, parse_file
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.errors import UsageError
from hil.sim.world import Mounting

Section = dict[str, Any]

COMPASS_DRIVERS: Mapping[str, Section] = {
    "nmea": {"driver": "nmea", "baud": 38400},
    "pni": {"driver": "pni_tcm", "baud": 38400},
}
SERVO_DRIVERS: Mapping[str, Section] = {
    "dynamixel": {"driver": "dynamixel", "baud": 57600, "id": 1},
    "volz": {"driver": "volz", "baud": 115200, "id": 1},
}
POSITION_DRIVER: Section = {"driver": "nmea", "baud": 9600}
LINK_BAUD = 57600


@dataclass(slots=True)
class VehicleFile:
    """The sections of a vehicle file; `parameters` are checked and those of its parameter file included."""

    name: str = "Ocean Rambler in the box"
    compass: Section = field(default_factory=lambda: dict(COMPASS_DRIVERS["nmea"]))
    rudder: Section = field(default_factory=lambda: dict(SERVO_DRIVERS["dynamixel"]))
    hull: Section = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)

    def choose(self, compass: str | None, servo: str | None) -> None:
        """Fit another compass or servo; None keeps the present one."""
        if compass is not None and self.compass["driver"] != COMPASS_DRIVERS[compass]["driver"]:
            self.compass = dict(COMPASS_DRIVERS[compass])
        if servo is not None and self.rudder["driver"] != SERVO_DRIVERS[servo]["driver"]:
            self.rudder = dict(SERVO_DRIVERS[servo])

    def model(self) -> KtModel:
        """The ship that the file describes: its MDL_ parameters over the tank's numbers."""
        get, base = self.parameters.get, OCEAN_RAMBLER
        return KtModel(
            get("MDL_K", base.turning_ability_1_s),
            get("MDL_T_S", base.turning_lag_s),
            get("MDL_ALPHA_S2", base.norrbin_s2),
            0.0,
            get("MDL_SPEED", base.speed_m_s),
        )

    def mounting(self) -> Mounting:
        """How compass and servo sit, as the file's corrections say."""
        get = self.parameters.get
        return Mounting(
            radians(get("RUD_CENTRE_DEG", 0.0)), bool(get("RUD_REVERSE", 0.0)), radians(get("CMP_OFFSET_DEG", 0.0))
        )

    def declination_deg(self) -> float:
        """The declination that the file's boat steers with, taken for the place's."""
        return self.parameters.get("CMP_DECL_DEG", 0.0)

    def text(self, ports: Mapping[str, str], settings: Mapping[str, float]) -> str:
        """Write the file for the ports compass, position, rudder and link, with settings over its parameters."""
        sections: dict[str, Section] = {
            "vehicle": {"name": self.name},
            "compass": {**self.compass, "port": ports["compass"]},
            "position": {**POSITION_DRIVER, "port": ports["position"]},
            "rudder": {**self.rudder, "port": ports["rudder"]},
            "link": {"urls": [f"serial:{ports['link']}:{LINK_BAUD}"]},
            "hull": self.hull,
            "parameters": {**self.parameters, **settings},
        }
        return "\n".join(_section_text(name, section) for name, section in sections.items() if section)


def load(path: Path) -> VehicleFile:
    """Read a vehicle file for its devices, hull and parameters, or raise UsageError.

    What is checked here is what the bench needs; the autopilot checks the rest itself.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UsageError(f"vehicle file {path} cannot be read: {reason}") from None
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"vehicle file {path} is not valid TOML: {error}") from None
    sections = {name: data.get(name, {}) for name in ("vehicle", "compass", "rudder", "hull", "parameters")}
    for name, section in sections.items():
        if not isinstance(section, dict):
            raise UsageError(f"vehicle file {path}: [{name}] must be a section, not a value")
    for name, drivers in (("compass", COMPASS_DRIVERS), ("rudder", SERVO_DRIVERS)):
        known = [str(row["driver"]) for row in drivers.values()]
        if sections[name].get("driver") not in known:
            raise UsageError(f"vehicle file {path}: [{name}] driver must be one of {', '.join(known)}")
    return VehicleFile(
        name=str(sections["vehicle"].get("name", path.stem)),
        compass=sections["compass"],
        rudder=sections["rudder"],
        hull=sections["hull"],
        parameters=_parameters(sections["parameters"], path),
    )


def parse_settings(pairs: Sequence[str]) -> dict[str, float]:
    """Read NAME=VALUE pairs and check them against the parameter table, or raise UsageError."""
    settings: dict[str, float] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        try:
            value = float(text) if equals else math.nan
        except ValueError:
            raise UsageError(f"--set {pair[:60]}: {text[:30]!r} is not a number; write NAME=VALUE") from None
        if not equals:
            raise UsageError(f"--set {pair[:60]}: write NAME=VALUE, as in CTL_K1=30")
        settings[name] = _checked(name, value, "--set")
    return settings


def _checked(name: str, value: float, place: str) -> float:
    try:
        return TABLE[index_of(name)].checked(value)
    except ParameterError as error:
        raise UsageError(f"{place} {error}") from None


def _parameters(section: Section, path: Path) -> dict[str, float]:
    values: dict[str, float] = {}
    place = f"vehicle file {path}: [parameters]"
    if "file" in section:
        file = path.parent / str(section["file"])
        try:
            values.update(parse_file(file.read_text(encoding="utf-8"), str(file)))
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{place} file {file} cannot be read: {error}") from None
        except ParameterError as error:
            raise UsageError(str(error)) from None
    for name, value in section.items():
        if name == "file":
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise UsageError(f"{place} {name}: expected a number")
        values[name] = _checked(name, float(value), place)
    return values


def _section_text(name: str, section: Section) -> str:
    lines = [f"[{name}]"]
    # A JSON text, number, flag or list of texts is also the TOML one.
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False, default=str)}" for key, value in section.items()]
    return "\n".join(lines) + "\n"
