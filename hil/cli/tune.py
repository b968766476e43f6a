"""`rambler-hil tune`: tune the default controller or the paper's fixed gains with the artificial fish swarm."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from pathlib import Path

from firmware_py.common.parameters import ParameterSet
from firmware_py.vehicle import Vehicle
from hil.cli import outputs, progress
from hil.errors import UsageError
from hil.lab.tune import cases, delivered, delivered_report, delivered_search, law, paper
from hil.lab.tune.report import Report, as_json, parameter_file, text
from hil.lab.tune.search import tune
from hil.lab.tune.trials import Setting, Trials
from hil.ship import scenarios
from hil.ship.disturbance_options import DisturbanceError
from hil.sim.vehicle_file import load, model_of, standard_vehicle

EVALUATIONS, FIXED_EVALUATIONS = 60, 400
MIN_EVALUATIONS, MIN_FIXED_EVALUATIONS = 20, 150
EPILOG = """\
The default controller (CTL_PRICE and RUD_DBAND_DEG) is tuned in the compiled loop (hil/lab/twin), whose rudder
commands equal those of the autopilot to the last bit. A sea may have disturbances of its own, for example
"swell+float=0.3:0.6,leeway=8". The choice is checked in fresh seas (other seeds); if it is not better there, too, the
defaults are kept.

The JSON file contains:
  seeds, fresh_seeds, scenarios, ships   the trial runs
  delivered   error (1 by definition) and travel_deg_per_h of the defaults over all cases
  chosen      the same for the choice, travel relative to the defaults, why, kept_as_delivered, parameters
  fresh_seas  both with other waves and noise
  tried       every setting of the search
  cases       errors and rudder travel of both for each sea, ship and fresh seed
  evaluations, trial_runs, seconds

--law searches the four constants of firmware_py/control/law.py over the seas and ships of the proofs. Its JSON file
contains seeds, fresh_seeds, delivered, found, cost and fresh_cost relative to the present constants, better,
evaluations, and error and rudder travel of both for each of fresh_seas.

