"""`rambler-hil reproduce`: run the paper's chain on synthetic tank data and compare the results with the paper."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from hil.cli import progress
from hil.errors import UsageError
from hil.lab.reproduce.chain import FULL, QUICK, run_chain
from hil.lab.reproduce.results import results, text
from hil.lab.reproduce.rows import all_match
from hil.sim.run_directory import locked_directory

RUNS = Path("runs")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--out",
        type=Path,
        default=RUNS / "reproduce",
        metavar="DIR",
        help="directory of recordings, runs, plots, page and table (default runs/reproduce)",
    )
    parser.add_argument("--quick", action="store_true", help="shorter manoeuvres and runs, coarser search")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="random seed (default 1)")


def run(arguments: argparse.Namespace) -> int:
    """Run the chain and print the table; return 1 if a row does not match."""
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    out = arguments.out
    try:
        out.mkdir(parents=True, exist_ok=True)
        if out.parent == RUNS:
            (RUNS / ".gitignore").write_text("*\n", encoding="ascii")
    except OSError as error:
        raise UsageError(f"--out {out}: {error.strerror}; give another directory") from None
    report_progress = progress.task_progress(sys.stderr, time.monotonic)
    with locked_directory(out):
        chain = run_chain(QUICK if arguments.quick else FULL, out, arguments.seed, report_progress)
        report_progress("", 1.0)
        chain_results = results(chain)
        print(text(chain_results))
        from hil.lab.reproduce import page  # noqa: PLC0415 - matplotlib is slow to import

        print(f"report: {page.write(chain, chain_results, out)}")
    return 0 if all_match(chain_results.rows) else 1
