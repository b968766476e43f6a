"""`rambler-hil compare`: compare controllers in the same seas."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from firmware_py.model.kt import OCEAN_RAMBLER
from hil.bench.machine import circumstances, text_of
from hil.cli import outputs, progress
from hil.errors import UsageError
from hil.lab.compare.runs import AUTOPILOT, OURS, PAPER, PID, Controller, Row, Task, compare, with_price
from hil.report import figure_file
from hil.report.figure_file import entry, key_of, merge, origin
from hil.ship import scenarios
from hil.ship.disturbance_options import DisturbanceError
from hil.sim.goals import GoalError, parse_goals

DEFAULT_SEAS = ("tank", "sea", "swell", "weak")
DEFAULT_GOALS = "0:0,120:60,720:-30"
AFTER_LAST_GOAL_S = 600.0
MAX_SEEDS = 1000
COLUMNS = ("rms deg", "worst", "travel deg/h", "mean deg", "overshoot deg", "within 5 deg, s")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"default {' '.join(DEFAULT_SEAS)}")
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="use seeds 1 to N (default 2)")
    parser.add_argument("--goal", default=DEFAULT_GOALS, metavar="T:DEG,...", help=f'default "{DEFAULT_GOALS}"')
    parser.add_argument(
        "--with",
        metavar="OPTION[=NUMBER:...],...",
        action="append",
        default=[],
        dest="disturbances",
        help="additional disturbances of each sea, as in rambler-hil run",
    )
    parser.add_argument(
        "--only", choices=("paper", "pid", "ours"), nargs="+", help="these controllers (default all three)"
    )
    parser.add_argument(
        "--prices",
        type=float,
        nargs="+",
        default=[],
        metavar="P",
        help="also ours with these values of CTL_PRICE: the trade-off between error and rudder travel",
    )
    parser.add_argument(
        "--limit",
        action="store_true",
        help="also the error of the optimal linear regulator with full knowledge of the sea, at the same rudder travel",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all scores of each seed")
    parser.add_argument(
        "--figures", type=Path, metavar="FILE", help="replace the means in FILE, docs/figures.json, which the pages use"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the comparison, print the tables and write the files."""
    task = _task(arguments)
    outputs.check("--json", arguments.json)
    figure_file.check("--figures", arguments.figures)
    if not all(0.1 <= price <= 10.0 for price in arguments.prices):
        raise UsageError("--prices: give numbers from 0.1 to 10")
    controllers_by_name = {"paper": PAPER, "pid": PID, "ours": OURS}
    selected: list[Controller] = [controllers_by_name[name] for name in arguments.only or controllers_by_name]
    with progress.progress_line(sys.stderr, time.monotonic) as report:
        controllers = [*selected, *map(with_price, arguments.prices)]
        rows = compare(task, controllers, lambda done, total, last: report(done, total, done, last))
    limits = _limits(rows) if arguments.limit else None
    print(text(rows, limits))
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(as_json(rows), indent=2) + "\n", encoding="utf-8")
    if arguments.figures is not None:
        task_words = ("--goal", arguments.goal) if arguments.goal != DEFAULT_GOALS else ()
        command = shlex.join(("rambler-hil", "compare", "--seeds", str(arguments.seeds), *task_words))
        source = origin(command, text_of(circumstances()))
        merge(arguments.figures, as_entries(rows, source, limits))
    return 0


def _limits(rows: list[Row]) -> list[tuple[float, float] | None]:
    """Return the smallest rms errors [deg] at the rudder travel of each row, without and with a receiver.

    None for a sea in which they are unknown.
    """
    from hil.lab.compare.limit import at_travel, is_exact_for, limits  # noqa: PLC0415 - scipy is slow to import

    seas = {row.scenario: scenarios.parse_scenario(row.scenario) for row in rows}
    curves = {
        name: [limits(sea, OCEAN_RAMBLER, receiver=receiver) for receiver in (False, True)]
        for name, sea in seas.items()
        if is_exact_for(sea)
    }

    def limit_of_row(row: Row) -> tuple[float, float] | None:
        if row.scenario not in curves:
            return None
        compass_alone, receiver = (at_travel(curve, row.mean.travel_deg_per_h) for curve in curves[row.scenario])
        return compass_alone, receiver

    return [limit_of_row(row) for row in rows]


