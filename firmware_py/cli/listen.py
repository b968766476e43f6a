"""`rambler listen`: what each device says, with its rate and errors; moves nothing."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from firmware_py.cli.bench_session import BenchSession
from firmware_py.cli.refusal import refused
from firmware_py.system.readings import device_line
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
        return refused("listen", "--seconds must be a positive number of seconds")
    try:
        session = BenchSession(load(arguments.vehicle))
    except VehicleError as error:
        return refused("listen", error)
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
        record = device.record()
        print(json.dumps(record) if as_json else device_line(record), flush=True)
    if not as_json:
        print(flush=True)
