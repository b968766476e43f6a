"""`rambler-hil bench`: what the autopilot and the tools cost and how fast they are on this machine."""

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
from hil.bench.over_time import Kept
from hil.bench.report import as_entries, as_json, table
from hil.bench.setting import Setting, quick, thorough
from hil.cli import outputs, progress
from hil.errors import UsageError
from hil.report import figure_file
from hil.report.figure_file import merge, origin

MOST_REPEATS = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    names = "; ".join(f"{name}: {row.text}" for name, row in TABLE.items())
    parser.add_argument("--quick", action="store_true", help="about three minutes instead of six, and coarser")
    parser.add_argument(
        "--only",
        choices=tuple(TABLE),
        action="append",
        metavar="NAME",
        help=f"one of the measurements; may be given more than once ({names})",
    )
    parser.add_argument(
        "--repeat", type=int, default=1, metavar="N", help="measure each so often and show the middle (default: 1)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there as well")
    parser.add_argument(
        "--figures", type=Path, metavar="FILE", help="write them over those in FILE, docs/figures.json, for the pages"
    )
    parser.add_argument(
        "--against",
        type=Path,
        metavar="FILE",
        help="compare with the figures in FILE that were repeated at least "
        f"{over_time.LEAST_REPEATS} times; exit 1 when a ratio has worsened by more than it scatters",
    )
    parser.add_argument(
        "--dir",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where the autopilots keep their state meanwhile: a directory on the disk to be measured (default: here)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure and print; an aim that is missed is told in the table and is no error."""
    _check(arguments)
    entries = {} if arguments.against is None else figure_file.read("--against", arguments.against)
    baseline = over_time.kept(entries)
    names = tuple(dict.fromkeys(arguments.only or TABLE))
    if arguments.against is not None:
        names = tuple(over_time.measured_in(baseline, names))
    found = circumstances()
    print(text_of(found), flush=True)
    make = quick if arguments.quick else thorough
    # SIGTERM unwinds as Ctrl-C does, so that no autopilot is left running.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with tempfile.TemporaryDirectory(prefix="rambler-bench-", dir=arguments.dir) as directory:
            setting = make(Path(directory).resolve())
            findings = _measured(names, setting, arguments.repeat)
            print(table(tuple(findings.values())), flush=True)
            strange = {where for key in baseline if not same_machine(where := str(entries[key].get("machine")), found)}
            counts = all(same_python(str(entries[key].get("machine")), found) for key in baseline)
            worse = _compared(baseline, findings, setting, sorted(strange), counts=counts)
    finally:
        signal.signal(signal.SIGTERM, before)
    if arguments.json is not None:
        arguments.json.write_text(as_json(tuple(findings.values()), found), encoding="utf-8")
    if arguments.figures is not None:
        how = " --quick" if arguments.quick else ""
        how += f" --repeat {arguments.repeat}" if arguments.repeat > 1 else ""
        merge(arguments.figures, as_entries(findings, origin("rambler-hil bench" + how, text_of(found))))
    return 1 if worse else 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be written to before the minutes that it takes, not after."""
    if not (arguments.dir.is_dir() and os.access(arguments.dir, os.W_OK)):
        raise UsageError(f"--dir {arguments.dir} is no directory that can be written to; give another")
    if not 1 <= arguments.repeat <= MOST_REPEATS:
        raise UsageError(f"--repeat {arguments.repeat} is not between 1 and {MOST_REPEATS}")
    outputs.check("--json", arguments.json)
    figure_file.check("--figures", arguments.figures)


def _measured(names: Sequence[str], setting: Setting, repeats: int) -> dict[str, Finding]:
    """Measure everything so often, once round after the other: a busy minute then falls on one repeat of a figure."""
    found: dict[str, list[Finding]] = {name: [] for name in names}
    tell, most = progress.part_done(sys.stderr, time.monotonic), repeats * len(names)
    for turn in range(repeats):
        for number, name in enumerate(names, start=turn * len(names)):
            tell(f"{number + 1} of {most}: {TABLE[name].text} ...", number / most)
            with tempfile.TemporaryDirectory(dir=setting.directory) as directory:
                found[name].append(TABLE[name].measure(setting.within(Path(directory))))
    tell("", 1.0)
    return {name: over_time.middle(each) for name, each in found.items()}


def _compared(
    baseline: Kept, findings: Mapping[str, Finding], setting: Setting, strange: Sequence[str], *, counts: bool
) -> bool:
    """Print how the figures stand against the baseline; return whether any has worsened, each time it was measured.

    Against a strange machine they are shown and not judged: what is kept says nothing of how machines differ. What is
    counted is judged on any, as long as the Python `counts` alike.
    """
    if not baseline:
        return False
    verdicts = over_time.compare(baseline, findings)
    print("\nAgainst before")
    for verdict in verdicts:
        print(verdict.text, flush=True)
    if strange:
        besides = " but what is counted" if counts else ""
        print(f"  shown only, not judged{besides}: kept on another machine ({'; '.join(strange)})", flush=True)
        verdicts = [each for each in verdicts if each.counted and counts]
    worse = {(each.measurement, each.name) for each in verdicts if each.worse}
    for _ in range(over_time.WORSE_IN_A_ROW - 1):
        if not worse:
            break
        print("\nOnce more, what is worse")
        names = tuple(dict.fromkeys(measurement for measurement, _ in worse))
        again = over_time.compare(baseline, _measured(names, setting, 1))
        for verdict in again:
            if (verdict.measurement, verdict.name) in worse:
                print(verdict.text, flush=True)
        worse &= {(each.measurement, each.name) for each in again if each.worse}
    return bool(worse)