def text(rows: list[Row], limits: list[tuple[float, float] | None] | None = None) -> str:
    """Return the tables for the terminal, with the limits beside the rows."""
    width = max(len(row.controller.name) for row in rows)
    seeds = len(rows[0].scores)
    note = f"(mean of {seeds} seeds, and the largest rms; steady from 200 s after a goal)"
    lines = [f"{'':{width}}  {'  '.join(COLUMNS)}   {note}"]
    scenario = ""
    for number, row in enumerate(rows):
        if row.scenario != scenario:
            scenario = row.scenario
            lines.append(f"{scenario}")
        mean = row.mean
        cells = (
            f"{mean.rms_deg:.2f}",
            f"{max(score.rms_deg for score in row.scores):.2f}",
            f"{mean.travel_deg_per_h:.0f}",
            f"{mean.mean_deg:+.2f}",
            f"{mean.overshoot_deg:.1f}",
            f"{mean.near_s:.1f}",
        )
        numbers = "  ".join(f"{cell:>{len(title)}}" for cell, title in zip(cells, COLUMNS, strict=True))
        if limits is not None and (limit := limits[number]) is not None:
            compass_alone, receiver = limit
            numbers += f"   limit {compass_alone:.2f} deg, with a receiver {receiver:.2f}"
        engine_note = "" if row.controller.engine == AUTOPILOT else f"   ({row.controller.engine})"
        lines.append(f"{row.controller.name:{width}}  {numbers}{engine_note}")
    return "\n".join(lines)


def as_json(rows: list[Row]) -> list[dict[str, Any]]:
    """Return all results for JSON."""
    return [
        {
            "scenario": row.scenario,
            "controller": row.controller.name,
            "sailed_by": row.controller.engine,
            "settings": dict(row.controller.settings),
            "mean": asdict(row.mean),
            "seeds": [asdict(score) for score in row.scores],
        }
        for row in rows
    ]


def as_entries(
    rows: Sequence[Row], source: Mapping[str, str], limits: Sequence[tuple[float, float] | None] | None = None
) -> dict[str, dict[str, Any]]:
    """Return the means for docs/figures.json, one figure for each sea, controller and column."""
    entries = {}
    for row, limit in zip(rows, limits or [None] * len(rows), strict=True):
        mean = row.mean
        values = {
            "rms": (mean.rms_deg, "deg"),
            "travel": (mean.travel_deg_per_h, "deg/h"),
            "mean": (mean.mean_deg, "deg"),
            "overshoot": (mean.overshoot_deg, "deg"),
            "near": (mean.near_s, "s"),
        }
        if limit is not None:
            values |= {"limit_compass": (limit[0], "deg"), "limit_receiver": (limit[1], "deg")}
        for column, (value, unit) in values.items():
            if math.isfinite(value):
                name = key_of("compare", row.scenario, row.controller.name, column)
                entries[name] = entry(value, unit, source, note=f"{len(row.scores)} seeds")
    return entries


def _task(arguments: argparse.Namespace) -> Task:
    names = tuple(arguments.scenarios) or DEFAULT_SEAS
    if disturbances := ",".join(arguments.disturbances):
        names = tuple(f"{name}+{disturbances}" for name in names)
    try:
        for name in names:
            scenarios.parse_scenario(name)
        goals = parse_goals(arguments.goal)
    except (scenarios.UnknownScenarioError, DisturbanceError, GoalError) as error:
        raise UsageError(str(error)) from None
    if not 1 <= arguments.seeds <= MAX_SEEDS:
        raise UsageError(f"--seeds {arguments.seeds}: give a whole number from 1 to {MAX_SEEDS}")
    return Task(names, tuple(range(1, arguments.seeds + 1)), goals, goals[-1].t_s + AFTER_LAST_GOAL_S)
