"""`rambler check`: a preflight; one PASS, WARN or FAIL line for each thing that she needs at sea."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from firmware_py.cli import preflight
from firmware_py.cli.bench_session import BenchDevice, BenchSession
from firmware_py.cli.preflight import Finding, Level
from firmware_py.cli.refusal import refused
from firmware_py.cli.state_owner import state_directory_of
from firmware_py.common.records import DeviceState, FixType, PositionSample
from firmware_py.vehicle import Vehicle, VehicleError, load

LISTEN_S = 3.0
# Of the messages of a device: the first is often cut, as it was under way when the port was opened.
BAD_MESSAGES_ALLOWED, BAD_SHARE_ALLOWED = 2, 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="the vehicle file")
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="the state directory (default: of the service, or the user's)"
    )
    parser.add_argument("--link", metavar="URL", action="append", default=[], help="a link besides those of the file")
    parser.add_argument("--json", action="store_true", help="one JSON object: verdict and findings")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when nothing fails, whatever is warned of, 1 when anything does, 2 when the vehicle file is wrong."""
    try:
        vehicle = load(arguments.vehicle)
        directory = arguments.state or state_directory_of(arguments.vehicle, vehicle)
    except VehicleError as error:
        return refused("check", error)
    worst = Level.PASS
    told = []
    for finding in _findings(vehicle, directory, (*vehicle.link_urls, *arguments.link)):
        worst = max(worst, finding.level, key=list(Level).index)
        if arguments.json:
            told.append(
                {"level": finding.level.value, "subject": finding.subject, "text": finding.text} | finding.values
            )
        else:
            print(f"{finding.level.name}  {finding.subject:<11} {finding.text}", flush=True)
    if arguments.json:
        print(json.dumps({"verdict": worst.value, "findings": told}))
    return int(worst is Level.FAIL)


def _findings(vehicle: Vehicle, directory: Path, urls: tuple[str, ...]) -> Iterator[Finding]:
    parameters = preflight.parameters_in_force(vehicle, directory, lambda _problem: None)  # told by the first look
    return preflight.every(
        lambda: preflight.look_at_parameters(vehicle, directory),
        lambda: preflight.look_at_state(directory),
        lambda: preflight.look_at_storage(directory, parameters),
        preflight.look_at_clocks,
        preflight.look_at_priority,
        lambda: preflight.look_at_links(urls, directory),
        lambda: _look_at_devices(vehicle),
    )


def _look_at_devices(vehicle: Vehicle) -> Iterator[Finding]:
    session = BenchSession(vehicle)
    try:
        for _ in session.listen(LISTEN_S):
            pass
        yield from map(_judge_device, session.devices)
    finally:
        session.close()


def _judge_device(device: BenchDevice) -> Finding:
    where = f"{device.driver_name} on {device.port}"
    health = device.health

    def finding(level: Level, text: str) -> Finding:
        return Finding(level, device.role, text, device.record())

    if device.error:
        return finding(Level.FAIL, device.error)
    if device.role == "ais" and health is not None and not device.count and not health.rejected:
        return finding(Level.WARN, f"{where}: no vessel heard; there may be none, or antenna and baud rate are wrong")
    if not device.count or health is None:
        heard = health.text if health is not None else ""
        return finding(Level.FAIL, f"{where}: {heard or 'silent; check power, wiring and baud rate'}")
    values = ", ".join(f"{name} {value}" for name, value in device.values().items() if value is not None)
    text = f"{where}: {device.rate_hz() or 0.0:.1f} Hz, {values}"
    if health.state is not DeviceState.RUNNING:
        return finding(Level.FAIL, f"{text}; {health.text or health.state.name.lower()}")
    if health.rejected > health.accepted:
        bad = f"{health.rejected} of its messages are bad: check wiring and baud rate"
        return finding(Level.FAIL, f"{text}; {bad}")
    if health.rejected > max(BAD_MESSAGES_ALLOWED, BAD_SHARE_ALLOWED * health.accepted):
        return finding(Level.WARN, f"{text}; {health.rejected} of its messages are bad: check the wiring")
    if isinstance(device.last, PositionSample) and device.last.fix is FixType.NONE:
        return finding(Level.WARN, f"{text}; no fix yet: does the antenna see the sky?")
    return finding(Level.PASS, text)
