"""`rambler-hil report`: write the page of a boat's logs, or write that of a run again."""

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
        help="onboard logs or a state directory; or the directory of a run, whose report.html and summary.json are"
        " written again",
    )
    parser.add_argument("--out", metavar="FILE", type=Path, help=f"page of the logs (default {PAGE})")


def run(arguments: argparse.Namespace) -> int:
    """Write the page and print its path."""
    first_path = arguments.places[0]
    if arguments.out is None and len(arguments.places) == 1 and (first_path / run_file.NAME).exists():
        with run_directory.locked_directory(first_path):
            figures, report = run_page.make(first_path)
        print(figures_text(figures))
        print(f"report: {report}")
        return 0
    for path in arguments.places:
        if (path / run_directory.TRUTH_FILE).exists() and not (path / run_file.NAME).exists():
            print(
                f"rambler-hil: {path}: no {run_file.NAME}, because an old version made the run: the page shows its"
                " logs only, not the truth",
                file=sys.stderr,
            )
    target = arguments.out or PAGE
    outputs.check("--out", target)
    if target.exists() and any(path.exists() and path.samefile(target) for path in arguments.places):
        raise UsageError(f"--out {target} is one of the logs; give another file")
    field_page.write(arguments.places, target)
    print(f"report: {target}")
    return 0
