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

from firmware_py.assemble.wiring import base_parameters
from firmware_py.cli.bench_session import BenchDevice, BenchSession
from firmware_py.cli.run import default_state_directory
from firmware_py.common.calendar import is_possible
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.records import DeviceState
from firmware_py.files.making import exact_modes, make_directory
from firmware_py.vehicle import Vehicle, VehicleError, load

LISTEN_S = 3.0
FREE_BYTES_MINIMUM = 100_000_000
SYNC_S_MAXIMUM = 1.0

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
        with exact_modes():
            make_directory(directory)
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
    plausible = is_possible(utc_s)
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
        for device in session.devices:
            yield _check_device(device)
    finally:
        session.close()


def _check_device(device: BenchDevice) -> Finding:
    if device.error:
        return False, device.role, device.error
    if not device.count or device.health is None:
        return False, device.role, f"{device.driver_name} on {device.port}: silent; check power, wiring and baud rate"
    rate_hz = device.rate_hz()
    values = ", ".join(f"{name} {value}" for name, value in device.values().items() if value is not None)
    text = f"{device.driver_name} on {device.port}: {rate_hz or 0.0:.1f} Hz, {values}"
    if device.health.state is DeviceState.FAULTY:
        return False, device.role, f"{text}; {device.health.text}"
    if device.health.rejected > device.health.accepted:
        bad = f"{device.health.rejected} of its messages are bad: check wiring and baud rate"
        return False, device.role, f"{text}; {bad}"
    return True, device.role, text
