"""Command-line options for scenario, vehicle, seed and adapters."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

from firmware_py.vehicle import Vehicle
from hil.errors import UsageError
from hil.ship import scenarios
from hil.ship.disturbance_options import DisturbanceError
from hil.ship.scenarios import Scenario
from hil.sim.adapters import ADAPTERS
from hil.sim.device_factory import COMPASSES, SERVOS
from hil.sim.goals import Goal, GoalError, parse_goals
from hil.sim.vehicle_file import load, standard_vehicle, with_devices

RUNS = Path("runs")
SCENARIO_NAMES = ", ".join(row.name for row in scenarios.TABLE)


def add_sea_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the common options of all commands with a simulated boat, except the name of the scenario."""
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="random seed (default 1)")
    parser.add_argument(
        "--current",
        metavar="M/S:DEG[:HOURS[:ROTARY]]",
        help="another current: speed and direction it flows to; with a tide its period in hours and its rotation: 0"
        " (default) reverses, 1 turns clockwise at constant speed, -1 anticlockwise",
    )
    parser.add_argument(
        "--with",
        metavar="OPTION[=NUMBER:...],...",
        action="append",
        default=[],
        dest="disturbances",
        help="disturbance options, as in float=0.3:0.6,leeway=8,sway; rambler-hil scenarios lists them",
    )
    parser.add_argument(
        "--compass",
        choices=tuple(COMPASSES),
        help="(default nmea, or that of the vehicle file); bno08x_rvc is added to it, because it knows no north",
    )
    parser.add_argument("--servo", choices=tuple(SERVOS), help="(default dynamixel, or that of the vehicle file)")
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="a vehicle file: devices, model, parameters")


def add_adapter_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the options for devices on serial adapters of this computer."""
    for option, name in ADAPTERS.items():
        text = f"emulate the {name} on this serial adapter of this computer, wired to the float computer's"
        parser.add_argument(f"--{option.replace('_', '-')}", metavar="PORT", help=text)


def adapters_of(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the paths of the adapters by device."""
    paths = {name: getattr(arguments, option) for option, name in ADAPTERS.items()}
    return {name: path for name, path in paths.items() if path is not None}


def sea_of(arguments: argparse.Namespace) -> Scenario:
    """Return the scenario of a command line; raise UsageError for an invalid one."""
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    try:
        scenario = scenarios.find_scenario(arguments.scenario)
    except scenarios.UnknownScenarioError as error:
        raise UsageError(str(error)) from None
    if arguments.current is not None:
        scenario = _with_current(scenario, arguments.current)
    try:
        return (
            scenarios.with_disturbances(scenario, ",".join(arguments.disturbances))
            if arguments.disturbances
            else scenario
        )
    except DisturbanceError as error:
        raise UsageError(f"--with: {error}") from None


def goals_of(text: str) -> tuple[Goal, ...]:
    """Return the goals of a command line, none for an empty text; raise UsageError for an invalid text."""
    try:
        return parse_goals(text) if text else ()
    except GoalError as error:
        raise UsageError(f"--goal: {error}") from None


def vehicle_of(arguments: argparse.Namespace) -> Vehicle:
    """Return the vehicle of a command line; raise UsageError for an invalid file."""
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else standard_vehicle()
    return with_devices(vehicle, arguments.compass, arguments.servo)


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
        scenario, current_m_s=speed_m_s, current_toward_deg=toward_deg, tide_s=hours * 3600.0, tide_rotary=rotary
    )


def seconds_of(seconds: float, max_s: float) -> float:
    """Return the length of a run; raise UsageError if it is not positive or exceeds max_s."""
    if not (math.isfinite(seconds) and 0.0 < seconds <= max_s):
        raise UsageError(f"--seconds {seconds:g}: give a number of seconds up to {max_s:g}")
    return seconds


def hide_from_git(directory: Path) -> None:
    """Create the directory of all runs with a .gitignore; raise UsageError if that fails."""
    try:
        directory.mkdir(exist_ok=True)
        (directory / ".gitignore").write_text("*\n", encoding="ascii")
    except OSError as error:
        raise UsageError(f"output directory {directory}: {error.strerror}; give another --out") from None
