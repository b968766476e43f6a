"""`rambler energy`: energy supplied and consumed per day in watt-hours, from the thin log."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import asdict

from firmware_py.cli.errors import print_error
from firmware_py.log.daily_energy import Amount, Day, list_thin_logs, read_rows, sum_by_day
from firmware_py.log.dataflash import LogError
from firmware_py.system.state_directory import LOG_DIRECTORY

ESTIMATED_MARK = "~"
_TITLES = {
    "solar": "panels",
    "load": "loads",
    "servo": "servo",
    "rest": "all else",
    "charged": "in",
    "discharged": "out",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("where", metavar="STATE|LOG", nargs="+", type=Path, help="state directory, or thin logs")
    parser.add_argument(
        "--rest-w",
        type=float,
        metavar="W",
        help="power of all loads except the servo (computer, radios, payload), if it is not measured",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Return 0 if the logs have at least one day, 1 if they have none, 2 for an unreadable log or invalid --rest-w."""
    rest_w = arguments.rest_w
    if rest_w is not None and not 0.0 <= rest_w <= 1e5:
        return print_error("energy", "--rest-w must be 0 to 100000 W")
    paths: list[Path] = []
    for path in arguments.where:
        paths += list_thin_logs(path / LOG_DIRECTORY) if path.is_dir() else [path]
    try:
        daily = sum_by_day(read_rows(paths))
    except LogError as error:
        return print_error("energy", error)
    if arguments.json:
        print(json.dumps({"days": [_json_record(day, rest_w) for day in daily]}))
    elif daily:
        print(_format_table(daily, rest_w))
    else:
        print("no energy records yet; run for at least a minute")
    return 0 if daily else 1


def _json_record(day: Day, rest_w: float | None) -> dict[str, Any]:
    amounts = {
        name: None if amount is None else {key: _round(value) for key, value in asdict(amount).items()}
        for name, amount in day.amounts(rest_w).items()
    }
    return {"day": day.name or None, "logged_h": _round(day.logged_s / 3600.0), **amounts, "charge": day.charge}


def _round(value: float) -> float:
    # The flag `estimated` of an amount remains a bool.
    return value if isinstance(value, bool) else round(value, 4)


def _format_table(daily: Sequence[Day], rest_w: float | None) -> str:
    """Return a table of the days with a legend."""
    lines = ["Wh by day (UTC)  hours" + "".join(f"{title:>10}" for title in _TITLES.values()) + "    charge"]
    for day in daily:
        amounts = day.amounts(rest_w)
        charge = "-" if day.charge is None else f"{100.0 * day.charge:.0f} %"
        cells = "".join(f"{_format_cell(amounts[name]):>10}" for name in _TITLES)
        lines.append(f"{day.name or 'no valid clock':<15}{day.logged_s / 3600.0:>7.2f}{cells}{charge:>10}")
    lines.append(f"in, out: battery charge and discharge; {ESTIMATED_MARK} estimated, at least in part; - unknown")
    return "\n".join(lines)


def _format_cell(amount: Amount | None) -> str:
    return "-" if amount is None else f"{ESTIMATED_MARK if amount.estimated else ''}{amount.wh:.2f}"
