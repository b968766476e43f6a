"""Vehicle file -> wired autopilot; the only composer."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_py import ROOT, __version__, commit_of, version_text
from firmware_py.actuator.dynamixel import DynamixelRudder
from firmware_py.actuator.volz import VolzRudder
from firmware_py.common.interfaces import ByteLine, Clock, Compass, Position, Rudder
from firmware_py.common.parameters import INDEX, TABLE, ParameterSet, format_file
from firmware_py.common.records import Event
from firmware_py.core.step import State
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.files.root import FileRoot
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import open_transport
from firmware_py.log.disk import log_files
from firmware_py.log.recorder import LogRecorder
from firmware_py.loop import PARAMETER_FILE, Autopilot, LoopParts
from firmware_py.sensors.line_tee import LineTee
from firmware_py.sensors.nmea import NmeaCompass, NmeaPosition
from firmware_py.sensors.pni_tcm import PniCompass
from firmware_py.sensors.relabelled import RelabelledCompass
from firmware_py.sensors.ubx import UbxPosition
from firmware_py.system.clock import LockstepClock, RealClock, set_utc_s
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.console import Console
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.realtime import LoadMeter, clock_is_kept
from firmware_py.system.serial_port import PortError, SerialPort
from firmware_py.system.state_directory import stored_parameters, stored_plans, with_resume
from firmware_py.system.store import Store
from firmware_py.vehicle import CompassEntry, PositionEntry, RudderEntry, Vehicle, VehicleError

LOG_DIRECTORY = "logs"
SIGNING_FILE = "signing.key"
UPLOAD_DIRECTORY = "uploads"
BOOT_COUNT = "STAT_BOOTCNT"

COMPASSES: Mapping[str, Callable[[ByteLine, CompassEntry], Compass]] = {
    "nmea": lambda line, entry: NmeaCompass(
        line, require_checksum=entry.require_checksum, sentences=entry.sentences or None
    ),
    "pni_tcm": lambda line, entry: PniCompass(line, rate_hz=entry.rate_hz),
}
POSITIONS: Mapping[str, Callable[[ByteLine, PositionEntry], Position]] = {
    "nmea": lambda line, entry: NmeaPosition(line, require_checksum=entry.require_checksum),
    "ubx": lambda line, _entry: UbxPosition(line),
}
RUDDERS: Mapping[str, Callable[[ByteLine, RudderEntry], Rudder]] = {
    "dynamixel": lambda line, entry: DynamixelRudder(line, device_id=entry.id),
    "volz": lambda line, entry: VolzRudder(line, device_id=entry.id),
}


@dataclass(frozen=True, slots=True)
class Devices:
    """The drivers of a vehicle and the serial lines under them."""

    compass: Compass
    position: Position | None
    rudder: Rudder
    compass_b: Compass | None
    lines: tuple[SerialPort, ...]


def open_devices(vehicle: Vehicle, *, wait: bool) -> Devices:
    """Open the ports and make the drivers.

    Raises PortError for a port that cannot be opened, unless `wait`: then it is taken up
    when it appears.
    """
    compass_line = SerialPort(vehicle.compass.port, vehicle.compass.baud)
    rudder_line = SerialPort(vehicle.rudder.port, vehicle.rudder.baud)
    lines = [compass_line, rudder_line]
    compass_view: ByteLine = compass_line
    position = None
    if (entry := vehicle.position) is not None:
        if entry.port == vehicle.compass.port:
            tee = LineTee(compass_line)
            compass_view, position_view = tee.first, tee.second
        else:
            position_line = SerialPort(entry.port, entry.baud)
            lines.append(position_line)
            position_view = position_line
        position = make_driver(POSITIONS, "position", position_view, entry)
    compass = make_driver(COMPASSES, "compass", compass_view, vehicle.compass)
    second = None
    if (entry_b := vehicle.compass_b) is not None:
        line_b = SerialPort(entry_b.port, entry_b.baud)
        lines.append(line_b)
        second = RelabelledCompass(make_driver(COMPASSES, "compass_b", line_b, entry_b))
    rudder = make_driver(RUDDERS, "rudder", rudder_line, vehicle.rudder)
    open_lines(lines, wait=wait)
    return Devices(compass, position, rudder, second, tuple(lines))


def make_driver(makers: Mapping[str, Callable[[ByteLine, Any], Any]], section: str, line: ByteLine, entry: Any) -> Any:
    """Make the driver that an entry of the vehicle file names; VehicleError for a value that it refuses."""
    try:
        return makers[entry.driver](line, entry)
    except ValueError as error:
        raise VehicleError(f"[{section}] of the vehicle file: {error}") from None


def open_lines(lines: Sequence[SerialPort], *, wait: bool) -> None:
    """Open all lines, or close them again and raise PortError."""
    try:
        for line in lines:
            try:
                line.open()
            except PortError:
                if not wait:
                    raise
    except PortError:
        for line in lines:
            line.close()
        raise


def base_parameters(vehicle: Vehicle) -> ParameterSet:
    """The defaults with the vehicle file's values over them."""
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        if TABLE[INDEX[name]].read_only:
            continue  # from a file that a ground station has saved
        parameters = parameters.replaced(name, value)
    return parameters


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says."""

    state_directory: Path
    link_urls: tuple[str, ...] = ()
    wait: bool = False
    lockstep: str | None = None
    may_set_clock: bool = False


@dataclass(frozen=True, slots=True)
class KeyVault:
    """Keeps the signing key in the store; fulfils ports.Vault."""

    store: Store

    def load(self) -> bytes | None:
        """Return what was saved last, None when nothing was."""
        return self.store.load(SIGNING_FILE)

    def save(self, content: bytes) -> None:
        """Keep this instead, in the background."""
        self.store.save(SIGNING_FILE, content)


@dataclass(slots=True)
class Assembly:
    """A wired autopilot and what must be closed after it."""

    boat: LoopParts
    endpoint: Endpoint
    console: Console

    def close(self) -> None:
        """Close links, log, store and lines, in that order."""
        self.endpoint.close()
        if self.boat.recorder is not None:
            self.boat.recorder.close()
        self.boat.store.close()
        for line in self.boat.lines:
            line.close()
        self.console.close()


def assemble(vehicle: Vehicle, options: Options) -> Assembly:
    """Wire everything; PortError, StoreError or LinkError with the remedy when something cannot be had."""
    console = Console()
    devices = open_devices(vehicle, wait=options.wait)
    store = Store(options.state_directory, private=(SIGNING_FILE,))
    parameters = base_parameters(vehicle)
    kept, unusable = stored_parameters(store, console.line)
    kept[BOOT_COUNT] = min(kept.get(BOOT_COUNT, 0.0) + 1.0, TABLE[INDEX[BOOT_COUNT]].maximum)
    for name, value in kept.items():
        parameters = parameters.replaced(name, value)
    kept = unusable | kept
    store.save(PARAMETER_FILE, format_file(kept).encode())
    lines = list(devices.lines)

    def open_line(path: str, baud: int) -> SerialPort:
        line = SerialPort(path, baud)
        open_lines([line], wait=options.wait)
        lines.append(line)
        return line

    transports = [open_transport(url, open_line) for url in (*vehicle.link_urls, *options.link_urls)]
    clock: Clock = RealClock()
    timekeeper = ClockSetter(clock.utc_s, set_utc_s, clock_is_kept) if options.may_set_clock else None
    if options.lockstep is not None:
        clock = LockstepClock(options.lockstep, [line.name for line in lines], lambda: [line.written for line in lines])
    version = _version()
    state = with_resume(State.at_start(parameters, stored_plans(store, console.line)), store, clock, console.line)
    pilot = Autopilot(state, store, kept, format_file)
    endpoint = Endpoint(
        transports,
        pilot,
        utc_s=clock.utc_s,
        version=version,
        load=LoadMeter(clock).share,
        vault=KeyVault(store),
        offer_utc=None if timekeeper is None else timekeeper.hear_station,
        calibrator=devices.compass if isinstance(devices.compass, PniCompass) else None,
        storage=_storage(options.state_directory, parameters),
    )
    if not endpoint.key_readable:
        console.line(f"stored {SIGNING_FILE} left out: it is not one; set the key again")
    recorder = _recorder(options.state_directory / LOG_DIRECTORY, parameters, clock, version.commit)

    def tell(event: Event) -> None:
        console.line(f"{clock.now_s():10.3f} {event.severity.name.lower():8} {event.text}")

    boat = LoopParts(
        clock=clock,
        pilot=pilot,
        compass=devices.compass,
        compass_b=devices.compass_b,
        position=devices.position,
        rudder=devices.rudder,
        link=endpoint,
        recorder=recorder,
        store=store,
        lines=lines,
        tell=tell,
        shelter=FaultBarrier(console.line),
        timekeeper=timekeeper,
    )
    return Assembly(boat, endpoint, console)


def _storage(directory: Path, parameters: ParameterSet) -> FileRoot:
    """What ground stations see of the state directory: its logs, and a place for what they upload."""
    logs = directory / LOG_DIRECTORY
    return FileRoot(
        lambda: log_files(logs) if logs.is_dir() else {},
        logs,
        directory / UPLOAD_DIRECTORY,
        logging=bool(parameters["LOG_ENABLE"]),
        background=True,
    )


def _recorder(directory: Path, parameters: ParameterSet, clock: Clock, commit: str) -> LogRecorder | None:
    if not parameters["LOG_ENABLE"]:
        return None
    return LogRecorder(
        directory,
        parameters=parameters,
        file_bytes=int(parameters["LOG_FILE_MB"] * 1e6),
        keep_bytes=int(parameters["LOG_KEEP_MB"] * 1e6),
        least_bytes=int(parameters["LOG_FREE_MB"] * 1e6),
        utc_s=clock.utc_s(),
        software=version_text("rambler", commit),
    )


def _version() -> Version:
    """This program's version and commit, and a number of this computer's own."""
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    try:
        machine = Path("/etc/machine-id").read_bytes()
    except OSError:
        machine = b""
    uid = int.from_bytes(hashlib.sha256(machine).digest()[:8]) if machine else 0
    return Version(major, minor, patch, commit_of(ROOT), uid)
