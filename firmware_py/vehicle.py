"""The vehicle file: which devices hang on which ports, the hull, parameters of this boat."""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

from firmware_py.common.parameters import TABLE, ParameterError, index_of, parse_file


class VehicleError(ValueError):
    """The vehicle file is wrong; the text names file, place and remedy."""


@dataclass(frozen=True, slots=True)
class CompassEntry:
    """[compass], and [compass_b] for a second one: driver nmea or pni_tcm."""

    driver: str
    port: str
    baud: int
    rate_hz: float = 10.0
    sentences: tuple[str, ...] = ()  # nmea: which sentences are the heading; empty = the driver's rule
    require_checksum: bool = True


@dataclass(frozen=True, slots=True)
class PositionEntry:
    """[position]: driver nmea or ubx; the port may be the compass's."""

    driver: str
    port: str
    baud: int
    require_checksum: bool = True


@dataclass(frozen=True, slots=True)
class RudderEntry:
    """[rudder]: driver dynamixel or volz."""

    driver: str
    port: str
    baud: int
    id: int = 1


@dataclass(frozen=True, slots=True)
class Hull:
    """[hull]: main particulars of the float, for the tools on the bench."""

    length_m: float | None = None
    beam_m: float | None = None
    draft_m: float | None = None
    block_coefficient: float | None = None
    mass_kg: float | None = None


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A vehicle file, checked."""

    name: str
    compass: CompassEntry
    rudder: RudderEntry
    position: PositionEntry | None
    hull: Hull
    link_urls: tuple[str, ...]
    parameters: Mapping[str, float]
    compass_b: CompassEntry | None = None


DRIVERS: Mapping[str, tuple[str, ...]] = {
    "compass": ("nmea", "pni_tcm"),
    "compass_b": ("nmea", "pni_tcm"),
    "position": ("nmea", "ubx"),
    "rudder": ("dynamixel", "volz"),
}
_SECTIONS = ("vehicle", "compass", "compass_b", "position", "rudder", "link", "hull", "parameters")
_RANGES: Mapping[str, tuple[float, float]] = {
    "baud": (300, 12_000_000),
    "rate_hz": (0.5, 100.0),
    "id": (0, 252),
    "length_m": (0.1, 1000.0),
    "beam_m": (0.01, 200.0),
    "draft_m": (0.01, 50.0),
    "block_coefficient": (0.05, 1.0),
    "mass_kg": (0.1, 1e9),
}


def load(path: Path) -> Vehicle:
    """Read and check a vehicle file, or raise VehicleError."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise VehicleError(f"{path}: no such vehicle file; params/ holds examples") from None
    except (OSError, UnicodeDecodeError) as error:
        raise VehicleError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise VehicleError(f"{path}: not valid TOML: {error}") from None
    return parse(data, path)


def parse(data: Mapping[str, Any], path: Path) -> Vehicle:
    """Check the content of a vehicle file read from path."""
    _only_known(data, _SECTIONS, f"{path}: section")
    vehicle = _section(data, "vehicle", path)
    _only_known(vehicle, ("name",), f"{path}: [vehicle]")
    name = vehicle.get("name", path.stem)
    if not isinstance(name, str) or not name or len(name) > 60:
        raise VehicleError(f"{path}: [vehicle] name: expected a text of 1 to 60 characters")
    link = _section(data, "link", path)
    _only_known(link, ("urls",), f"{path}: [link]")
    return Vehicle(
        name=name,
        compass=_entry(CompassEntry, data, "compass", path),
        rudder=_entry(RudderEntry, data, "rudder", path),
        position=_entry(PositionEntry, data, "position", path) if "position" in data else None,
        hull=_record(Hull, _section(data, "hull", path), f"{path}: [hull]"),
        link_urls=_texts(link.get("urls", []), f"{path}: [link] urls"),
        parameters=_parameters(_section(data, "parameters", path), path),
        compass_b=_entry(CompassEntry, data, "compass_b", path) if "compass_b" in data else None,
    )


def _section(data: Mapping[str, Any], name: str, path: Path) -> Mapping[str, Any]:
    section = data.get(name, {})
    if not isinstance(section, dict):
        raise VehicleError(f"{path}: [{name}] must be a section, not a value")
    return section


def _only_known(section: Mapping[str, Any], known: tuple[str, ...], place: str) -> None:
    for key in section:
        if key not in known:
            near = difflib.get_close_matches(key, known, 1)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise VehicleError(f"{place} {key!r} is not known; {hint}")


def _entry(kind: type[Any], data: Mapping[str, Any], name: str, path: Path) -> Any:
    if name not in data:
        raise VehicleError(f"{path}: section [{name}] is missing; it names driver, port and baud of the {name}")
    entry = _record(kind, _section(data, name, path), f"{path}: [{name}]")
    if entry.driver not in DRIVERS[name]:
        allowed = ", ".join(DRIVERS[name])
        raise VehicleError(f"{path}: [{name}] driver {entry.driver!r} is not known; there are {allowed}")
    return entry


def _record(kind: type[Any], section: Mapping[str, Any], place: str) -> Any:
    """Build a dataclass from a section, with every value's type and range checked."""
    known = {field.name: field for field in fields(kind)}
    _only_known(section, tuple(known), place)
    for name, field in known.items():
        if name not in section and field.default is MISSING:
            raise VehicleError(f"{place} {name} is missing")
    return kind(
        **{name: _CHECKS[str(known[name].type)](value, name, f"{place} {name}") for name, value in section.items()}
    )


def _text(value: Any, _name: str, place: str) -> str:
    if not isinstance(value, str) or not value:
        raise VehicleError(f"{place}: expected a text in quotes")
    return value


def _flag(value: Any, _name: str, place: str) -> bool:
    if not isinstance(value, bool):
        raise VehicleError(f"{place}: expected true or false")
    return value


def _number(value: Any, name: str, place: str) -> float:
    low, high = _RANGES[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise VehicleError(f"{place}: expected a number from {low:g} to {high:g}")
    if not low <= value <= high:
        raise VehicleError(f"{place}: {value:g} is out of range; allowed: {low:g} to {high:g}")
    return float(value)


def _whole(value: Any, name: str, place: str) -> int:
    number = _number(value, name, place)
    if number != int(number):
        raise VehicleError(f"{place}: {value} is not a whole number")
    return int(number)


def _texts(value: Any, place: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise VehicleError(f"{place}: expected a list of texts")
    return tuple(value)


_CHECKS: Mapping[str, Callable[[Any, str, str], Any]] = {
    "str": _text,
    "bool": _flag,
    "int": _whole,
    "float": _number,
    "float | None": _number,
    "tuple[str, ...]": lambda value, _name, place: _texts(value, place),
}


def _parameters(section: Mapping[str, Any], path: Path) -> dict[str, float]:
    values: dict[str, float] = {}
    if "file" in section:
        file = path.parent / _text(section["file"], "file", f"{path}: [parameters] file")
        try:
            values.update(parse_file(file.read_text(encoding="utf-8"), str(file)))
        except (OSError, UnicodeDecodeError) as error:
            raise VehicleError(f"{path}: [parameters] file {file} cannot be read: {error}") from None
        except ParameterError as error:
            raise VehicleError(str(error)) from None
    for name, value in section.items():
        if name == "file":
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise VehicleError(f"{path}: [parameters] {name}: expected a number")
        try:
            values[name] = TABLE[index_of(name)].checked(float(value))
        except ParameterError as error:
            raise VehicleError(f"{path}: [parameters] {error}") from None
    return values
