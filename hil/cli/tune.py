"""`rambler-hil tune`: the gains of the heading controller by artificial fish swarm."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path

from firmware_py.common.parameters import ParameterSet
from firmware_py.vehicle import Vehicle
from hil.cli import outputs
from hil.errors import UsageError
from hil.lab.tune import cases, paper
from hil.lab.tune.report import Report, as_json, parameter_file, text
from hil.lab.tune.search import tune
from hil.lab.tune.trials import Setting, Trials
from hil.ship import scenarios
from hil.sim.vehicle_file import load, model_of, standard_vehicle

EVALUATIONS = 400
EPILOG = """\
The JSON holds:
  paper       for a 30 and a 90 deg step: k1, k2 and itae_deg_s2 of the least ITAE, what the paper's gains come to
  reference   error (1 by definition) and travel_deg_per_h of the paper's gains over all cases
  chosen      k1, k2, tau_s, deadband_deg; error and worst_error (of one case) by the reference; why; parameters
  fresh_seas  the chosen setting with other waves and noise
  front       the settings that no other beats in both error and travel
  cases       for each sea, speed, K_factor and T_factor the errors of the paper's gains and of the chosen setting
  evaluations, trial_runs, seconds

What is tried is a copy of the firmware's observer, S-surface and rudder limit (hil/lab/tune/twins.py)."""
FRESH_SEED = 1_000_003  # added to the seed for the seas that the choice is checked in


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    names = ", ".join(row.name for row in scenarios.TABLE)
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="a vehicle file: model, limits, present gains")
    parser.add_argument(
        "--scenarios",
        nargs="+",
        default=list(cases.DEFAULT_SCENARIOS),
        metavar="NAME",
        help=f"seas to be good in, of {names} (default {' '.join(cases.DEFAULT_SCENARIOS)})",
    )
    parser.add_argument(
        "--price",
        type=float,
        metavar="P",
        help="what rudder travel costs against error, both in parts of what the paper's gains come to (0: error "
        "alone; 1: both weigh the same); default: the knee of the front",
    )
    parser.add_argument(
        "--only-gains", action="store_true", help="search k1 and k2 alone, not EST_TAU_S and RUD_DBAND_DEG"
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        default=EVALUATIONS,
        metavar="N",
        help=f"the most settings to try at each of some six prices (default {EVALUATIONS})",
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of waves, noise and fish (default 1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write the picture there (.png, and a .html page)")
    parser.add_argument("--out-params", type=Path, metavar="FILE", help="write the chosen parameters there")


def run(arguments: argparse.Namespace) -> int:
    """Tune, print, and write what was asked for."""
    _check(arguments)
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else standard_vehicle()
    report = make_report(vehicle, arguments)
    print(text(report))
    if arguments.out_params is not None:
        outputs.write("--out-params", arguments.out_params, parameter_file(report))
        print(f"parameters: {arguments.out_params}")
    if arguments.json is not None:
        outputs.write("--json", arguments.json, json.dumps(as_json(report), indent=2) + "\n")
    if arguments.plot is not None:
        from hil.lab.tune import page  # noqa: PLC0415 - matplotlib is slow to import, and not always needed

        picture, html = page.write(report, arguments.plot)
        print(f"picture: {picture}, page: {html}")
    return 0


def make_report(vehicle: Vehicle, arguments: argparse.Namespace) -> Report:
    """Solve the paper's problem and the practical one, or raise UsageError."""
    begin_s = time.monotonic()
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        parameters = parameters.replaced(name, value)
    model, seed = model_of(vehicle), arguments.seed
    present = Setting.of(parameters)
    tell = _tell if sys.stderr.isatty() else _say_nothing
    try:
        trials = Trials(model, parameters, arguments.scenarios, seed)
        fresh = Trials(model, parameters, arguments.scenarios, seed + FRESH_SEED)
        studies = tuple(paper.study(step_deg, model, trials.pilot, seed) for step_deg in paper.STEPS_DEG)
    except scenarios.UnknownScenarioError as error:
        raise UsageError(f"--scenarios: {error}") from None
    except ValueError as error:
        raise UsageError(f"the vehicle file describes no ship that can be tuned: {error}") from None
    tuned = tune(
        trials,
        present,
        price=arguments.price,
        only_gains=arguments.only_gains,
        evaluations=arguments.evaluations,
        seed=seed,
        tell=tell,
    )
    tell("", 1.0)
    fresh_score = fresh.scores([tuned.chosen.setting])[0]
    seconds = time.monotonic() - begin_s
    return Report(vehicle.name, seed, present, studies, trials, fresh, tuned, fresh_score, seconds)


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be, before the minute that it takes, not after."""
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    if arguments.price is not None and not (math.isfinite(arguments.price) and 0.0 <= arguments.price <= 1e6):
        raise UsageError(f"--price {arguments.price}: give a number from 0 to 1e6")
    if not 150 <= arguments.evaluations <= 1_000_000:
        raise UsageError(f"--evaluations {arguments.evaluations}: give a number from 150 to 1000000")
    arguments.scenarios = [name for words in arguments.scenarios for name in words.split(",") if name]
    if not arguments.scenarios:
        raise UsageError("--scenarios: name at least one; rambler-hil scenarios lists them")
    if arguments.plot is not None and arguments.plot.suffix not in (".png", ".html"):
        raise UsageError(f"--plot {arguments.plot}: the name must end in .png or .html; both are written")
    for option, path in (
        ("--json", arguments.json), ("--plot", arguments.plot), ("--out-params", arguments.out_params)
    ):  # fmt: skip
        outputs.check(option, path)


def _tell(what: str, part: float) -> None:
    """Show how far the search is, on one line that is cleared at the end."""
    line = f"\r\x1b[K{100.0 * part:3.0f} %  {what}" if part < 1.0 else "\r\x1b[K"
    print(line, end="", file=sys.stderr, flush=True)


def _say_nothing(_what: str, _part: float) -> None:
    """Show nothing in a pipe."""
