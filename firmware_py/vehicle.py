"""The vehicle file: devices with their ports, hull, and parameters of a boat."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from firmware_py.common.options import MISSING_TEXT, check, option, record_from
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import MAX_PROBLEMS, index_of, parse_file
from firmware_py.devices import SECTIONS
from firmware_py.files.reading import read_text

RecordT = TypeVar("RecordT")


class VehicleError(ValueError):
    """The vehicle file is invalid; the text has a line with file, location and remedy for each problem."""


@dataclass(frozen=True, slots=True)
class _Connection:
    """Keys of every device section."""

    driver: str = option("protocol of the device")
    port: str = option("serial port of the device")
    baud: int = option("bits per second", minimum=300, maximum=12_000_000)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class DeviceEntry(msgspec.Struct, frozen=True):
    """Section of a device; `options` is the option record of its driver (devices.Driver)."""

    driver: str
    port: str
    baud: int
    options: Any


@dataclass(frozen=True, slots=True)
class Hull:
    """Section [hull]: main particulars of the float, for the bench tools."""

    length_m: float | None = option("length", default=None, minimum=0.1, maximum=1000.0)
    beam_m: float | None = option("beam", default=None, minimum=0.01, maximum=200.0)
    draft_m: float | None = option("draft", default=None, minimum=0.01, maximum=50.0)
    block_coefficient: float | None = option("block coefficient", default=None, minimum=0.05, maximum=1.0)
    mass_kg: float | None = option("mass", default=None, minimum=0.1, maximum=1e9)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Vehicle(msgspec.Struct, frozen=True):
    """A checked vehicle file; all devices but the rudder and the second power monitor may share a port."""

    name: str
    compass: DeviceEntry
    rudder: DeviceEntry
    position: DeviceEntry | None
    hull: Hull
    link_urls: tuple[str, ...]
    parameters: Mapping[str, float]
    compass_b: DeviceEntry | None = None
    power: DeviceEntry | None = None
    power_b: DeviceEntry | None = None
    ais: DeviceEntry | None = None
    wind: DeviceEntry | None = None
    depth: DeviceEntry | None = None
    rudder_angle: DeviceEntry | None = None


MAX_BYTES = 1 << 20  # of a vehicle or parameter file
NETWORK, _NO_BAUD = ("udp:", "tcp:", "can:"), 38400  # prefixes of network ports; placeholder for their rate
PWM, PWM_EXAMPLE = "pwm:", "a PWM output, as pwm:/sys/class/pwm/pwmchip0/0"
_MAX_CHARACTERS = 60  # of a name in a message
_MAX_BITS = 4096  # of an integer, because Python limits the conversion of integers to text
_OPTIONAL = ("position", "compass_b", "power", "power_b", "ais", "wind", "depth", "rudder_angle")  # devices
_SECTIONS = ("vehicle", "compass", "rudder", *_OPTIONAL, "link", "hull", "parameters")
_CONNECTION = tuple(row.name for row in fields(_Connection))


def load(path: Path) -> Vehicle:
    """Read and check a vehicle file, or raise VehicleError."""
    try:
        data = tomllib.loads(read_text(path, MAX_BYTES))
    except FileNotFoundError:
        raise VehicleError(f"{path}: no such vehicle file; create one with rambler example FILE") from None
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read: {error.strerror}; name a vehicle file") from None
    except tomllib.TOMLDecodeError as error:
        raise VehicleError(f"{path}: not valid TOML: {error}") from None
    except ValueError:  # Python's limit of digits
        raise VehicleError(f"{path}: not valid TOML: a number has too many digits") from None
    except RecursionError:
        raise VehicleError(f"{path}: nested too deeply; write sections of names and values") from None
    _check_values(data, path)
    return parse(data, path)


def _check_values(data: Mapping[str, Any], path: Path) -> None:
    """Raise VehicleError for values that no section accepts and no message can contain."""
    pending: list[tuple[str, Any]] = list(data.items())
    while pending:
        name, value = pending.pop()
        if isinstance(value, dict):
            pending += value.items()
        elif isinstance(value, list):
            pending += ((name, item) for item in value)
        elif isinstance(value, int) and value.bit_length() > _MAX_BITS:
            raise VehicleError(f"{path}: {name[:_MAX_CHARACTERS]!r} has too many digits")
        elif isinstance(value, str) and not value.isprintable():
            raise VehicleError(
                f"{path}: {name[:_MAX_CHARACTERS]!r} contains characters that cannot be printed: {value[:30]!r}"
            )


def parse(data: Mapping[str, Any], path: Path) -> Vehicle:
    """Check the content of a vehicle file; raise VehicleError with all problems."""
    optional = [name for name in _OPTIONAL if name in data]
    _, values = _read_all(
        {
            "sections": lambda: _check_names(data, _SECTIONS, f"{path}: section"),
            "name": lambda: _read_name(_find_section(data, "vehicle", path), path),
            **{name: partial(_read_entry, data, name, path) for name in ("compass", "rudder", *optional)},
            "hull": lambda: _read_hull(data, path),
            "link_urls": lambda: _read_link_urls(_find_section(data, "link", path), path),
            "parameters": lambda: _read_parameters(_find_section(data, "parameters", path), path),
        },
        missing=f"]{MISSING_TEXT}",
    )
    vehicle = Vehicle(**{"position": None} | values)
    _check_north(vehicle.compass, path)
    _check_ports(vehicle, path)
    return vehicle


def _check_north(compass: DeviceEntry, path: Path) -> None:
    """Raise VehicleError for a gyroscope without north as the compass: its heading drifts."""
    if not SECTIONS["compass"][compass.driver].has_north:
        raise VehicleError(
            f"{path}: [compass] driver {compass.driver} knows no north, and its heading drifts; put it into"
            " [compass_b], where its yaw rate is used, and a compass with north into [compass]"
        )


def _check_ports(vehicle: Vehicle, path: Path) -> None:
    """Raise VehicleError for sections that name the same port but cannot share it.

    Placeholders without a slash or colon, which the simulator replaces, are no ports.
    """
    problems: list[str] = []
    users: dict[str, str] = {}  # first section of each port
    for name in SECTIONS:
        entry: DeviceEntry | None = getattr(vehicle, name)
        if entry is None or not {"/", ":"} & set(entry.port):
            continue
        first = users.setdefault(entry.port, name)
        if first != name and (problem := _sharing_problem(first, getattr(vehicle, first), name, entry)):
            problems.append(f"{path}: [{name}] {problem}")
    for url in vehicle.link_urls:
        parts = url.split("?")[0].removeprefix("nmea:").split(":")
        if parts[0] in ("serial", "sbd") and parts[1:] and (user := users.get(parts[1])):
            problems.append(f"{path}: [link] {url}: {parts[1]} is the port of [{user}]; name another port")
    _raise_problems(problems)


def _sharing_problem(first: str, one: DeviceEntry, name: str, other: DeviceEntry) -> str:
    """Return why section `name` cannot share the port of section `first`, empty if it can."""
    if alone := next((section for section in (first, name) if section in ("rudder", "power_b")), ""):
        return f"port: {other.port} is the port of [{first}]; [{alone}] needs a port of its own"
    if one.baud != other.baud and not other.port.startswith(NETWORK):
        return f"baud: {other.baud} is not the {one.baud} of [{first}] on the same port; correct one of them"
    if one.driver != other.driver:
        kinds = (SECTIONS[first], one.driver), (SECTIONS[name], other.driver)
        if all(driver in drivers.own for drivers, driver in kinds) and any(drivers[d].writes for drivers, d in kinds):
            return (
                f"driver: {other.driver} cannot share {other.port} with driver {one.driver} of [{first}];"
                " name another port"
            )
    elif (first, name) == ("compass", "compass_b") and one.options == other.options:
        return "reads the same device as [compass]; name another port, or options that select another device"
    return ""


def _read_all(reads: Mapping[str, Callable[[], Any]], missing: str = MISSING_TEXT) -> tuple[Any, dict[str, Any]]:
    """Call all functions; return the result of the first, which checks names, and those of the others by name.

    Raises VehicleError with all problems. If the check of names fails, problems that contain the text `missing` are not
    reported, because a name may be misspelled.
    """
    values: dict[str, Any] = {}
    problems: dict[str, list[str]] = {}
    for name, read in reads.items():
        try:
            values[name] = read()
        except VehicleError as error:
            problems[name] = str(error).splitlines()
    first = next(iter(reads))
    lines = [line for texts in problems.values() for line in texts if first not in problems or missing not in line]
    _raise_problems(lines)
    return values.pop(first), values


def _read_name(section: Mapping[str, Any], path: Path) -> str:
    _check_names(section, ("name",), f"{path}: [vehicle]")
    name = section.get("name", path.stem)
    if not isinstance(name, str) or not name or len(name) > 60:
        raise VehicleError(f"{path}: [vehicle] name: expected a text of 1 to 60 characters")
    return name


def _read_link_urls(section: Mapping[str, Any], path: Path) -> tuple[str, ...]:
    reads = {
        "names": lambda: _check_names(section, ("urls",), f"{path}: [link]"),
        "urls": lambda: _read_texts(section.get("urls", []), f"{path}: [link] urls"),
    }
    _, values = _read_all(reads)
    urls: tuple[str, ...] = values["urls"]
    return urls


def _find_section(data: Mapping[str, Any], name: str, path: Path) -> Mapping[str, Any]:
    section = data.get(name, {})
    if not isinstance(section, dict):
        raise VehicleError(f"{path}: [{name}] must be a section, not a value")
    return section


def _raise_problems(problems: Iterable[str]) -> None:
    """Raise VehicleError with the problems, at most MAX_PROBLEMS; do nothing if there are none."""
    if lines := list(islice(problems, MAX_PROBLEMS)):
        raise VehicleError("\n".join(lines))


def _check_names(section: Mapping[str, Any], known_names: tuple[str, ...], location: str) -> None:
    hint = f"; known: {', '.join(known_names)}"
    unknown = [key[:_MAX_CHARACTERS] for key in section if key not in known_names]
    _raise_problems(f"{location} {key!r} is not known{_suggestion(key, known_names) or hint}" for key in unknown)


def _suggestion(key: str, known_names: tuple[str, ...]) -> str:
    import difflib  # noqa: PLC0415 - only for an unknown word

    return "".join(f"; did you mean {near!r}?" for near in difflib.get_close_matches(key, known_names, 1))


def _read_entry(data: Mapping[str, Any], name: str, path: Path) -> DeviceEntry:
    if name not in data:
        raise VehicleError(f"{path}: section [{name}] is missing; it needs driver, port and baud of the {name}")
    return read_device(name, _find_section(data, name, path), f"{path}: [{name}]")


def read_device(name: str, section: Mapping[str, Any], location: str) -> DeviceEntry:
    """Check the device section with this name: the common keys, and those of its driver.

    Raises VehicleError with a text that begins with `location`.
    """
    drivers, driver = SECTIONS[name], section.get("driver")
    if driver is None:
        raise VehicleError(f"{location} driver is missing; use one of {', '.join(drivers)}")
    if not isinstance(driver, str) or driver not in drivers:
        known = ", ".join(drivers)
        raise VehicleError(
            f"{location} driver {str(driver)[:60]!r} is not known; use one of {known}, or install its package"
        )
    spec = drivers[driver]
    options_type = spec.options
    # The options of an unusable driver cannot be checked; the boat starts without this device.
    own = {key: value for key, value in section.items() if key not in _CONNECTION and not spec.problem}
    names = tuple(field.name for field in fields(options_type))
    connection_values = {key: section[key] for key in _CONNECTION if key in section}
    port = str(section.get("port"))
    by_network = port.startswith(NETWORK)
    if not port.startswith(spec.port) or (port.startswith(PWM) and not spec.port and not spec.problem):
        example = PWM_EXAMPLE if spec.port == PWM else "a serial port"
        raise VehicleError(f"{location} port: driver {driver} needs {example}")
    if port.startswith("can:") and not (spec.writes or spec.reads_can or spec.problem):
        drivers_of_can = ", ".join(row for row in drivers.own if drivers[row].reads_can)
        remedy = f"use driver {drivers_of_can}" if drivers_of_can else "it needs a serial port"
        raise VehicleError(f"{location} port: driver {driver} reads no CAN bus; {remedy}")
    if by_network and spec.writes:
        raise VehicleError(f"{location} port: driver {driver} writes to its device and needs a serial port")
    if section.get("port") and "baud" not in section and not port.startswith(("/", PWM, *NETWORK)):
        raise VehicleError(
            f"{location} port: {port[:_MAX_CHARACTERS]!r} is neither the path of a serial port nor one of udp:PORT,"
            " tcp:ADDRESS:PORT, can:INTERFACE"
        )
    _, values = _read_all(
        {
            "names": lambda: _check_options(own, driver, names, location),
            "connection": lambda: _read_record(
                _Connection, ({"baud": _NO_BAUD} if by_network or spec.port else {}) | connection_values, location
            ),
            "options": lambda: _read_record(
                options_type, {key: value for key, value in own.items() if key in names}, location
            ),
        }
    )
    connection: _Connection = values["connection"]
    return DeviceEntry(driver, connection.port, connection.baud, values["options"])


def _check_options(values: Mapping[str, Any], driver: str, options: tuple[str, ...], location: str) -> None:
    """Raise VehicleError for options that the driver does not read."""
    own = ", ".join(options) or "no option of its own"
    reason, known_names = f"is not read by driver {driver}, which has {own}", (*_CONNECTION, *options)
    unknown = [key[:_MAX_CHARACTERS] for key in values if key not in options]
    _raise_problems(f"{location} {key!r} {reason}{_suggestion(key, known_names)}" for key in unknown)


def _read_hull(data: Mapping[str, Any], path: Path) -> Hull:
    section, location = _find_section(data, "hull", path), f"{path}: [hull]"
    names = tuple(row.name for row in fields(Hull))
    reads = {
        "names": lambda: _check_names(section, names, location),
        "hull": lambda: _read_record(Hull, {key: value for key, value in section.items() if key in names}, location),
    }
    _, values = _read_all(reads)
    hull: Hull = values["hull"]
    return hull


def _read_record(kind: type[RecordT], values: Mapping[str, Any], location: str) -> RecordT:
    try:
        return record_from(kind, values)
    except ValueError as error:
        raise VehicleError("\n".join(f"{location} {line}" for line in str(error).splitlines())) from None


def _read_text(value: Any, location: str) -> str:
    if not isinstance(value, str) or not value:
        raise VehicleError(f"{location}: expected a text in quotes")
    return value


def _read_texts(value: Any, location: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise VehicleError(f"{location}: expected a list of texts")
    return tuple(value)


def _read_parameters(section: Mapping[str, Any], path: Path) -> dict[str, float]:
    values: dict[str, float] = {}
    problems: list[str] = []
    if "file" in section:
        file = path.parent / _read_text(section["file"], f"{path}: [parameters] file")
        try:
            values.update(parse_file(read_text(file, MAX_BYTES), str(file)))
        except OSError as error:
            problems.append(f"{path}: [parameters] file {file} cannot be read: {error.strerror}")
        except ParameterError as error:
            problems.append(str(error))
    direct_values = {name: value for name, value in section.items() if name != "file"}
    for name, value in direct_values.items():
        try:
            values[name] = _read_parameter(name, value)
        except ParameterError as error:
            problems.append(f"{path}: [parameters] {error}")
    _raise_problems(problems)
    return values


def _read_parameter(name: str, value: Any) -> float:
    expected = f"{name[:60]}: expected a number"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ParameterError(expected)
    try:
        number = float(value)
    except OverflowError:
        raise ParameterError(expected) from None
    return TABLE[index_of(name)].check(number)
