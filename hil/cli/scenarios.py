"""`rambler-hil scenarios`: the seas that a run can be made in."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from hil.ship.scenarios import TABLE

COLUMNS = ("name", "U m/s", "wave s", "wave yaw deg", "bias deg", "drift deg", "current m/s", "what it is")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("--json", action="store_true", help="one JSON list instead of a table")


def run(arguments: argparse.Namespace) -> int:
    """Print the table."""
    if arguments.json:
        print(json.dumps([asdict(row) for row in TABLE], indent=2))
        return 0
    rows = [
        (
            row.name,
            f"{row.speed_m_s:g}",
            f"{row.wave_period_s:g}" if row.wave_period_s else "-",
            f"{row.wave_yaw_deg:g}",
            f"{row.bias_deg:g}",
            f"{row.drift_deg:g}",
            f"{row.current_m_s:g}",
            row.text,
        )
        for row in TABLE
    ]
    widths = [max(len(row[column]) for row in (COLUMNS, *rows)) for column in range(len(COLUMNS))]
    for row in (COLUMNS, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    return 0
