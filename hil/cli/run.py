"""`rambler-hil run`: the autopilot in a simulated sea."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from hil import scenarios
from hil.errors import UsageError
from hil.goals import Goal, GoalError, parse_goals
from hil.report import page, summary
from hil.report.text import figures_text
from hil.runner import RunOptions, sail
from hil.vehicle_file import COMPASS_DRIVERS, SERVO_DRIVERS, VehicleFile, load, parse_settings

DEFAULT_GOALS = "0:0,120:60,720:-90"
DEFAULT_SECONDS = 1320.0
SECONDS_AFTER_LAST_GOAL = 300.0
LONGEST_S = 1e7
RUNS = Path("runs")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("scenario", metavar="SCENARIO", help=", ".join(row.name for row in scenarios.TABLE))
    parser.add_argument(
        "--speed",
        metavar="real|max|N",
        default="real",
        help="real time (default), as fast as it goes, or N times real time; all but real run in lockstep",
    )
    parser.add_argument(
        "--seconds", type=float, metavar="N", help="length of the run (default: 300 s after the last goal)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of everything that is random (default 1)")
    parser.add_argument(
        "--goal",
        metavar="T:DEG,...",
        help=f'headings in degrees true and when they are given, in seconds (default "{DEFAULT_GOALS}", 1320 s)',
    )
    parser.add_argument("--compass", choices=tuple(COMPASS_DRIVERS), help="default nmea, or the vehicle file's")
    parser.add_argument("--servo", choices=tuple(SERVO_DRIVERS), help="default dynamixel, or the vehicle file's")
    parser.add_argument(
        "--link",
        metavar="URL",
        nargs="+",
        action="extend",
        default=[],
        help="MAVLink links for ground stations, such as udpout:127.0.0.1:14550",
    )
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        nargs="+",
        action="extend",
        default=[],
        dest="settings",
        help="parameters of the autopilot; the ship stays what it is",
    )
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="a vehicle file: devices, model, parameters")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to write (default runs/SCENARIO-SEED)")


def run(arguments: argparse.Namespace) -> int:
    """Make a run, write its figures and its page, print them."""
    options = read_options(arguments)
    done = sail(options)
    figures = summary.summarise(done)
    summary.write(figures, options.out / "summary.json")
    report = page.write(done, figures, options.out)
    print(figures_text(figures))
    print(f"report: {report}")
    return 0


def read_options(arguments: argparse.Namespace) -> RunOptions:
    """Check the command line, or raise UsageError."""
    try:
        scenario = scenarios.named(arguments.scenario)
        goals = parse_goals(arguments.goal or DEFAULT_GOALS)
    except (scenarios.UnknownScenarioError, GoalError) as error:
        raise UsageError(str(error)) from None
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    seconds = _seconds(arguments, goals)
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else VehicleFile()
    vehicle.choose(arguments.compass, arguments.servo)
    out = arguments.out
    if out is None:
        out = RUNS / f"{scenario.name}-{arguments.seed}"
        _hide_from_git(RUNS)
    return RunOptions(
        scenario=scenario,
        seconds=seconds,
        out=out,
        speed=_speed(arguments.speed),
        seed=arguments.seed,
        goals=_within(goals, seconds),
        vehicle=vehicle,
        settings=parse_settings(arguments.settings),
        links=tuple(arguments.link),
    )


def _speed(text: str) -> float | None:
    if text == "real":
        return None
    if text == "max":
        return math.inf
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not (math.isfinite(speed) and 0.0 < speed <= 1e6):
        raise UsageError(f"--speed {text[:30]}: give real, max or how many times real time")
    return speed


def _seconds(arguments: argparse.Namespace, goals: tuple[Goal, ...]) -> float:
    if arguments.seconds is None:
        return DEFAULT_SECONDS if arguments.goal is None else goals[-1].t_s + SECONDS_AFTER_LAST_GOAL
    seconds = float(arguments.seconds)
    if not (math.isfinite(seconds) and 0.0 < seconds <= LONGEST_S):
        raise UsageError(f"--seconds {seconds:g}: give a number of seconds up to {LONGEST_S:g}")
    return seconds


def _within(goals: tuple[Goal, ...], seconds: float) -> tuple[Goal, ...]:
    kept = tuple(goal for goal in goals if goal.t_s < seconds)
    if len(kept) < len(goals):
        print(f"rambler-hil: goals after {seconds:g} s are left out; lengthen with --seconds", file=sys.stderr)
    if not kept:
        raise UsageError(f"no goal before the end at {seconds:g} s; lengthen with --seconds")
    return kept


def _hide_from_git(directory: Path) -> None:
    try:
        directory.mkdir(exist_ok=True)
        (directory / ".gitignore").write_text("*\n", encoding="ascii")
    except OSError as error:
        raise UsageError(f"output directory {directory}: {error.strerror}; give another --out") from None
