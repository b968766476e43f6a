"""`rambler-hil bench`: cost and speed of the autopilot and of the tools on this machine."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from hil.bench import over_time
from hil.bench.figure import Finding
from hil.bench.machine import circumstances, same_machine, same_python, text_of
from hil.bench.measurements import TABLE
from hil.bench.over_time import Baseline
from hil.bench.report import as_entries, as_json, table
from hil.bench.setting import Setting, quick, thorough
from hil.cli import outputs, progress
from hil.errors import UsageError
from hil.report import figure_file
from hil.report.figure_file import merge, origin

MAX_REPEATS = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    names = "; ".join(f"{name}: {row.text}" for name, row in TABLE.items())
    parser.add_argument("--quick", action="store_true", help="coarser: about three minutes instead of six")
    parser.add_argument(
        "--only",
        choices=tuple(TABLE),
        action="append",
        metavar="NAME",
        help=f"one of the measurements; may be given more than once ({names})",
    )
    parser.add_argument(
        "--repeat", type=int, default=1, metavar="N", help="repeat each measurement and report the median (default: 1)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all figures to FILE")
    parser.add_argument(
        "--figures", type=Path, metavar="FILE", help="merge the figures into FILE, docs/figures.json, for the pages"
    )
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FILE",
        help="compare with the figures in FILE that were repeated at least "
        f"{over_time.MIN_REPEATS} times; exit 1 when a ratio is worse by more than its scatter",
    )
    parser.add_argument(
        "--dir",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="directory for the state of the autopilots, on the disk to be measured (default: here)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure and print; return 1 if a figure is worse than in --against. Missed targets are only marked."""
    _check(arguments)
    entries = {} if arguments.against is None else figure_file.read("--against", arguments.against)
    baseline = over_time.baseline_of(entries)
    names = tuple(dict.fromkeys(arguments.only or TABLE))
    if arguments.against is not None:
        names = tuple(over_time.measurements_in(baseline, names))
    machine = circumstances()
    print(text_of(machine), flush=True)
    make_setting = quick if arguments.quick else thorough
    # SIGTERM raises KeyboardInterrupt like Ctrl-C, so that no autopilot keeps running.
    previous_handler = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with tempfile.TemporaryDirectory(prefix="rambler-bench-", dir=arguments.dir) as directory:
            setting = make_setting(Path(directory).resolve())
            findings = _measure(names, setting, arguments.repeat)
            print(table(tuple(findings.values())), flush=True)
            other_machines = {
                baseline_machine
                for key in baseline
                if not same_machine(baseline_machine := str(entries[key].get("machine")), machine)
            }
            same_counts = all(same_python(str(entries[key].get("machine")), machine) for key in baseline)
            is_worse = _compare_with_baseline(
                baseline, findings, setting, sorted(other_machines), same_counts=same_counts
            )
    finally:
        signal.signal(signal.SIGTERM, previous_handler)
    if arguments.json is not None:
        arguments.json.write_text(as_json(tuple(findings.values()), machine), encoding="utf-8")
    if arguments.figures is not None:
        options = " --quick" if arguments.quick else ""
        options += f" --repeat {arguments.repeat}" if arguments.repeat > 1 else ""
        merge(arguments.figures, as_entries(findings, origin("rambler-hil bench" + options, text_of(machine))))
    return 1 if is_worse else 0


def _check(arguments: argparse.Namespace) -> None:
    """Check outputs and options before the long measurements."""
    if not (arguments.dir.is_dir() and os.access(arguments.dir, os.W_OK)):
        raise UsageError(f"--dir {arguments.dir} is not a writable directory; give another")
    if not 1 <= arguments.repeat <= MAX_REPEATS:
        raise UsageError(f"--repeat {arguments.repeat}: give a whole number from 1 to {MAX_REPEATS}")
    outputs.check("--json", arguments.json)
    figure_file.check("--figures", arguments.figures)


def _measure(names: Sequence[str], setting: Setting, repeats: int) -> dict[str, Finding]:
    """Make all measurements in rounds, so that a temporary load affects only one repeat of a figure."""
    findings: dict[str, list[Finding]] = {name: [] for name in names}
    report, total = progress.task_progress(sys.stderr, time.monotonic), repeats * len(names)
    for round_number in range(repeats):
        for number, name in enumerate(names, start=round_number * len(names)):
            report(f"{number + 1} of {total}: {TABLE[name].text} ...", number / total)
            with tempfile.TemporaryDirectory(dir=setting.directory) as directory:
                findings[name].append(TABLE[name].measure(setting.with_directory(Path(directory))))
    report("", 1.0)
    return {name: over_time.median(repeats_of_name) for name, repeats_of_name in findings.items()}


def _compare_with_baseline(
    baseline: Baseline,
    findings: Mapping[str, Finding],
    setting: Setting,
    other_machines: Sequence[str],
    *,
    same_counts: bool,
) -> bool:
    """Print the figures beside the baseline; return True if one is worse in each of its measurements.

    Figures of another machine are printed without a verdict, except counts from a comparable Python (`same_counts`).
    """
    if not baseline:
        return False
    verdicts = over_time.compare(baseline, findings)
    print("\nCompared with the baseline")
    for verdict in verdicts:
        print(verdict.text, flush=True)
    if other_machines:
        except_counts = " except counts" if same_counts else ""
        print(f"  no verdict{except_counts}: baseline of another machine ({'; '.join(other_machines)})", flush=True)
        verdicts = [verdict for verdict in verdicts if verdict.is_count and same_counts]
    worse_names = {(verdict.measurement, verdict.name) for verdict in verdicts if verdict.is_worse}
    for _ in range(over_time.WORSE_IN_A_ROW - 1):
        if not worse_names:
            break
        print("\nRepeated, because worse")
        names = tuple(dict.fromkeys(measurement for measurement, _ in worse_names))
        repeated = over_time.compare(baseline, _measure(names, setting, 1))
        for verdict in repeated:
            if (verdict.measurement, verdict.name) in worse_names:
                print(verdict.text, flush=True)
        worse_names &= {(verdict.measurement, verdict.name) for verdict in repeated if verdict.is_worse}
    return bool(worse_names)
