"""Opens and wires everything that a vehicle file names."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from firmware_py import ROOT, __version__, ask_commit
from firmware_py.assemble.devices import Line, close_all, open_devices, open_lines, shared_ports
from firmware_py.assemble.earlier_runs import parameters_to_start_with, read_state, report_key, resume
from firmware_py.assemble.logs import dated, recorder_of, storage_of
from firmware_py.assemble.status import show_status
from firmware_py.assemble.supervision import read_endings
from firmware_py.assemble.talkers import feed_talkers, links_of, open_talkers
from firmware_py.common.interfaces import Clock
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, Severity, Stored
from firmware_py.core.autopilot import Autopilot
from firmware_py.core.resume import Moment
from firmware_py.core.state import State
from firmware_py.files.reading import read_regular
from firmware_py.link.endpoint import Endpoint
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.wire.open_transport import NMEA, Ashore, open_transport
from firmware_py.link.wire.transport import Transport
from firmware_py.loop import LoopParts
from firmware_py.system.clock import LOCKSTEP_BOOT, LockstepClock, RealClock, boot_id, machine_s, set_utc_s
from firmware_py.system.clock_setter import ClockSetter
from firmware_py.system.console import Console
from firmware_py.system.endings import Endings
from firmware_py.system.fault_barrier import FaultBarrier
from firmware_py.system.realtime import LoadMeter, clock_is_synchronised
from firmware_py.system.serial_port import SerialPort
from firmware_py.system.state_directory import RECORD_FILES, SATELLITE_FILE, SIGNING_FILE, KeyVault
from firmware_py.system.store import Store
from firmware_py.vehicle import Vehicle

if TYPE_CHECKING:
    from firmware_py.link.nmea import NmeaOutput


def base_parameters(vehicle: Vehicle) -> ParameterSet:
    """The defaults with the vehicle file's values over them."""
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        if TABLE[INDEX[name]].read_only:
            continue  # from a file that a ground station has saved
        parameters = parameters.replaced(name, value)
    return parameters


class Options(msgspec.Struct, frozen=True):
    """What the command line says."""

    state_directory: Path
    link_urls: tuple[str, ...] = ()
    wait: bool = False
    lockstep: str | None = None
    status: bool = False  # in lockstep, too
    may_set_clock: bool = False
    runtime: Path | None = None  # where the service manager and the run before have left how it ended


@dataclass(slots=True)
class Assembly:
    """A wired autopilot; `close` closes links, log, store, lines and console, in that order."""

    parts: LoopParts
    endpoint: Endpoint
    console: Console
    endings: Endings
    close: Callable[[], None]


def assemble(vehicle: Vehicle, options: Options) -> Assembly:
    """Wire everything; PortError, StoreError or LinkError with the remedy when something cannot be had.

    What has been opened by then is closed again, whatever the error.
    """
    with ExitStack() as opened:
        return Assembly(*_wire(vehicle, options, opened), opened.pop_all().close)


