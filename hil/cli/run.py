"""`rambler-hil run`: the autopilot in a simulated sea."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from hil.cli.run_end import report_at_end
from hil.cli.sea_arguments import (
    RUNS,
    SCENARIO_NAMES,
    adapters_of,
    add_adapter_arguments,
    add_sea_arguments,
    goals_of,
    hide_from_git,
    sea_of,
    seconds_of,
    vehicle_of,
)
from hil.errors import UsageError
from hil.sim import adapters, run_directory, runner
from hil.sim.goals import Goal
from hil.sim.ground_station import GUIDED, MODE_NAMES
from hil.sim.logbook import RunOptions
from hil.sim.signals import interruptible
from hil.sim.vehicle_file import parse_settings
from hil.sim.view_page import LISTEN

DEFAULT_GOALS = "0:0,120:60,720:-90"
DEFAULT_SECONDS = 1320.0
SECONDS_AFTER_LAST_GOAL = 300.0
MAX_SECONDS = 1e7
PLAY_LINKS = ("udpout:127.0.0.1:14550", "tcpin:127.0.0.1:5760")
MODES = {name.lower(): number for number, name in MODE_NAMES.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("scenario", metavar="SCENARIO", help=SCENARIO_NAMES)
    add_sea_arguments(parser)
    parser.add_argument(
        "--speed",
        metavar="real|max|N",
        default="real",
        help="real: real time (default); max: as fast as possible; N: N times real time. All but real run in lockstep",
    )
    parser.add_argument(
        "--seconds", type=float, metavar="N", help="length of the run (default: 300 s after the last goal)"
    )
    parser.add_argument(
        "--goal",
        metavar="T:DEG,...",
        help=f'headings in degrees true, each set at a time in seconds (default "{DEFAULT_GOALS}", 1320 s)',
    )
    parser.add_argument(
        "--mode", choices=tuple(MODES), help="set this mode instead of goals: auto sails the mission in --state"
    )
    parser.add_argument(
        "--play",
        action="store_true",
        help="steer by ground station: no goals except --goal, and no order is an error; ends with Ctrl-C, --seconds or"
        " a shutdown command",
    )
    parser.add_argument("--state", type=Path, metavar="DIR", help="start with a copy of this state directory")
    parser.add_argument("--out", type=Path, metavar="DIR", help="output directory (default runs/SCENARIO-SEED)")
    _add_autopilot_arguments(parser)


def _add_autopilot_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the options of the autopilot and its links."""
    parser.add_argument(
        "--link",
        metavar="URL",
        nargs="+",
        action="extend",
        default=[],
        help="MAVLink links for ground stations, such as udpout:127.0.0.1:14550; sbd:DIR: an emulated Iridium modem"
        " with its messages in DIR, see sbd-gateway",
    )
    parser.add_argument(
        "--set",
        metavar="NAME=VALUE",
        nargs="+",
        action="extend",
        default=[],
        dest="settings",
        help="parameters of the autopilot; the simulated ship does not change",
    )
    parser.add_argument(
        "--view",
        metavar="HOST:PORT",
        nargs="?",
        const=LISTEN,
        help=f"serve a live page of the run for a browser on this computer (default {LISTEN})",
    )
    add_adapter_arguments(parser)
    parser.add_argument(
        "--remote",
        metavar="HOST|URL",
        help="start no autopilot; send the goals by MAVLink to the one behind the adapters, at tcp:HOST:5760, or at"
        " tcp:, udpout: or udpin:HOST:PORT",
    )


def run(arguments: argparse.Namespace) -> int:
    """Make a run; write and print its summary and page, also if it ends early."""
    options = read_options(arguments)
    if bool(adapters_of(arguments)) != (arguments.remote is not None) or (arguments.remote and options.lockstep):
        raise UsageError("give adapter ports (--compass-port, ...) and --remote together, with --speed real")
    if options.play:
        print(f"the autopilot listens on {' and '.join(options.links)}; Ctrl-C ends the run", flush=True)
    with run_directory.locked_directory(options.out), interruptible(), report_at_end(options.out):
        if arguments.remote is None:
            runner.run(options)
        else:
            adapters.run(options, adapters_of(arguments), arguments.remote)
    return 0


def read_options(arguments: argparse.Namespace) -> RunOptions:
    """Return the options of a command line; raise UsageError for invalid ones."""
    mode = GUIDED if arguments.mode is None else MODES[arguments.mode]
    scenario = sea_of(arguments)
    goals = goals_of(arguments.goal or (DEFAULT_GOALS if mode == GUIDED and not arguments.play else ""))
    if not goals and arguments.seconds is None and not arguments.play:
        raise UsageError(f"--mode {arguments.mode} needs --seconds: without goals the run has no end")
    seconds = _seconds(arguments, goals)
    out = arguments.out
    if out is None:
        out = RUNS / f"{scenario.name}-{arguments.seed}"
        hide_from_git(RUNS)
    return RunOptions(
        scenario=scenario,
        seconds=seconds,
        out=out,
        speed=_speed(arguments.speed),
        seed=arguments.seed,
        goals=_goals_before_end(goals, seconds) if goals else (),
        vehicle=vehicle_of(arguments),
        settings=parse_settings(arguments.settings),
        links=tuple(arguments.link) or (PLAY_LINKS if arguments.play else ()),
        mode=mode,
        state=arguments.state,
        play=arguments.play,
        view=arguments.view,
        cores=2 if arguments.speed == "max" else 1,
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
        raise UsageError(f"--speed {text[:30]}: give real, max or a multiple of real time")
    return speed


def _seconds(arguments: argparse.Namespace, goals: tuple[Goal, ...]) -> float:
    if arguments.seconds is None and arguments.play:
        return MAX_SECONDS
    if arguments.seconds is None:
        return DEFAULT_SECONDS if arguments.goal is None else goals[-1].t_s + SECONDS_AFTER_LAST_GOAL
    return seconds_of(arguments.seconds, MAX_SECONDS)


def _goals_before_end(goals: tuple[Goal, ...], seconds: float) -> tuple[Goal, ...]:
    goals_before_end = tuple(goal for goal in goals if goal.t_s < seconds)
    if len(goals_before_end) < len(goals):
        print(f"rambler-hil: run ends at {seconds:g} s: later goals are ignored; increase --seconds", file=sys.stderr)
    if not goals_before_end:
        raise UsageError(f"no goal before the end of the run at {seconds:g} s; increase --seconds")
    return goals_before_end
