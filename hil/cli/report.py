"""`rambler-hil report`: the page of a boat's own logs."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path

from hil.cli import outputs
from hil.errors import UsageError
from hil.report import field_page

PAGE = Path("report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "places", metavar="LOG|DIR", nargs="+", type=Path, help="onboard logs, a state directory or that of a run"
    )
    parser.add_argument("--out", metavar="FILE", type=Path, default=PAGE, help=f"where to write (default {PAGE})")


def run(arguments: argparse.Namespace) -> int:
    """Write the page and say where it is."""
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError(
            "matplotlib is not installed; pip install 'rambler-autopilot[hil]', or take the logs where it is"
        )
    outputs.check("--out", arguments.out)
    field_page.write(arguments.places, arguments.out)
    print(f"report: {arguments.out}")
    return 0
