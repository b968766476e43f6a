"""`rambler-hil report`: the page of a boat's own logs, or of a run, made anew."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hil.cli import outputs
from hil.errors import UsageError
from hil.report import field_page, run_page
from hil.report.text import figures_text
from hil.sim import run_directory, run_file

PAGE = Path("report.html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "places",
        metavar="LOG|DIR",
        nargs="+",
        type=Path,
        help="onboard logs or a state directory; or the directory of a run, in which report.html and summary.json are"
        " made anew",
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help=f"where to write the page of logs (default {PAGE})")


def run(arguments: argparse.Namespace) -> int:
    """Write the page and say where it is."""
    first = arguments.places[0]
    if arguments.out is None and len(arguments.places) == 1 and (first / run_file.NAME).exists():
        with run_directory.locked_directory(first):
            figures, report = run_page.make(first)
        print(figures_text(figures))
        print(f"report: {report}")
        return 0
    for place in arguments.places:
        if (place / run_directory.TRUTH_FILE).exists() and not (place / run_file.NAME).exists():
            print(
                f"rambler-hil: {place} has no {run_file.NAME}, as the version that sailed it kept none: the page shows"
                " what its logs tell, and nothing of the truth",
                file=sys.stderr,
            )
    target = arguments.out or PAGE
    outputs.check("--out", target)
    if target.exists() and any(place.exists() and place.samefile(target) for place in arguments.places):
        raise UsageError(f"--out {target} is a log that the page is made of; give another")
    field_page.write(arguments.places, target)
    print(f"report: {target}")
    return 0
