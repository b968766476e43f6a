"""`rambler report`: the page of a boat's own logs, made by the harness; its extra is not needed."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("places", metavar="LOG|STATE", nargs="+", help="onboard logs, or a state directory")
    parser.add_argument("--out", metavar="FILE", help="where to write (default report.html)")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when the page is written, else as the harness does."""
    words = [] if arguments.out is None else ["--out", arguments.out]
    # The autopilot does not import the harness; it may be asked to do something, as by anybody.
    done = subprocess.run(  # noqa: S603 - words of our own
        [sys.executable, "-m", "hil", "report", *words, "--", *arguments.places],
        check=False,
        stderr=subprocess.PIPE,
        text=True,
        errors="backslashreplace",
    )
    for line in done.stderr.splitlines():  # by the name that was called
        print(re.sub("^rambler-hil: ", "rambler report: ", line), file=sys.stderr)
    return done.returncode
