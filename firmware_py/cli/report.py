"""`rambler report`: write a page of logs with `rambler-hil report`; works without the extra [hil]."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("places", metavar="LOG|STATE", nargs="+", help="onboard logs, or a state directory")
    parser.add_argument("--out", metavar="FILE", help="output file (default: report.html)")


def run(arguments: argparse.Namespace) -> int:
    """Return the exit code of `rambler-hil report`: 0 if the page is written."""
    options = [] if arguments.out is None else ["--out", arguments.out]
    # As a process, since the firmware must not import the harness.
    process = subprocess.run(  # noqa: S603 - fixed arguments and paths
        [sys.executable, "-m", "hil", "report", *options, "--", *arguments.places],
        check=False,
        stderr=subprocess.PIPE,
        text=True,
        errors="backslashreplace",
    )
    for line in process.stderr.splitlines():
        print(re.sub("^rambler-hil: ", "rambler report: ", line), file=sys.stderr)
    return process.returncode
