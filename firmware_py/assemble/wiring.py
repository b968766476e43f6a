"""Opens and connects all parts of the autopilot for a vehicle file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from firmware_py import ROOT, __version__, start_commit_query
from firmware_py.assemble.devices import (
    Line,
    close_all,
    driver_problems,
    open_devices,
    open_lines,
    shared_port_warnings,
)
from firmware_py.assemble.logs import file_root, log_recorder, with_corrected_times
from firmware_py.assemble.nmea_outputs import connect_nmea_outputs, open_nmea_outputs, status_reader
from firmware_py.assemble.status import report_status
from firmware_py.assemble.stored_state import read_state, report_key_problem, resume, select_start_parameters
from firmware_py.assemble.supervision import read_endings
from firmware_py.common.interfaces import Clock
from firmware_py.common.link_status import LinkStatus
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plans
from firmware_py.common.records import Event, Severity, Stored
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import Moment
from firmware_py.core.state import State
from firmware_py.devices import COMPASSES
from firmware_py.files.reading import read_regular
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import NMEA_PREFIX, SatelliteSupport, open_transport
from firmware_py.link.wire.transport import Transport
from firmware_py.loop import LoopParts
from firmware_py.system.clock import LOCKSTEP_BOOT, LockstepClock, RealClock, boot_id, machine_s, set_utc_s
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.console import Console
from firmware_py.system.endings import Endings
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.realtime import LoadMeter, clock_is_synchronised
from firmware_py.system.serial_port import SerialPort
from firmware_py.system.state_directory import RECORD_FILES, SATELLITE_FILE, SIGNING_FILE, KeyVault, StateDirectory
from firmware_py.system.store import Store
from firmware_py.vehicle import Vehicle

if TYPE_CHECKING:
    from firmware_py.link.nmea import NmeaOutput


def vehicle_parameters(vehicle: Vehicle) -> ParameterSet:
    """Return the defaults, overridden by the values of the vehicle file."""
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        if TABLE[INDEX[name]].read_only:
            continue  # in a file saved by a ground station
        parameters = parameters.replaced(name, value)
    return parameters


class Options(msgspec.Struct, frozen=True):
    """Options of the command line."""

    state_directory: Path
    link_urls: tuple[str, ...] = ()
    wait: bool = False  # for ports, links and storage that are missing at the start
    lockstep: str | None = None  # socket of the HIL; None: real time
    status: bool = False  # also in lockstep
    may_set_clock: bool = False
    runtime: Path | None = None  # directory with the reports on the end of the last run


@dataclass(slots=True)
class Assembly:
    """A connected autopilot; `close` closes links, log, store, lines and console, in that order."""

    parts: LoopParts
    endpoint: Endpoint
    console: Console
    endings: Endings
    close: Callable[[], None]


def assemble(vehicle: Vehicle, options: Options) -> Assembly:
    """Open and connect all parts; raise PortError, StoreError or LinkError with the remedy if one cannot be opened.

    On any error, all opened parts are closed again.
    """
    with ExitStack() as opened:
        return _open_and_connect(vehicle, options, opened)


def _open_and_connect(vehicle: Vehicle, options: Options, opened: ExitStack) -> Assembly:
    """Open and connect all parts. Assembly.close closes them in reverse order, or `opened` after an error."""
    opened.callback(commit := start_commit_query(ROOT))  # git runs while lines and state are opened
    console = opened.enter_context(closing(Console()))
    devices = open_devices(vehicle, wait=options.wait, report=console.line)
    opened.callback(close_all, lines := list(devices.lines))
    store = opened.enter_context(closing(Store(options.state_directory, private=(SIGNING_FILE,), wait=options.wait)))
    say, notices = _create_reporter(console)
    stored, plans = read_state(options.state_directory, store, say)
    clock: Clock = RealClock()  # the lockstep clock is created after the lines
    satellite_support = SatelliteSupport(KeyVault(store, SATELLITE_FILE), lambda: clock.utc_s(), notices.append)  # noqa: PLW0108
    opener, report_retry = _line_opener(lines, console, wait=options.wait), say if options.wait else None
    transports, outputs = _open_links(vehicle, options, opener, satellite_support, report_retry, opened)
    _report_device_problems(vehicle, lines if options.lockstep is None else (), say)
    clock_setter = ClockSetter(clock.utc_s, set_utc_s, clock_is_synchronised) if options.may_set_clock else None
    clock, clock_start = _create_clock(clock, options, lines, store)
    endings = read_endings(store, options.runtime, clock.utc_s(), notices)
    state = _create_start_state(vehicle, stored, plans, endings, clock_start.at(clock.now_s(), clock.utc_s()), say)
    autopilot, vault, version = Autopilot(state, stored, clock_start), KeyVault(store), _read_version(commit())
    recorder = log_recorder(options.state_directory, state.parameters, plans, clock, version.commit, opened)
    endpoint = Endpoint(
        transports,
        autopilot,
        utc_s=clock.utc_s,
        version=version,
        load=LoadMeter(clock).fraction,
        vault=vault,
        offer_utc=None if clock_setter is None else clock_setter.add_station_time,
        calibrator=devices.calibrator,
        storage=file_root(options.state_directory, state.parameters),
        written=lambda: store.written,
        start_events=notices,
    )
    _connect_endpoint(endpoint, vault, options.state_directory, notices, say, opened)
    parts = LoopParts(
        clock=clock,
        autopilot=autopilot,
        compass=devices.compass,
        compass_b=devices.compass_b,
        compass_b_is_prompt=vehicle.compass_b is None or COMPASSES[vehicle.compass_b.driver].has_north,
        position=with_corrected_times(devices.position, clock, options.state_directory, say),
        rudder=devices.rudder,
        power=devices.power,
        vessels=devices.vessels,
        wind=devices.wind,
        depth=devices.depth,
        rudder_angle=devices.rudder_angle,
        link=endpoint,
        recorder=recorder,
        store=store,
        lines=lines,
        print_event=_create_event_printer(console, clock),
        fault_barrier=FaultBarrier(console.line),
        clock_setter=clock_setter,
        notices=notices,
        tick_on_compass=options.lockstep is None,
    )
    _connect_reports(vehicle, options, parts, status_reader(endpoint, outputs), version.commit, console, opened)
    connect_nmea_outputs(outputs, parts)
    return Assembly(parts, endpoint, console, endings, opened.pop_all().close)


def _connect_endpoint(
    endpoint: Endpoint,
    vault: KeyVault,
    directory: Path,
    notices: list[Event],
    say: Callable[[str], None],
    opened: ExitStack,
) -> None:
    """Close the endpoint at the end, use a late signing key, and report the events of its start."""
    opened.callback(endpoint.close)
    vault.on_mount(_create_late_key_handler(endpoint, directory, say))
    notices += (event for event in endpoint.start_events if event not in notices)


def _report_device_problems(vehicle: Vehicle, lines: Sequence[Line], say: Callable[[str], None]) -> None:
    """Report drivers that cannot be used, and lines that other programs have open."""
    for text in (*driver_problems(vehicle), *shared_port_warnings(lines)):
        say(text)


def _create_start_state(
    vehicle: Vehicle, stored: StateDirectory, plans: Plans, endings: Endings, now: Moment, say: Callable[[str], None]
) -> State:
    base = vehicle_parameters(vehicle)
    parameters = select_start_parameters(stored.apply_parameters(base), base, endings.early, say)
    return resume(State.at_start(parameters, plans), stored.resume_record(), now, say)


def _connect_reports(
    vehicle: Vehicle,
    options: Options,
    parts: LoopParts,
    links: Callable[[float], Sequence[LinkStatus]],
    commit: str,
    console: Console,
    opened: ExitStack,
) -> None:
    """Write the status after each tick; in lockstep, which has no real time, only on request."""
    if options.lockstep is None or options.status:
        report_status(vehicle, options.state_directory, parts, links, commit, console, opened)
    else:
        parts.store.set_aside(RECORD_FILES)


def _create_clock(real: Clock, options: Options, lines: Sequence[Line], store: Store) -> tuple[Clock, Moment]:
    """Return the clock (in lockstep that of the HIL), and the moment of its zero by the clock of the computer."""
    if options.lockstep is None:
        return real, Moment(0.0, boot_id(), machine_s() - real.now_s())
    return _create_lockstep_clock(options.lockstep, lines, store), Moment(0.0, LOCKSTEP_BOOT)


def _create_reporter(console: Console) -> tuple[Callable[[str], None], list[Event]]:
    """Return a function that prints a text and reports it with the next tick, and the list of these events."""
    notices: list[Event] = []

    def say(text: str) -> None:
        console.print_early(text)
        notices.append(Event(Severity.WARNING, text))

    return say, notices


def _create_event_printer(console: Console, clock: Clock) -> Callable[[Event], None]:
    return lambda event: console.event(f"{clock.now_s():10.3f} {event.severity.name.lower():8}", event.text)


def _create_late_key_handler(
    endpoint: Endpoint, directory: Path, say: Callable[[str], None]
) -> Callable[[Stored], None]:
    """Return the handler of the signing key on a disk that is mounted after the start."""

    def use_key(stored: Stored) -> None:
        if endpoint.restore_late_key(stored):
            report_key_problem(directory, stored, say, late=True)

    return use_key


def _create_lockstep_clock(path: str, lines: Sequence[Line], store: Store) -> LockstepClock:
    return LockstepClock(
        path,
        [line.name for line in lines],
        lambda: [line.written for line in lines],
        store.settle,
        lambda: [line.fileno() for line in lines],
    )


def _line_opener(lines: list[Line], console: Console, *, wait: bool) -> Callable[[str, int], SerialPort]:
    """Return the function that opens the serial port of a link and adds it to `lines`."""

    def open_line(path: str, baud: int) -> SerialPort:
        line = SerialPort(path, baud)
        open_lines([line], wait=wait, report=console.line)
        lines.append(line)
        return line

    return open_line


def _open_links(
    vehicle: Vehicle,
    options: Options,
    open_line: Callable[[str, int], SerialPort],
    satellite_support: SatelliteSupport,
    say: Callable[[str], None] | None,
    opened: ExitStack,
) -> tuple[list[Transport], list[NmeaOutput]]:
    """Open the links and the outputs of NMEA 0183."""
    urls = (*vehicle.link_urls, *options.link_urls)
    transports: list[Transport] = []
    for url in urls:
        if not url.startswith(NMEA_PREFIX):
            transports.append(open_transport(url, open_line, satellite_support, report_retry=say))
            opened.callback(transports[-1].close)
    return transports, open_nmea_outputs(urls, open_line, say, opened)


def _read_version(commit: str) -> Version:
    """Return the version and commit of the program, and an id of the computer."""
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    try:
        machine = read_regular(Path("/etc/machine-id"), 1 << 12)
    except OSError:
        machine = b""
    uid = int.from_bytes(hashlib.sha256(machine).digest()[:8]) if machine else 0
    return Version(major, minor, patch, commit, uid)
