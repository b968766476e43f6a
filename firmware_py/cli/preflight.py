"""Checks of `rambler check` besides the devices: parameters, state, disk, links, clock and priority."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from enum import Enum
from pathlib import Path
from typing import Any

import msgspec

from firmware_py.assemble.devices import driver_problems, package_drivers, shared_port_warnings
from firmware_py.assemble.wiring import vehicle_parameters
from firmware_py.cli.state_owner import describe_user, find_foreign_files
from firmware_py.common.calendar import is_possible
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import PlanKind
from firmware_py.core.resume import from_bytes as resume_from_bytes
from firmware_py.devices import GROUP, SECTIONS
from firmware_py.guidance import loiter_placement
from firmware_py.guidance.tasks import TaskSettings
from firmware_py.link.access import Gate, is_open_to_anyone
from firmware_py.link.nmea import open_output
from firmware_py.link.signing import KeyState, Signing, find_key
from firmware_py.link.wire.open_transport import NMEA_PREFIX, open_transport
from firmware_py.link.wire.transport import MessageTransport, Satellite
from firmware_py.link.wire.urls import LinkError
from firmware_py.log.disk import log_files
from firmware_py.registry import find_unused_entry_points
from firmware_py.system.clock import machine_s
from firmware_py.system.realtime import clock_is_synchronised
from firmware_py.system.serial_port import PortError, SerialPort
from firmware_py.system.state_directory import (
    LOG_DIRECTORY,
    RESUME_FILE,
    SIGNING_FILE,
    StateFiles,
    find_exposed_key_files,
    load_parameters,
    load_plans,
    report_damage,
)
from firmware_py.system.status_file import Freshness, find_status
from firmware_py.vehicle import Vehicle

MAX_MODEM_REPLY_S, MODEM_POLL_S = 12.0, 0.05  # the modem driver repeats a request after ten seconds
SLOW_SYNC_S, MAX_SYNC_S = 0.2, 1.0
TEST_WRITE_BYTES = 4096


class Level(Enum):
    """Severity of a finding. WARN does not prevent a voyage, but the operator should know of it."""

    PASS = "pass"  # noqa: S105 - no password
    WARN = "warn"
    FAIL = "fail"


class Finding(msgspec.Struct, frozen=True):
    """Result of a check; `values` are added to the JSON output."""

    level: Level
    subject: str
    text: str
    values: dict[str, Any] = msgspec.field(default_factory=dict)


def parameters_in_force(vehicle: Vehicle, directory: Path, report_problem: Callable[[str], None]) -> ParameterSet:
    """Return the parameters of the next start; pass problems of stored parameters to `report_problem`."""
    parameters = vehicle_parameters(vehicle)
    for name, value in load_parameters(StateFiles(directory), report_problem)[0].items():
        parameters = parameters.replaced(name, value)
    return parameters


def check_drivers(vehicle: Vehicle) -> Iterator[Finding]:
    """Name the drivers of installed packages; one that cannot be used leaves the boat without its device."""
    yield from (Finding(Level.FAIL, "drivers", text) for text in driver_problems(vehicle))
    registries = {registry.kind: registry for registry in SECTIONS.values()}
    yield from (Finding(Level.WARN, "drivers", text) for text in find_unused_entry_points(GROUP, registries))
    for section, driver in package_drivers(vehicle).items():
        if not driver.problem:
            name = getattr(vehicle, section).driver
            package = SECTIONS[section].package_of(name)
            yield Finding(Level.PASS, "drivers", f"[{section}]: {name} of the installed package {package}")


def check_parameters(vehicle: Vehicle, directory: Path) -> Iterator[Finding]:
    """Check the stored parameters, which override those of the vehicle file."""
    problems: list[str] = []
    stored, _ = load_parameters(StateFiles(directory), problems.append)
    yield from (Finding(Level.WARN, "parameters", text) for text in problems)
    counts = {"vehicle_file": len(vehicle.parameters), "stored": len(stored)}
    text = f"{counts['vehicle_file']} from the vehicle file, {counts['stored']} saved values override them, all valid"
    if not problems:
        yield Finding(Level.PASS, "parameters", text, counts)
    yield from _check_loiter_radius(parameters_in_force(vehicle, directory, lambda _text: None))


def _check_loiter_radius(parameters: ParameterSet) -> Iterator[Finding]:
    """Warn if a boat with these model parameters would leave the loiter circle in a current."""
    settings = TaskSettings.of(parameters)
    circle_m, min_radius_m = settings.station_radius_m, loiter_placement.min_radius_m(settings)
    if circle_m < min_radius_m:
        text = f"LOIT_RADIUS {circle_m:g} m: in a current the boat needs at least {min_radius_m:.0f} m"
        yield Finding(Level.WARN, "parameters", text, {"radius_m": circle_m, "held_m": round(min_radius_m, 1)})


def check_state(directory: Path) -> Iterator[Finding]:
    """Check the stored state, and whether an autopilot uses it now."""
    status = find_status(directory, machine_s())
    if status.freshness is Freshness.RUNNING:
        text = (
            f"{directory} is used by an autopilot (process {status.content['pid']}), which has the ports; stop it first"
        )
        yield Finding(Level.WARN, "state", text)
    if not directory.is_dir():
        if not os.path.lexists(directory):  # else check_storage reports the file
            yield Finding(Level.PASS, "state", f"{directory} will be created at the first start")
        return
    if not os.access(directory, os.R_OK | os.X_OK):
        owner = describe_user(directory.stat().st_uid)
        yield Finding(Level.FAIL, "state", f"{directory}: permission denied; run this as {owner}, or as root (sudo)")
        return
    if problem := find_foreign_files(directory):
        yield Finding(Level.FAIL, "state", problem)
    files, problems = StateFiles(directory), list[str]()
    report_damage(files, problems.append)
    plans = load_plans(files, problems.append)
    if (record := files.load(RESUME_FILE)) is not None:
        try:
            resume_from_bytes(record)
        except (ValueError, RecursionError) as error:
            problems.append(f"stored {RESUME_FILE} ignored: {error}")
    problems += (f"{name} is readable by other users; chmod 600" for name in find_exposed_key_files(directory))
    yield from (Finding(Level.WARN, "state", text) for text in problems)
    key = find_key(files.examine(SIGNING_FILE))
    if key.state is KeyState.LOST:
        yield Finding(Level.FAIL, "state", f"signing key lost: {key.problem}; set or remove it with `rambler key`")
    elif not problems:
        counts = {kind.name.lower(): len(plans.of(kind).items) for kind in PlanKind}
        text = ", ".join(f"{kind} of {count} items" for kind, count in counts.items())
        yield Finding(
            Level.PASS, "state", f"{directory}: {text}, key {key.state.value}", counts | {"key": key.state.value}
        )


def check_storage(directory: Path, parameters: ParameterSet) -> Iterator[Finding]:
    """Check the time of a write and the free space for logs.

    If the directory does not exist, this writes to its parent: a directory created here would belong to the user of
    this command, who may be another user than that of the autopilot.
    """
    existing_path = next(
        path for path in (directory.absolute(), *directory.absolute().parents) if os.path.lexists(path)
    )
    try:
        with tempfile.NamedTemporaryFile(dir=existing_path) as file:
            start_s = time.monotonic()
            file.write(b"\0" * TEST_WRITE_BYTES)
            file.flush()
            os.fsync(file.fileno())
            sync_s = time.monotonic() - start_s
        free_mb = shutil.disk_usage(existing_path).free / 1e6
        logs = directory / LOG_DIRECTORY
        if logs.exists() and not logs.is_dir():
            yield Finding(Level.FAIL, "storage", f"{logs} is not a directory: no log can be written; move it away")
        logs_mb = sum(path.stat().st_size for path in log_files(logs).values()) / 1e6 if logs.is_dir() else 0.0
    except OSError as error:
        yield Finding(Level.FAIL, "storage", f"{directory}: {error.strerror}; choose another with --state")
        return
    keep_mb, reserve_mb, file_mb = (parameters[name] for name in ("LOG_KEEP_MB", "LOG_FREE_MB", "LOG_FILE_MB"))
    text = f"{directory}: {free_mb:.0f} MB free, {logs_mb:.0f} MB of logs"
    level = Level.PASS
    if free_mb < reserve_mb and free_mb + logs_mb <= reserve_mb + file_mb:  # deleting old logs is not enough
        level, text = Level.FAIL, f"{text}; no log is written below LOG_FREE_MB {reserve_mb:g}; free space"
    elif free_mb + logs_mb < keep_mb + reserve_mb:
        level, text = Level.WARN, f"{text}; LOG_KEEP_MB {keep_mb:g} does not fit; the oldest logs are deleted earlier"
    yield Finding(level, "storage", text, {"free_mb": round(free_mb, 1), "logs_mb": round(logs_mb, 1)})
    level = Level.FAIL if sync_s > MAX_SYNC_S else Level.WARN if sync_s > SLOW_SYNC_S else Level.PASS
    remedy = "" if level is Level.PASS else "; acknowledgements are delayed; replace a slow or worn card"
    yield Finding(level, "storage", f"4 kB written in {1e3 * sync_s:.1f} ms{remedy}", {"sync_s": round(sync_s, 4)})


def check_clocks() -> Iterator[Finding]:
    """Check the system time, its synchronization, and the clock resolution."""
    utc_s = time.time()
    text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(utc_s))
    if not is_possible(utc_s):
        yield Finding(Level.WARN, "clock", f"{text} is wrong; set it, or wait for NTP or a GPS fix")
    elif not clock_is_synchronised():
        yield Finding(Level.WARN, "clock", f"{text}; not synchronized (NTP, PTP, GPS); CLK_SET 2 sets it from GPS")
    else:
        yield Finding(Level.PASS, "clock", text)
    resolution_s = time.clock_getres(time.CLOCK_MONOTONIC)
    level = Level.PASS if resolution_s <= 1e-3 else Level.FAIL
    yield Finding(level, "clock", f"monotonic clock resolution {1e9 * resolution_s:.0f} ns")


def check_priority() -> Iterator[Finding]:
    """Check whether real-time priority is allowed; without it ticks may be late."""
    try:
        policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, parameter)
    except OSError:
        text = "SCHED_FIFO not allowed: ticks may be late under load; set LimitRTPRIO"
        yield Finding(Level.WARN, "priority", text)
        return
    yield Finding(Level.PASS, "priority", "SCHED_FIFO allowed")


def check_links(urls: Sequence[str], directory: Path) -> Iterator[Finding]:
    """Open all links as the autopilot would, and report those that accept commands from anyone."""
    signing = Signing(time.time, _ignore_key)
    signing.restore(StateFiles(directory).examine(SIGNING_FILE))
    gate = Gate(signing)
    if not urls:
        yield Finding(Level.WARN, "links", "none: no ground station can connect; add some to [link] urls")
    with ExitStack() as exit_stack:
        for url in urls:
            yield from _check_link(url, gate, exit_stack)


def _ignore_key(content: bytes, *, both_slots: bool = False) -> None:
    """Store nothing, since this command changes no key."""


def _check_link(url: str, gate: Gate, exit_stack: ExitStack) -> Iterator[Finding]:
    """Open a link, which `exit_stack` closes, and report its problems."""
    port_findings: list[Finding] = []

    def open_line(path: str, baud: int) -> SerialPort:
        line = SerialPort(path, baud)
        line.open()
        exit_stack.callback(line.close)
        port_findings.extend(Finding(Level.FAIL, "links", text, {"url": url}) for text in shared_port_warnings([line]))
        return line

    try:
        if url.startswith(NMEA_PREFIX):
            exit_stack.callback(open_output(url, open_line).close)
            yield from port_findings
            yield Finding(Level.PASS, "links", f"{url} can be opened", {"url": url})
            return
        transport = open_transport(url, open_line)
    except (LinkError, PortError) as error:
        yield Finding(Level.FAIL, "links", str(error), {"url": url})
        return
    exit_stack.callback(transport.close)
    yield from port_findings
    if isinstance(transport, Satellite):
        yield _check_modem(url, transport)
    if is_open_to_anyone(gate, transport):
        alternative = "" if isinstance(transport, Satellite) else " or listen on 127.0.0.1"
        text = f"{url}: accepts commands from anyone; set a key (`rambler key set`){alternative}"
        yield Finding(Level.WARN, "links", text, {"url": url})
    elif not isinstance(transport, Satellite):
        yield Finding(Level.PASS, "links", f"{url} can be opened", {"url": url})


def _check_modem(url: str, transport: MessageTransport) -> Finding:
    """Wait for the serial number of the modem, which it sends in its first reply."""
    end_s = machine_s() + MAX_MODEM_REPLY_S
    while (now_s := machine_s()) < end_s:
        transport.poll(now_s)
        transport.receive(transport.descriptors()[0])
        if imei := transport.satellite_status(now_s).imei:
            return Finding(Level.PASS, "links", f"{url}: modem {imei} answers", {"url": url, "imei": imei})
        time.sleep(MODEM_POLL_S)
    text = f"{url}: no modem answers; check its power, wiring and baud rate"
    return Finding(Level.FAIL, "links", text, {"url": url})


def chain_checks(*checks: Callable[[], Iterator[Finding]]) -> Iterator[Finding]:
    """Yield the findings of all checks as they arrive."""
    for check in checks:
        yield from check()
