"""`rambler decode`: decode a capture with the decoders of the drivers."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from firmware_py.cli.errors import print_error
from firmware_py.devices import CAPTURE_FORMATS, find_capture
from firmware_py.files.reading import read_regular
from firmware_py.sensors.decode import format_text

MAX_CAPTURE_BYTES = 256 << 20  # compass data of several days


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "kind",
        metavar="KIND",
        help=f"format of the capture: {' | '.join(CAPTURE_FORMATS)}, or the driver of an installed package",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recorded bytes of the device")
    parser.add_argument("--json", action="store_true", help="print one JSON object per line")


def run(arguments: argparse.Namespace) -> int:
    """Print one line for each message or error of the capture.

    A capture without messages is no failure: it gives a note on standard error and exit code 0.
    """
    try:
        capture = find_capture(arguments.kind)
    except ValueError as error:
        return print_error("decode", str(error))
    try:
        data = read_regular(arguments.file, MAX_CAPTURE_BYTES)
    except OSError as error:
        return print_error("decode", f"{arguments.file}: cannot be read: {error.strerror}")
    count = 0
    for result in capture.decode(data):
        print(json.dumps(result) if arguments.json else format_text(result))
        count += 1
    if not count:
        return print_error(
            "decode", f"{arguments.file}: no {arguments.kind} message in {len(data)} bytes; check KIND", code=0
        )
    return 0
