"""`rambler check`: preflight check; prints one PASS, WARN or FAIL line per finding."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

from firmware_py.cli import preflight
from firmware_py.cli.bench_session import BenchDevice, BenchSession
from firmware_py.cli.errors import print_error
from firmware_py.cli.preflight import Finding, Level
from firmware_py.cli.state_owner import state_directory_of
from firmware_py.common.angles import degrees
from firmware_py.common.records import DeviceState, FixType, HeadingSample, PositionSample
from firmware_py.vehicle import NETWORK, Vehicle, VehicleError, load

LISTEN_TIME_S = 3.0
# Per device. The first message is often incomplete, since the port is opened at any time.
MAX_BAD_MESSAGES, MAX_BAD_FRACTION = 2, 0.05
MAX_TILT_DEG = 45.0  # roll or pitch of a boat on the bench


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="vehicle file")
    parser.add_argument(
        "--state", metavar="DIR", type=Path, help="state directory (default: that of the service, or of the user)"
    )
    parser.add_argument(
        "--link",
        metavar="URL",
        action="append",
        default=[],
        help="a link in addition to those of the vehicle file; may be repeated",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object: verdict and findings")


def run(arguments: argparse.Namespace) -> int:
    """Return 1 if a finding is FAIL, else 0; 2 for a faulty vehicle file."""
    try:
        vehicle = load(arguments.vehicle)
        directory = arguments.state or state_directory_of(arguments.vehicle, vehicle)
    except VehicleError as error:
        return print_error("check", error)
    worst = Level.PASS
    records = []
    for finding in _run_checks(vehicle, directory, (*vehicle.link_urls, *arguments.link)):
        worst = max(worst, finding.level, key=list(Level).index)
        if arguments.json:
            records.append(
                {"level": finding.level.value, "subject": finding.subject, "text": finding.text} | finding.values
            )
        else:
            print(f"{finding.level.name}  {finding.subject:<11} {finding.text}", flush=True)
    if arguments.json:
        print(json.dumps({"verdict": worst.value, "findings": records}))
    return int(worst is Level.FAIL)


def _run_checks(vehicle: Vehicle, directory: Path, urls: tuple[str, ...]) -> Iterator[Finding]:
    # check_parameters reports the problems.
    parameters = preflight.parameters_in_force(vehicle, directory, lambda _problem: None)
    return preflight.chain_checks(
        lambda: preflight.check_drivers(vehicle),
        lambda: preflight.check_parameters(vehicle, directory),
        lambda: preflight.check_state(directory),
        lambda: preflight.check_storage(directory, parameters),
        preflight.check_clocks,
        preflight.check_priority,
        lambda: preflight.check_links(urls, directory),
        lambda: _check_devices(vehicle),
    )


def _check_devices(vehicle: Vehicle) -> Iterator[Finding]:
    session = BenchSession(vehicle)
    try:
        for _ in session.listen(LISTEN_TIME_S):
            pass
        yield from map(check_device, session.devices)
    finally:
        session.close()


def check_device(device: BenchDevice) -> Finding:
    """Return the finding of a device after listening to it."""
    label = f"{device.driver_name} on {device.port}"
    health = device.health

    def finding(level: Level, text: str) -> Finding:
        return Finding(level, device.role, text, device.record())

    if device.error:
        return finding(Level.FAIL, device.error)
    if device.role == "ais" and health is not None and not device.sample_count and not health.rejected:
        return finding(Level.WARN, f"{label}: no vessel received; check antenna and baud rate if vessels are near")
    if device.role in ("wind", "depth") and health is not None and not device.sample_count and health.accepted:
        return finding(Level.WARN, f"{label}: {health.text}; check the sensor if it should measure now")
    if not device.sample_count or health is None:
        return finding(Level.FAIL, f"{label}: {_explain_silence(device)}")
    values = ", ".join(f"{name} {value}" for name, value in device.values().items() if value is not None)
    text = f"{label}: {device.rate_hz() or 0.0:.1f} Hz, {values}"
    if health.state is not DeviceState.RUNNING:
        return finding(Level.FAIL, f"{text}; {health.text or health.state.name.lower()}")
    if health.rejected > health.accepted:
        return finding(Level.FAIL, f"{text}; {health.rejected} bad messages; check wiring and baud rate")
    if health.rejected > max(MAX_BAD_MESSAGES, MAX_BAD_FRACTION * health.accepted):
        return finding(Level.WARN, f"{text}; {health.rejected} bad messages; check the wiring")
    if isinstance(device.last_sample, PositionSample) and device.last_sample.fix is FixType.NONE:
        return finding(Level.WARN, f"{text}; no fix yet; check that the antenna has a clear view of the sky")
    if isinstance(device.last_sample, HeadingSample) and _tilt_deg(device.last_sample) > MAX_TILT_DEG:
        return finding(Level.WARN, f"{text}; the boat seems to lie on its side; check the mounting of the compass")
    return finding(Level.PASS, text)


def _explain_silence(device: BenchDevice) -> str:
    """Return why a device has no sample, and what to check."""
    text = "" if device.health is None else device.health.text
    if text and not text.startswith("no reply"):
        return text
    by_network = device.port.startswith(NETWORK)
    checks = "the address and the device that sends to it" if by_network else "power, wiring and baud rate"
    return f"{text or 'silent'}; check {checks}"


def _tilt_deg(sample: HeadingSample) -> float:
    """Return the larger one of roll and pitch, 0 for a compass without them."""
    return max(abs(degrees(angle_rad or 0.0)) for angle_rad in (sample.roll_rad, sample.pitch_rad))
