"""`rambler listen`: decoded output, rate and errors of each device; does not move the rudder."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from firmware_py.cli.bench_session import BenchSession
from firmware_py.cli.errors import print_error
from firmware_py.system.readings import format_device
from firmware_py.vehicle import VehicleError, load

POLLS_PER_PRINT = 10  # of 0.1 s each


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("vehicle", metavar="VEHICLE.toml", type=Path, help="the vehicle file")
    parser.add_argument("--json", action="store_true", help="print one JSON object per device and second")
    parser.add_argument("--seconds", metavar="N", type=float, help="stop after N seconds (default: on Ctrl-C)")


def run(arguments: argparse.Namespace) -> int:
    """Print the devices once a second; return 1 if a device sent nothing."""
    if arguments.seconds is not None and not 0.0 < arguments.seconds < 1e7:
        return print_error("listen", "--seconds must be a positive number of seconds")
    try:
        session = BenchSession(load(arguments.vehicle))
    except VehicleError as error:
        return print_error("listen", error)
    try:
        for poll, _ in enumerate(session.listen(arguments.seconds), start=1):
            if poll % POLLS_PER_PRINT == 0:
                _print_devices(session, as_json=arguments.json)
    except KeyboardInterrupt:
        pass
    finally:
        session.close()
    return 0 if all(device.sample_count for device in session.devices) else 1


def _print_devices(session: BenchSession, *, as_json: bool) -> None:
    for device in session.devices:
        record = device.record()
        print(json.dumps(record) if as_json else format_device(record), flush=True)
    if not as_json:
        print(flush=True)
