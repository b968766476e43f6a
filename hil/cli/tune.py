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
    """Search the constants of the law; no parameter file is written, because they are part of the code."""
    report_progress = progress.task_progress(sys.stderr, time.monotonic)
    first_seed = arguments.seed + law.FIRST_SEED
    price = law.PRICE if arguments.price is None else arguments.price
    try:
        trials, fresh_trials = (
            law.LawTrials(arguments.scenarios, range(begin_seed, begin_seed + count), price)
            for begin_seed, count in ((first_seed, law.SEEDS), (first_seed + FRESH_SEED, law.FRESH_SEEDS))
        )
    except (scenarios.UnknownScenarioError, DisturbanceError) as error:
        raise UsageError(f"--scenarios: {error}") from None
    result = law.search(trials, fresh_trials, arguments.evaluations or EVALUATIONS, arguments.seed, report_progress)
    report_progress("", 1.0)
    print(law.text(trials, fresh_trials, result))
    if arguments.json is not None:
        outputs.write("--json", arguments.json, json.dumps(law.as_json(trials, fresh_trials, result), indent=2) + "\n")
    return 0


def _run_delivered(vehicle: Vehicle, arguments: argparse.Namespace) -> int:
    report = tune_delivered(vehicle, arguments)
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


def tune_delivered(vehicle: Vehicle, arguments: argparse.Namespace) -> delivered_report.Report:
    """Tune the default controller; raise UsageError for invalid options."""
    begin_s = time.monotonic()
    parameters, seed = _parameters_of(vehicle), arguments.seed
    report_progress = progress.task_progress(sys.stderr, time.monotonic)
    model, names = model_of(vehicle), arguments.scenarios
    try:
        if any(scenarios.parse_scenario(name).disturbances.supply is not None for name in names):
            raise UsageError("--with supply: trial runs do not simulate power; remove it")
        if any(scenarios.parse_scenario(name).disturbances.vessels is not None for name in names):
            raise UsageError("--with vessels: trial runs do not simulate other vessels; remove it")
        trials, fresh_trials = (
            delivered.Trials(model, parameters, names, range(first_seed, first_seed + count))
            for first_seed, count in ((seed, delivered.SEEDS), (seed + FRESH_SEED, delivered.FRESH_SEEDS))
        )
    except (scenarios.UnknownScenarioError, DisturbanceError) as error:
        raise UsageError(f"--scenarios: {error}") from None
    except ValueError as error:
        raise UsageError(f"the vehicle file has a model that cannot be tuned: {error}") from None
    tuned = delivered_search.tune(
        trials,
        fresh_trials,
        parameters,
        price=arguments.price,
        evaluations=arguments.evaluations or EVALUATIONS,
        seed=seed,
        report_progress=report_progress,
    )
    report_progress("", 1.0)
    seconds = time.monotonic() - begin_s
    notes = _notes(parameters)
    return delivered_report.Report(vehicle.name, seed, tuple(names), trials, fresh_trials, tuned, seconds, notes)


def _notes(parameters: ParameterSet) -> tuple[str, ...]:
    """Return a line for each parameter of the vehicle that the trial runs do not use."""
    defaults = ParameterSet()
    unused_names = [name for name in ("LOOP_RATE_HZ", "LOOP_LOCK") if parameters[name] != defaults[name]]
    disabled_names = [name for name in delivered_report.CONTROLLER_PARAMETERS if parameters[name] == 0.0]
    notes = [
        f"trial runs use {name} {defaults[name]:g}, not the vehicle's {parameters[name]:g}" for name in unused_names
    ]
    notes += [
        f"the vehicle has {name} 0, the tuned controller needs 1; the parameter file sets it" for name in disabled_names
    ]
    return tuple(notes)


def _parameters_of(vehicle: Vehicle) -> ParameterSet:
    parameters = ParameterSet()
    for name, value in vehicle.parameters.items():
        parameters = parameters.replaced(name, value)
    return parameters


def _run_fixed(vehicle: Vehicle, arguments: argparse.Namespace) -> int:
    report = tune_fixed(vehicle, arguments)
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


