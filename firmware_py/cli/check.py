"""`rambler check`: a preflight; one PASS or FAIL line for each device, storage, clock and the parameters."""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from firmware_py.assemble import base_parameters
from firmware_py.cli.bench_session import BenchSession, Heard
from firmware_py.cli.run import default_state_directory
from firmware_py.common.parameters import ParameterError
from firmware_py.common.records import DeviceState
from firmware_py.vehicle import Vehicle, VehicleError, load

LISTEN_S = 3.0
FREE_BYTES_MINIMUM = 100_000_000
SYNC_S_MAXIMUM = 1.0
# No float computer's clock may stand before this program was written: 2026-01-01.
UTC_S_MINIMUM = 1_767_225_600.0

Finding = tuple[bool, str, str]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="the vehicle file")
    parser.add_argument("--state", metavar="DIR", type=Path, help="the state directory to check")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when all pass, 1 when anything fails, 2 when the vehicle file is wrong."""
    try:
        vehicle = load(arguments.vehicle)
    except VehicleError as error:
        print(f"rambler check: {error}", file=sys.stderr)
        return 2
    directory = arguments.state or default_state_directory(vehicle.name)
    checks: tuple[Callable[[], Iterator[Finding]], ...] = (
        lambda: _parameters(vehicle),
        lambda: _storage(directory),
        _clock,
        _priority,
        lambda: _devices(vehicle),
    )
    failed = 0
    for check in checks:
        for passed, subject, text in check():
            failed += not passed
            print(f"{'PASS' if passed else 'FAIL'}  {subject:<11} {text}", flush=True)
    return 1 if failed else 0


def _parameters(vehicle: Vehicle) -> Iterator[Finding]:
    try:
        base_parameters(vehicle)
    except ParameterError as error:
        yield False, "parameters", str(error)
        return
    yield True, "parameters", f"{len(vehicle.parameters)} set by the vehicle file, all valid"


def _storage(directory: Path) -> Iterator[Finding]:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=directory) as file:
            begun_s = time.monotonic()
            file.write(b"\0" * 4096)
            file.flush()
            os.fsync(file.fileno())
            sync_s = time.monotonic() - begun_s
        free_bytes = shutil.disk_usage(directory).free
    except OSError as error:
        yield False, "storage", f"{directory}: {error.strerror}; choose another with --state"
        return
    enough = free_bytes >= FREE_BYTES_MINIMUM
    remedy = "" if enough else "; make room"
    yield enough, "storage", f"{directory}: {free_bytes / 1e6:.0f} MB free{remedy}"
    yield sync_s <= SYNC_S_MAXIMUM, "storage", f"4 kB reach the disk in {1e3 * sync_s:.1f} ms"


def _clock() -> Iterator[Finding]:
    utc_s = time.time()
    plausible = utc_s >= UTC_S_MINIMUM
    text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(utc_s))
    yield plausible, "clock", text if plausible else f"{text} cannot be; set the clock or wait for the network's time"
    resolution_s = time.clock_getres(time.CLOCK_MONOTONIC)
    yield resolution_s <= 1e-3, "clock", f"monotonic clock resolves {1e9 * resolution_s:.0f} ns"


def _priority() -> Iterator[Finding]:
    """Say whether real-time priority is to be had; the autopilot runs without it, only less steadily."""
    try:
        policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, parameter)
    except OSError:
        yield True, "priority", "SCHED_FIFO not allowed: ticks may come late under load (LimitRTPRIO grants it)"
        return
    yield True, "priority", "SCHED_FIFO allowed"


def _devices(vehicle: Vehicle) -> Iterator[Finding]:
    try:
        session = BenchSession(vehicle)
    except VehicleError as error:
        yield False, "devices", str(error)
        return
    try:
        for _ in session.listen(LISTEN_S):
            pass
        for heard in session.heard:
            yield _device(heard)
    finally:
        session.close()


def _device(heard: Heard) -> Finding:
    if heard.error:
        return False, heard.role, heard.error
    if not heard.count or heard.health is None:
        return False, heard.role, f"{heard.driver} on {heard.port}: silent; check power, wiring and baud rate"
    rate_hz = heard.rate_hz()
    values = ", ".join(f"{name} {value}" for name, value in heard.values().items() if value is not None)
    text = f"{heard.driver} on {heard.port}: {rate_hz or 0.0:.1f} Hz, {values}"
    if heard.health.state is DeviceState.FAULTY:
        return False, heard.role, f"{text}; {heard.health.text}"
    if heard.health.rejected > heard.health.accepted:
        return False, heard.role, f"{text}; {heard.health.rejected} of its messages are bad: check wiring and baud rate"
    return True, heard.role, text
