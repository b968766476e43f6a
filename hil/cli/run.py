"""`rambler-hil run`: the autopilot in a simulated sea."""

from __future__ import annotations

import argparse
import importlib.util
import math
import sys
from dataclasses import replace
from pathlib import Path

from hil.errors import UsageError
from hil.report import run_page, summary
from hil.report.text import figures_text
from hil.ship import scenarios
from hil.ship.extras_table import ExtrasError
from hil.ship.scenarios import Scenario
from hil.sim import runner
from hil.sim.device_factory import COMPASSES, SERVOS
from hil.sim.goals import Goal, GoalError, parse_goals
from hil.sim.ground_station import GUIDED, MODE_NAMES
from hil.sim.runner import RunOptions
from hil.sim.vehicle_file import load, parse_settings, standard_vehicle, with_devices

DEFAULT_GOALS = "0:0,120:60,720:-90"
DEFAULT_SECONDS = 1320.0
SECONDS_AFTER_LAST_GOAL = 300.0
LONGEST_S = 1e7
RUNS = Path("runs")
MODES = {name.lower(): number for number, name in MODE_NAMES.items()}


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
    parser.add_argument(
        "--mode",
        choices=tuple(MODES),
        help="the mode to be set instead of giving headings: auto sails the mission that --state holds",
    )
    parser.add_argument("--state", type=Path, metavar="DIR", help="begin with a copy of this state directory")
    parser.add_argument(
        "--current",
        metavar="M/S:DEG[:HOURS[:ROTARY]]",
        help="another current: strength and where it sets, at the start if it turns; the hours of its tide, and how"
        " much it turns round: 0 (default) to and fro, 1 clockwise at full strength, -1 anticlockwise",
    )
    parser.add_argument(
        "--with",
        metavar="OPTION[=NUMBER:...],...",
        action="append",
        default=[],
        dest="extras",
        help="more that the sea does to her, as in float=0.3:0.6,leeway=8,sway; rambler-hil scenarios lists them",
    )
    parser.add_argument("--compass", choices=tuple(COMPASSES), help="default nmea, or the vehicle file's")
    parser.add_argument("--servo", choices=tuple(SERVOS), help="default dynamixel, or the vehicle file's")
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
    finished = runner.run(options)
    figures = summary.summarise(finished)
    summary.write(figures, options.out / "summary.json")
    report = _page(finished, figures, options.out)
    print(figures_text(figures))
    print(f"report: {report}")
    return 0


def _page(finished: runner.Run, figures: summary.Summary, out: Path) -> str:
    """Write the page, where there is what draws its pictures: a float that tries the box has it not."""
    if importlib.util.find_spec("matplotlib") is None:
        return "none, matplotlib is not installed; pip install 'rambler-autopilot[hil]'"
    return str(run_page.write(finished, figures, out))


def read_options(arguments: argparse.Namespace) -> RunOptions:
    """Check the command line, or raise UsageError."""
    mode = GUIDED if arguments.mode is None else MODES[arguments.mode]
    try:
        scenario = scenarios.named(arguments.scenario)
        goals = parse_goals(arguments.goal or DEFAULT_GOALS) if arguments.goal or mode == GUIDED else ()
    except (scenarios.UnknownScenarioError, GoalError) as error:
        raise UsageError(str(error)) from None
    if arguments.current is not None:
        scenario = _with_current(scenario, arguments.current)
    try:
        if arguments.extras:
            scenario = scenarios.with_extras(scenario, ",".join(arguments.extras))
    except ExtrasError as error:
        raise UsageError(f"--with: {error}") from None
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    if not goals and arguments.seconds is None:
        raise UsageError(f"--mode {arguments.mode} has no end of its own; give --seconds")
    seconds = _seconds(arguments, goals)
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else standard_vehicle()
    vehicle = with_devices(vehicle, arguments.compass, arguments.servo)
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
        goals=_within(goals, seconds) if goals else (),
        vehicle=vehicle,
        settings=parse_settings(arguments.settings),
        links=tuple(arguments.link),
        mode=mode,
        state=arguments.state,
    )


def _with_current(scenario: Scenario, text: str) -> Scenario:
    remedy = 'write M/S:DEG or M/S:DEG:HOURS:ROTARY, as in "0.3:90" or "0.3:90:12.42:0.5"'
    try:
        numbers = [float(piece) for piece in text.split(":")]
    except ValueError:
        numbers = []
    if not 2 <= len(numbers) <= 4:
        raise UsageError(f"--current {text[:40]!r}: {remedy}")
    speed_m_s, toward_deg, hours, rotary = (*numbers, 0.0, 0.0)[:4]
    # Written so that NaN fails the comparisons.
    if not (0.0 <= speed_m_s <= 10.0 and abs(toward_deg) <= 360.0 and 0.0 <= hours <= 1e4 and abs(rotary) <= 1.0):
        raise UsageError(f"--current {text[:40]!r}: a number is out of range; {remedy}")
    return replace(
        scenario,
        current_m_s=speed_m_s,
        current_toward_deg=toward_deg,
        tide_s=hours * 3600.0,
        tide_rotary=rotary,
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