def _wire(vehicle: Vehicle, options: Options, opened: ExitStack) -> tuple[LoopParts, Endpoint, Console, Endings]:
    """Open and wire everything; `opened` is to close it, the last first."""
    opened.callback(commit := ask_commit(ROOT))  # git looks while lines and state are opened
    console = opened.enter_context(closing(Console()))
    devices = open_devices(vehicle, wait=options.wait)
    opened.callback(close_all, lines := list(devices.lines))
    store = opened.enter_context(closing(Store(options.state_directory, private=(SIGNING_FILE,), wait=options.wait)))
    notices: list[Event] = []
    kept, plans = read_state(options.state_directory, store, say := _teller(console, notices))
    clock: Clock = RealClock()
    # The clock of lockstep is made after the lines.
    ashore = Ashore(KeyVault(store, SATELLITE_FILE), lambda: clock.utc_s(), notices.append)  # noqa: PLW0108
    transports, talkers = _open_links(vehicle, options, lines, ashore, say if options.wait else None, opened)
    if options.lockstep is None:
        for text in shared_ports(lines):
            say(text)
    clock_setter = ClockSetter(clock.utc_s, set_utc_s, clock_is_synchronised) if options.may_set_clock else None
    clock, begun = _clock(clock, options, lines, store)
    endings = read_endings(store, options.runtime, clock.utc_s(), notices)
    base = base_parameters(vehicle)
    parameters = parameters_to_start_with(kept.parameters_over(base), base, endings.early, say)
    now = begun.at(clock.now_s(), clock.utc_s())
    state = resume(State.at_start(parameters, plans), kept.resume_record(), now, say)
    autopilot, vault, version = Autopilot(state, kept, begun), KeyVault(store), _version(commit())
    recorder = recorder_of(options.state_directory, parameters, plans, clock, version.commit, opened)
    endpoint = Endpoint(
        transports,
        autopilot,
        utc_s=clock.utc_s,
        version=version,
        load=LoadMeter(clock).share,
        vault=vault,
        offer_utc=None if clock_setter is None else clock_setter.add_station_time,
        calibrator=devices.calibrator,
        storage=storage_of(options.state_directory, parameters),
        written=lambda: store.written,
        start_events=notices,
    )
    opened.callback(endpoint.close)
    vault.on_mount(_taker_of_late_key(endpoint, options.state_directory, say))
    notices += (event for event in endpoint.start_events if event not in notices)
    parts = LoopParts(
        clock=clock,
        autopilot=autopilot,
        compass=devices.compass,
        compass_b=devices.compass_b,
        position=dated(devices.position, clock, options.state_directory, say),
        rudder=devices.rudder,
        power=devices.power,
        vessels=devices.vessels,
        link=endpoint,
        recorder=recorder,
        store=store,
        lines=lines,
        print_event=_printer(console, clock),
        fault_barrier=FaultBarrier(console.line),
        clock_setter=clock_setter,
        notices=notices,
        tick_on_compass=options.lockstep is None,
    )
    if options.lockstep is None or options.status:  # else nobody looks: time is not what a clock on the wall shows
        links = links_of(endpoint, talkers)
        show_status(vehicle, options.state_directory, parts, links, version.commit, console, opened)
    else:
        store.set_aside(RECORD_FILES)
    feed_talkers(talkers, parts)
    return parts, endpoint, console, endings


def _clock(real: Clock, options: Options, lines: Sequence[Line], store: Store) -> tuple[Clock, Moment]:
    """Return the clock, in lockstep the HIL's, and when its time was 0 by the machine's monotonic one."""
    if options.lockstep is None:
        return real, Moment(0.0, boot_id(), machine_s() - real.now_s())
    return _lockstep_clock(options.lockstep, lines, store), Moment(0.0, LOCKSTEP_BOOT)


def _teller(console: Console, notices: list[Event]) -> Callable[[str], None]:
    """Return what says a text now, and has it told with the next tick."""

    def say(text: str) -> None:
        console.ahead(text)
        notices.append(Event(Severity.WARNING, text))

    return say


def _printer(console: Console, clock: Clock) -> Callable[[Event], None]:
    return lambda event: console.event(f"{clock.now_s():10.3f} {event.severity.name.lower():8}", event.text)


def _taker_of_late_key(endpoint: Endpoint, directory: Path, say: Callable[[str], None]) -> Callable[[Stored], None]:
    """Return what has the key of a disk that has come late count from then on."""

    def take_up(stored: Stored) -> None:
        if endpoint.take_up_key(stored):
            report_key(directory, stored, say, late=True)

    return take_up


def _lockstep_clock(path: str, lines: Sequence[Line], store: Store) -> LockstepClock:
    return LockstepClock(
        path,
        [line.name for line in lines],
        lambda: [line.written for line in lines],
        store.settle,
        lambda: [line.fileno() for line in lines],
    )


def _open_links(
    vehicle: Vehicle,
    options: Options,
    lines: list[Line],
    ashore: Ashore,
    say: Callable[[str], None] | None,
    opened: ExitStack,
) -> tuple[list[Transport], list[NmeaOutput]]:
    """Open the links and the outputs of NMEA 0183; the serial lines among them are added to those of the devices."""

    def open_line(path: str, baud: int) -> SerialPort:
        line = SerialPort(path, baud)
        open_lines([line], wait=options.wait)
        lines.append(line)
        return line

    urls = (*vehicle.link_urls, *options.link_urls)
    transports: list[Transport] = []
    for url in urls:
        if not url.startswith(NMEA):
            transports.append(open_transport(url, open_line, ashore, say=say))
            opened.callback(transports[-1].close)
    return transports, open_talkers(urls, open_line, say, opened)


def _version(commit: str) -> Version:
    """This program's version and commit, and a number of this computer's own."""
    major, minor, patch = (int(part) for part in __version__.split(".")[:3])
    try:
        machine = read_regular(Path("/etc/machine-id"), 1 << 12)
    except OSError:
        machine = b""
    uid = int.from_bytes(hashlib.sha256(machine).digest()[:8]) if machine else 0
    return Version(major, minor, patch, commit, uid)
