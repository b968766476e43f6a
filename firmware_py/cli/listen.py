"""`rambler listen`: what each device says, with its rate and errors; moves nothing."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from firmware_py.cli.bench_session import BenchDevice, BenchSession
from firmware_py.vehicle import VehicleError, load

PRINT_INTERVAL = 10  # of the session's tenths of a second


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="the vehicle file")
    parser.add_argument("--json", action="store_true", help="one JSON object a device and second")
    parser.add_argument("--seconds", metavar="N", type=float, help="end after so long (default: on Ctrl-C)")


def run(arguments: argparse.Namespace) -> int:
    """Listen; exit 1 when a device said nothing."""
    if arguments.seconds is not None and not 0.0 < arguments.seconds < 1e7:
        print("rambler listen: --seconds must be a positive number of seconds", file=sys.stderr)
        return 2
    try:
        session = BenchSession(load(arguments.vehicle))
    except VehicleError as error:
        print(f"rambler listen: {error}", file=sys.stderr)
        return 2
    try:
        for turn, _ in enumerate(session.listen(arguments.seconds), start=1):
            if turn % PRINT_INTERVAL == 0:
                _print(session, as_json=arguments.json)
    except KeyboardInterrupt:
        pass
    finally:
        session.close()
    return 0 if all(device.count for device in session.devices) else 1


def _print(session: BenchSession, *, as_json: bool) -> None:
    for device in session.devices:
        record = _record(device)
        print(json.dumps(record) if as_json else _line(record), flush=True)
    if not as_json:
        print(flush=True)


def _record(device: BenchDevice) -> dict[str, Any]:
    rate_hz = device.rate_hz()
    health = device.health
    return {
        "device": device.role,
        "driver": device.driver_name,
        "port": device.port,
        "state": health.state.name.lower() if health else "absent",
        "rate_hz": None if rate_hz is None else round(rate_hz, 2),
        "accepted": health.accepted if health else 0,
        "rejected": health.rejected if health else 0,
        "error": device.error or (health.text if health else ""),
        **device.values(),
    }


def _line(record: dict[str, Any]) -> str:
    head = ("device", "driver", "port", "state", "rate_hz", "accepted", "rejected", "error")
    rate = "      -" if record["rate_hz"] is None else f"{record['rate_hz']:7.2f}"
    values = "  ".join(
        f"{name} {'-' if value is None else value}" for name, value in record.items() if name not in head
    )
    text = (
        f"{record['device']:<11}{record['driver']:<10}{record['state']:<9}{rate} Hz  "
        f"{record['accepted']} good, {record['rejected']} bad  {values}"
    )
    return f"{text}  [{record['error']}]" if record["error"] else text
