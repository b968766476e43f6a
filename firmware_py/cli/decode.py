"""`rambler decode`: a capture through the drivers' own decoders."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from firmware_py.cli.refusal import refused
from firmware_py.devices import CAPTURE_FORMATS, decode
from firmware_py.files.reading import read_regular
from firmware_py.sensors.decode import format_text

MOST_BYTES = 256 << 20  # some days of a compass


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("kind", metavar="KIND", choices=CAPTURE_FORMATS, help=" | ".join(CAPTURE_FORMATS))
    parser.add_argument("file", metavar="FILE", type=Path, help="the capture, as it came over the line")
    parser.add_argument("--json", action="store_true", help="one JSON object a line")


def run(arguments: argparse.Namespace) -> int:
    """Print one line for each result."""
    try:
        data = read_regular(arguments.file, MOST_BYTES)
    except OSError as error:
        print(f"rambler decode: {arguments.file}: cannot be read: {error.strerror}", file=sys.stderr)
        return 2
    count = 0
    for result in decode(arguments.kind, data):
        print(json.dumps(result) if arguments.json else format_text(result))
        count += 1
    if not count:
        return refused("decode", f"{arguments.file}: nothing of {arguments.kind} in its {len(data)} bytes", code=0)
    return 0
