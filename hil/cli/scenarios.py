"""`rambler-hil scenarios`: list the scenarios and the disturbance options."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from hil.ship import disturbance_options
from hil.ship.scenarios import TABLE

COLUMNS = ("name", "speed m/s", "wave s", "wave yaw deg", "bias deg", "drift deg", "current m/s", "description")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("--json", action="store_true", help="print the scenarios as a JSON list instead of a table")


def run(arguments: argparse.Namespace) -> int:
    """Print the scenarios and the options."""
    if arguments.json:
        rows_json = [asdict(row) for row in TABLE]
        for row_json in rows_json:
            row_json["extras"] = row_json.pop("disturbances")  # the key that scripts read
        print(json.dumps(rows_json, indent=2))
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
    mixtures = [f"{row.name} has {text}" for row in TABLE if (text := disturbance_options.text_of(row.disturbances))]
    widths = [max(len(row[column]) for row in (COLUMNS, *rows)) for column in range(len(COLUMNS))]
    for row in (COLUMNS, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    print("\n" + "\n".join(mixtures))
    print("\nDisturbances for any scenario: `rambler-hil run SCENARIO --with NAME[=NUMBER:...],...`; default off:\n")
    print(disturbance_options.describe_options())
    return 0
