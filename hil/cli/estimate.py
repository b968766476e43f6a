"""`rambler-hil estimate`: run the estimators and monitors of the autopilot over a recording."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from hil.cli import outputs, progress
from hil.lab.estimate import boat, log_file, table_file
from hil.lab.estimate.judgement import judge
from hil.lab.estimate.page import page_of
from hil.lab.estimate.predictions import predict
from hil.lab.estimate.recording import Recording, check_interval
from hil.lab.estimate.summary import Result, as_csv, as_json, lines_of, table_of
from hil.lab.estimate.tick import run_ticks
from hil.sim.vehicle_file import load

EPILOG = """\
TABLE: columns time_s and heading_deg (or _rad), and optionally rudder_deg, yaw_rate_deg_s, speed_m_s (through the
water), sog_m_s, cog_deg, lat_deg, lon_deg and goal_deg; cells may be empty. LOG: a log of the autopilot or of ArduPilot
(.BIN, .BIN.gz).

The autopilot's own tick runs at each heading, armed, with the recorded goal or else the mean heading of a minute. Its
rudder command has no effect: estimators and monitors use the recorded rudder angle."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    parser.add_argument("recording", metavar="TABLE|LOG", type=Path, help="recording of a boat under way")
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="vehicle file with the parameters of the boat")
    parser.add_argument("--params", type=Path, metavar="FILE", help="parameter file; replaces values of the vehicle")
    parser.add_argument(
        "--ship",
        metavar="K=..,T=..,alpha=..,speed=..",
        help="K-T model in 1/s, s, s^2 and its speed in m/s; replaces the values of the files; default of speed: the "
        "recorded mean speed",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the estimates as CSV, a row for each heading")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the summary as JSON (-: standard output)")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write a page (.html)")


def run(arguments: argparse.Namespace) -> int:
    """Run the estimators, print the summary and write the files."""
    to_stdout = arguments.json is not None and str(arguments.json) == "-"
    outputs.check("--out", arguments.out)
    outputs.check("--json", None if to_stdout else arguments.json)
    outputs.check("--page", arguments.page)
    ship = {} if arguments.ship is None else boat.read_ship(arguments.ship)
    overrides = dict(load(arguments.vehicle).parameters) if arguments.vehicle is not None else {}
    if arguments.params is not None:
        overrides |= boat.read_parameters(arguments.params)
    recording = _read(arguments.recording)
    parameters, notes = boat.parameters_for(recording, overrides, ship)
    report = progress.task_progress(sys.stderr, time.monotonic)
    estimates = run_ticks(parameters, recording, lambda done, total: report("estimating", done / total))
    predictions = predict(estimates)
    result = Result(recording, parameters, estimates, judge(estimates, predictions), (*recording.notes, *notes))
    figures = as_json(result)
    if arguments.out is not None:
        outputs.write("--out", arguments.out, as_csv(table_of(recording.time_s, estimates, predictions)))
    if arguments.json is not None:
        text = json.dumps(figures, indent=1) + "\n"
        sys.stdout.write(text) if to_stdout else outputs.write("--json", arguments.json, text)
    if arguments.page is not None:
        outputs.write("--page", arguments.page, page_of(result, predictions, figures))
    if not to_stdout:
        print("\n".join(lines_of(figures)))
    return 0


def _read(path: Path) -> Recording:
    recording = log_file.read(path) if log_file.is_log(path) else table_file.read(path)
    check_interval(recording)
    return recording