--fixed-gains tunes the paper's S-surface with the fixed-gain observer (hil/lab/tune/loop_kernel.py): k1, k2, EST_TAU_S
and RUD_DBAND_DEG. Its parameter file switches the default controller off. Its JSON file contains:
  paper       for steps of 30 and 90 deg: k1, k2 and itae_deg_s2 of the optimum, results of the paper's gains
  reference   error (1 by definition) and travel_deg_per_h of the paper's gains over all cases
  chosen      k1, k2, tau_s, deadband_deg; error and worst_error relative to the reference; why; parameters
  fresh_seas  the chosen setting with other waves and noise
  front       the Pareto front of error and rudder travel
  cases       errors of paper's gains and chosen setting for each sea, speed, K_factor and T_factor
  switched_off  rms_error_deg and rudder_travel_deg_per_h of the default controller and of this one in each sea
  evaluations, trial_runs, seconds"""
FRESH_SEED = 1_000_003  # added to the seed for the fresh seas


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    names = ", ".join(row.name for row in scenarios.TABLE)
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="vehicle file: model, limits and present gains")
    parser.add_argument(
        "--scenarios",
        nargs="+",
        default=None,
        metavar="NAME",
        help=f"seas of the trial runs: {names} (default {' '.join(cases.DEFAULT_SCENARIOS)}; "
        f"with --law {len(law.SEAS)} seas and ships)",
    )
    parser.add_argument(
        "--with", dest="disturbances", metavar="OPTIONS", help="disturbances for all scenarios, as in `run --with`"
    )
    parser.add_argument(
        "--fixed-gains",
        action="store_true",
        help="tune the paper's S-surface with fixed gains; its parameter file switches the default controller off",
    )
    parser.add_argument(
        "--law",
        action="store_true",
        help="search the constants of the control law, which are the same for every vehicle",
    )
    parser.add_argument(
        "--price",
        type=float,
        metavar="P",
        help="weight of rudder travel against error, both relative to the defaults or to the paper's gains (0: error "
        "only; 1: equal weights); default: neither larger than with the defaults, or the knee of the front; with --law "
        f"in deg^2 per deg/h (default {law.PRICE:g})",
    )
    parser.add_argument(
        "--only-gains",
        action="store_true",
        help="with --fixed-gains: search k1 and k2 only, not EST_TAU_S and RUD_DBAND_DEG",
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        metavar="N",
        help=f"number of settings (default {EVALUATIONS}); with --fixed-gains for each of about six prices "
        f"(default {FIXED_EVALUATIONS})",
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="random seed of waves, noise and fish (default 1)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write a plot (.png) and a page (.html)")
    parser.add_argument("--out-params", type=Path, metavar="FILE", help="write the chosen parameters")


def run(arguments: argparse.Namespace) -> int:
    """Tune, print the report and write the files."""
    _check(arguments)
    if arguments.law:
        return _run_law(arguments)
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else standard_vehicle()
    return _run_fixed(vehicle, arguments) if arguments.fixed_gains else _run_delivered(vehicle, arguments)


def _run_law(arguments: argparse.Namespace) -> int:
    """Search the constants of the law; they are part of the code, so no parameter file is written."""
    report_progress, first = progress.task_progress(sys.stderr, time.monotonic), arguments.seed + law.FIRST_SEED
    price = law.PRICE if arguments.price is None else arguments.price
    try:
        trials, fresh = (
            law.LawTrials(arguments.scenarios, range(begin, begin + count), price)
            for begin, count in ((first, law.SEEDS), (first + FRESH_SEED, law.FRESH_SEEDS))
        )
    except (scenarios.UnknownScenarioError, DisturbanceError) as error:
        raise UsageError(f"--scenarios: {error}") from None
    found = law.search(trials, fresh, arguments.evaluations or EVALUATIONS, arguments.seed, report_progress)
    report_progress("", 1.0)
    print(law.text(trials, fresh, found))
    if arguments.json is not None:
        outputs.write("--json", arguments.json, json.dumps(law.as_json(trials, fresh, found), indent=2) + "\n")
    return 0


def _run_delivered(vehicle: Vehicle, arguments: argparse.Namespace) -> int:
    report = delivered_of(vehicle, arguments)
    print(delivered_report.text(report))
    if arguments.out_params is not None:
        outputs.write("--out-params", arguments.out_params, delivered_report.parameter_file(report))
        print(f"parameters: {arguments.out_params}")
    if arguments.json is not None:
        outputs.write("--json", arguments.json, json.dumps(delivered_report.as_json(report), indent=2) + "\n")
    if arguments.plot is not None:
        from hil.lab.tune import delivered_page  # noqa: PLC0415 - matplotlib is slow to import and not always needed

        picture, html = delivered_page.write(report, arguments.plot)
        print(f"picture: {picture}, page: {html}")
    return 0


def delivered_of(vehicle: Vehicle, arguments: argparse.Namespace) -> delivered_report.Report:
    """Tune the default controller, or raise UsageError."""
    begin_s = time.monotonic()
    parameters, seed, report_progress = (
        _parameters_of(vehicle),
        arguments.seed,
        progress.task_progress(sys.stderr, time.monotonic),
    )
    model, names = model_of(vehicle), arguments.scenarios
    try:
        if any(scenarios.parse_scenario(name).disturbances.supply is not None for name in names):
            raise UsageError("--with supply: trial runs do not simulate power; remove it")
        if any(scenarios.parse_scenario(name).disturbances.vessels is not None for name in names):
            raise UsageError("--with vessels: trial runs do not simulate other vessels; remove it")
        trials, fresh = (
            delivered.Trials(model, parameters, names, range(first, first + count))
            for first, count in ((seed, delivered.SEEDS), (seed + FRESH_SEED, delivered.FRESH_SEEDS))
        )
    except (scenarios.UnknownScenarioError, DisturbanceError) as error:
        raise UsageError(f"--scenarios: {error}") from None
    except ValueError as error:
        raise UsageError(f"the vehicle file has a model that cannot be tuned: {error}") from None
    tuned = delivered_search.tune(
        trials,
        fresh,
        parameters,
        price=arguments.price,
        evaluations=arguments.evaluations or EVALUATIONS,
        seed=seed,
        report_progress=report_progress,
    )
    report_progress("", 1.0)
    seconds = time.monotonic() - begin_s
    notes = _notes(parameters)
    return delivered_report.Report(vehicle.name, seed, tuple(names), trials, fresh, tuned, seconds, notes)


def _notes(parameters: ParameterSet) -> tuple[str, ...]:
    """Return a line for each parameter of the vehicle that the trial runs do not use."""
    usual = ParameterSet()
    other = [name for name in ("LOOP_RATE_HZ", "LOOP_LOCK") if parameters[name] != usual[name]]
    off = [name for name in delivered_report.DELIVERED if parameters[name] == 0.0]
    notes = [f"trial runs use {name} {usual[name]:g}, not the vehicle's {parameters[name]:g}" for name in other]
    notes += [f"the vehicle has {name} 0, the tuned controller needs 1; the parameter file sets it" for name in off]
    return tuple(notes)


def _parameters_of(vehicle: Vehicle) -> ParameterSet:
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        parameters = parameters.replaced(name, value)
    return parameters


def _run_fixed(vehicle: Vehicle, arguments: argparse.Namespace) -> int:
    report = make_report(vehicle, arguments)
    print(text(report))
    if arguments.out_params is not None:
        outputs.write("--out-params", arguments.out_params, parameter_file(report))
        print(f"parameters: {arguments.out_params}")
    if arguments.json is not None:
        outputs.write("--json", arguments.json, json.dumps(as_json(report), indent=2) + "\n")
    if arguments.plot is not None:
        from hil.lab.tune import page  # noqa: PLC0415 - matplotlib is slow to import and not always needed

        picture, html = page.write(report, arguments.plot)
        print(f"picture: {picture}, page: {html}")
    return 0


def make_report(vehicle: Vehicle, arguments: argparse.Namespace) -> Report:
    """Solve the problem of the paper and the practical one, or raise UsageError."""
    begin_s = time.monotonic()
    parameters, seed, report_progress = (
        _parameters_of(vehicle),
        arguments.seed,
        progress.task_progress(sys.stderr, time.monotonic),
    )
    model = model_of(vehicle)
    present = Setting.of(parameters)
    try:
        trials = Trials(model, parameters, arguments.scenarios, seed)
        fresh = Trials(model, parameters, arguments.scenarios, seed + FRESH_SEED)
        studies = tuple(paper.study(step_deg, model, trials.autopilot, seed) for step_deg in paper.STEPS_DEG)
        twin = delivered.Trials(model, parameters, arguments.scenarios, [seed + FRESH_SEED])
    except scenarios.UnknownScenarioError as error:
        raise UsageError(f"--scenarios: {error}") from None
    except ValueError as error:
        raise UsageError(f"the vehicle file has a model that cannot be tuned: {error}") from None
    tuned = tune(
        trials,
        present,
        price=arguments.price,
        only_gains=arguments.only_gains,
        evaluations=arguments.evaluations or FIXED_EVALUATIONS,
        seed=seed,
        report_progress=report_progress,
    )
    report_progress("", 1.0)
    fresh_score = fresh.scores([tuned.chosen.setting])[0]
    seconds = time.monotonic() - begin_s
    return Report(vehicle.name, seed, present, studies, trials, fresh, tuned, fresh_score, twin, seconds)


def _check(arguments: argparse.Namespace) -> None:
    """Check the command line before the search starts."""
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    if arguments.price is not None and not (math.isfinite(arguments.price) and 0.0 <= arguments.price <= 1e6):
        raise UsageError(f"--price {arguments.price}: give a number from 0 to 1e6")
    minimum, number = MIN_FIXED_EVALUATIONS if arguments.fixed_gains else MIN_EVALUATIONS, arguments.evaluations
    if number is not None and not minimum <= number <= 1_000_000:
        raise UsageError(f"--evaluations {number}: give a number from {minimum} to 1000000")
    if arguments.only_gains and not arguments.fixed_gains:
        raise UsageError("--only-gains: the default controller has no gains; add --fixed-gains")
    if arguments.law:
        for option, value in (
            ("--fixed-gains", arguments.fixed_gains), ("--vehicle", arguments.vehicle),
            ("--plot", arguments.plot), ("--out-params", arguments.out_params),
        ):  # fmt: skip
            if value:
                raise UsageError(f"{option}: not used with --law; remove one of them")
    arguments.scenarios = _seas(arguments)
    if arguments.plot is not None and arguments.plot.suffix not in (".png", ".html"):
        raise UsageError(f"--plot {arguments.plot}: the name must end in .png or .html; both files are written")
    for option, path in (
        ("--json", arguments.json), ("--plot", arguments.plot), ("--out-params", arguments.out_params)
    ):  # fmt: skip
        outputs.check(option, path)


def _seas(arguments: argparse.Namespace) -> list[str]:
    """Return the seas with the common disturbances; commas separate names without disturbances of their own."""
    words = arguments.scenarios or (law.SEAS if arguments.law else cases.DEFAULT_SCENARIOS)
    names = [name for word in words for name in ([word] if "+" in word else word.split(",")) if name]
    if not names:
        raise UsageError("--scenarios: name at least one; rambler-hil scenarios lists them")
    if arguments.disturbances is None:
        return names
    if arguments.fixed_gains:
        raise UsageError("--with: not supported by the trial runs of --fixed-gains; remove one of them")
    return [f"{name}{',' if '+' in name else '+'}{arguments.disturbances}" for name in names]
