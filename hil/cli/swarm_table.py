"""`rambler-hil swarm-table`: compare the fish swarm with other searches on standard functions."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from hil.errors import UsageError
from hil.lab.swarm import comparison

MAX_DIMENSIONS = 50
MAX_RUNS = 1000
MAX_EVALUATIONS = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("--dimensions", default="2,5", metavar="D,...", help="numbers of dimensions (default 2,5)")
    parser.add_argument(
        "--evaluations", type=int, default=2000, metavar="N", help="budget of a run per dimension (default 2000)"
    )
    parser.add_argument("--runs", type=int, default=11, metavar="N", help="seeded runs of each search (default 11)")
    parser.add_argument("--json", action="store_true", help="print all errors of all runs as a JSON list")


def run(arguments: argparse.Namespace) -> int:
    """Compare and print."""
    if not 1 <= arguments.runs <= MAX_RUNS:
        raise UsageError(f"--runs {arguments.runs}: give a whole number from 1 to {MAX_RUNS}")
    if not 100 <= arguments.evaluations <= MAX_EVALUATIONS:
        raise UsageError(f"--evaluations {arguments.evaluations}: give a whole number from 100 to {MAX_EVALUATIONS}")
    dimensions = read_dimensions(arguments.dimensions)
    rows = comparison.standard_table(dimensions, arguments.evaluations, arguments.runs)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
    else:
        print(comparison.text(rows, arguments.runs))
    return 0


def read_dimensions(text: str) -> tuple[int, ...]:
    """Parse whole numbers between commas; raise UsageError for an invalid text."""
    words = text.split(",")
    if not all(word.strip().isdecimal() and len(word) < 10 and 2 <= int(word) <= MAX_DIMENSIONS for word in words):
        raise UsageError(f"--dimensions {text[:30]}: give whole numbers from 2 to {MAX_DIMENSIONS}, as 2,5")
    return tuple(int(word) for word in words)
