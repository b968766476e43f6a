"""`rambler energy`: what she was given and has taken, in watt-hours a day, from the thin log."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import asdict

from firmware_py.cli.refusal import refused
from firmware_py.log.daily_energy import Amount, Day, days, rows, thin_logs
from firmware_py.log.dataflash import LogError
from firmware_py.system.state_directory import LOG_DIRECTORY

MARK = "~"
_HEADS = {
    "solar": "panels",
    "load": "loads",
    "servo": "servo",
    "rest": "all else",
    "charged": "in",
    "discharged": "out",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("where", metavar="STATE|LOG", nargs="+", type=Path, help="a state directory, or thin logs")
    parser.add_argument(
        "--rest-w",
        type=float,
        metavar="W",
        help="what all but the servo takes, where nobody measures the loads: computer, radios, payload",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object: the days, each with watt-hours")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when there is a day to tell of, 1 when there is none, 2 for what cannot be read."""
    rest_w = arguments.rest_w
    if rest_w is not None and not 0.0 <= rest_w <= 1e5:
        return refused("energy", "--rest-w must be a number of watts from 0 up")
    paths: list[Path] = []
    for where in arguments.where:
        paths += thin_logs(where / LOG_DIRECTORY) if where.is_dir() else [where]
    try:
        told = days(rows(paths))
    except LogError as error:
        return refused("energy", error)
    if arguments.json:
        print(json.dumps({"days": [_record(day, rest_w) for day in told]}))
    elif told:
        print(_table(told, rest_w))
    else:
        print("no thin log tells of any time")
    return 0 if told else 1


def _record(day: Day, rest_w: float | None) -> dict[str, Any]:
    amounts = {
        name: None if amount is None else {key: _rounded(value) for key, value in asdict(amount).items()}
        for name, amount in day.amounts(rest_w).items()
    }
    return {"day": day.name or None, "logged_h": _rounded(day.logged_s / 3600.0), **amounts, "charge": day.charge}


def _rounded(value: float) -> float:
    return value if isinstance(value, bool) else round(value, 4)


def _table(told: Sequence[Day], rest_w: float | None) -> str:
    """Return the days as lines, and what the columns mean."""
    lines = ["Wh by day (UTC)  hours" + "".join(f"{head:>10}" for head in _HEADS.values()) + "    charge"]
    for day in told:
        amounts = day.amounts(rest_w)
        charge = "-" if day.charge is None else f"{100.0 * day.charge:.0f} %"
        cells = "".join(f"{_cell(amounts[name]):>10}" for name in _HEADS)
        lines.append(f"{day.name or 'no right clock':<15}{day.logged_s / 3600.0:>7.2f}{cells}{charge:>10}")
    lines.append(f"in, out: of the battery; {MARK} is estimated, for part or all of the time; - is not known")
    return "\n".join(lines)


def _cell(amount: Amount | None) -> str:
    return "-" if amount is None else f"{MARK if amount.estimated else ''}{amount.wh:.2f}"