def tune_fixed(vehicle: Vehicle, arguments: argparse.Namespace) -> Report:
    """Tune the fixed gains for the paper's problem and for the trial runs; raise UsageError for invalid options."""
    begin_s = time.monotonic()
    parameters, seed = _parameters_of(vehicle), arguments.seed
    report_progress = progress.task_progress(sys.stderr, time.monotonic)
    model = model_of(vehicle)
    setting = Setting.of(parameters)
    try:
        trials = Trials(model, parameters, arguments.scenarios, seed)
        fresh_trials = Trials(model, parameters, arguments.scenarios, seed + FRESH_SEED)
        studies = tuple(paper.study(step_deg, model, trials.autopilot, seed) for step_deg in paper.STEPS_DEG)
        twin = delivered.Trials(model, parameters, arguments.scenarios, [seed + FRESH_SEED])
    except scenarios.UnknownScenarioError as error:
        raise UsageError(f"--scenarios: {error}") from None
    except ValueError as error:
        raise UsageError(f"the vehicle file has a model that cannot be tuned: {error}") from None
    tuned = tune(
        trials,
        setting,
        price=arguments.price,
        only_gains=arguments.only_gains,
        evaluations=arguments.evaluations or FIXED_EVALUATIONS,
        seed=seed,
        report_progress=report_progress,
    )
    report_progress("", 1.0)
    fresh_score = fresh_trials.scores([tuned.chosen.setting])[0]
    seconds = time.monotonic() - begin_s
    return Report(vehicle.name, seed, setting, studies, trials, fresh_trials, tuned, fresh_score, twin, seconds)


def _check(arguments: argparse.Namespace) -> None:
    """Check the command line before the search starts."""
    if arguments.seed < 0:
        raise UsageError(f"--seed {arguments.seed}: give a whole number from 0 up")
    if arguments.price is not None and not (math.isfinite(arguments.price) and 0.0 <= arguments.price <= 1e6):
        raise UsageError(f"--price {arguments.price}: give a number from 0 to 1e6")
    minimum, evaluations = MIN_FIXED_EVALUATIONS if arguments.fixed_gains else MIN_EVALUATIONS, arguments.evaluations
    if evaluations is not None and not minimum <= evaluations <= 1_000_000:
        raise UsageError(f"--evaluations {evaluations}: give a number from {minimum} to 1000000")
    if arguments.only_gains and not arguments.fixed_gains:
        raise UsageError("--only-gains: the default controller has no gains; add --fixed-gains")
    if arguments.law:
        for option, value in (
            ("--fixed-gains", arguments.fixed_gains), ("--vehicle", arguments.vehicle),
            ("--plot", arguments.plot), ("--out-params", arguments.out_params),
        ):  # fmt: skip
            if value:
                raise UsageError(f"{option}: not used with --law; remove one of them")
    arguments.scenarios = _scenario_names(arguments)
    if arguments.plot is not None and arguments.plot.suffix not in (".png", ".html"):
        raise UsageError(f"--plot {arguments.plot}: the name must end in .png or .html; both files are written")
    for option, path in (
        ("--json", arguments.json), ("--plot", arguments.plot), ("--out-params", arguments.out_params)
    ):  # fmt: skip
        outputs.check(option, path)


def _scenario_names(arguments: argparse.Namespace) -> list[str]:
    """Return the scenarios with the common disturbances; commas separate names that have no disturbances."""
    texts = arguments.scenarios or (law.SEAS if arguments.law else cases.DEFAULT_SCENARIOS)
    names = [name for word in texts for name in ([word] if "+" in word else word.split(",")) if name]
    if not names:
        raise UsageError("--scenarios: name at least one; rambler-hil scenarios lists them")
    if arguments.disturbances is None:
        return names
    if arguments.fixed_gains:
        raise UsageError("--with: not supported by the trial runs of --fixed-gains; remove one of them")
    return [f"{name}{',' if '+' in name else '+'}{arguments.disturbances}" for name in names]
