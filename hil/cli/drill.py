"""`rambler-hil drill`: run fault drills and print their outcomes; exit code 1 if any drill fails."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from hil.cli import outputs
from hil.errors import UsageError
from hil.lab.drill.book import BOOK
from hil.lab.drill.cases import MOMENTS, Case, Outcome, cases, sail
from hil.lab.processes import in_process, processes
from hil.report import page
from hil.sim.signals import interruptible

COLUMNS = ("fault", "situation", "reported after, s", "cleared after, s", "largest error, deg", "")
LEAD = (
    "The emulated devices inject each fault, in lockstep with the real autopilot. The table shows the time from "
    "injection to report, from removal to recovery, and the largest heading error in between. Warnings without an "
    "injected cause count as deviations."
)
# Keys of the JSON file that differ from the names in Outcome.
JSON_KEYS = {"report_s": "told_s", "clear_s": "over_s"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("--only", metavar="WORD", action="append", default=[], help="drills with this in their name")
    parser.add_argument("--moment", choices=tuple(MOMENTS), action="append", help="situation of the boat (default all)")
    parser.add_argument("--pairs", action="store_true", help="also all pairs of drills that can be combined")
    parser.add_argument("--list", action="store_true", help="list the drills and exit")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="random seed (default 1)")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="drills at a time (default: number of cores)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the outcomes")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write a self-contained page")


def run(arguments: argparse.Namespace) -> int:
    """Run the drills and print each outcome when it ends, then a summary; return 1 if a drill failed."""
    selected = _select_cases(arguments)
    outputs.check("--json", arguments.json)
    outputs.check("--page", arguments.page)
    if arguments.list:
        print("\n".join(f"{case.name}: {case.moment}" for case in selected))
        return 0
    outcomes = []
    for outcome in _run_cases(selected, arguments.jobs):
        outcomes.append(outcome)
        print(f"{len(outcomes):4d} of {len(selected)}  {'  '.join(_cells(outcome))}".rstrip(), flush=True)
    failed = [outcome for outcome in outcomes if outcome.misses]
    wall_s, sailed_s = sum(item.wall_s for item in outcomes), sum(item.simulated_s for item in outcomes)
    print(f"{len(outcomes)} drills, {len(failed)} failed; {sailed_s / 3600.0:.1f} h simulated in {wall_s:.0f} s")
    if arguments.json is not None:
        rows = [{JSON_KEYS.get(key, key): value for key, value in asdict(outcome).items()} for outcome in outcomes]
        text = json.dumps(rows, indent=2)
        outputs.write("--json", arguments.json, text + "\n")
    if arguments.page is not None:
        outputs.write("--page", arguments.page, _page(outcomes))
    return 1 if failed else 0


def _select_cases(arguments: argparse.Namespace) -> list[Case]:
    if arguments.jobs < 1 or arguments.seed < 0:
        raise UsageError("--jobs and --seed are whole numbers from 1 and from 0 up")
    selected = [
        case
        for case in cases(BOOK, arguments.seed, pairs=arguments.pairs)
        if (not arguments.only or any(word in case.name for word in arguments.only))
        and (not arguments.moment or case.moment in arguments.moment)
    ]
    if not selected:
        raise UsageError("no drill matches; rambler-hil drill --list names them")
    return selected


def _run_cases(selected: Sequence[Case], jobs: int) -> Iterator[Outcome]:
    """Run the cases and yield their outcomes in order."""
    try:
        if jobs == 1:
            with interruptible():
                yield from map(sail, selected)
            return
        with interruptible(), processes(min(jobs, len(selected)), "fork") as pool:
            yield from pool.map(_run_in_process, map(_names_of, selected))
    except KeyboardInterrupt:
        print("rambler-hil: interrupted", file=sys.stderr)
        raise


def _names_of(case: Case) -> tuple[tuple[str, ...], str, int]:
    """Return the names by which another process finds the case, because functions cannot be pickled."""
    return tuple(drill.name for drill in case.drills), case.moment, case.seed


def _run_in_process(names: tuple[tuple[str, ...], str, int]) -> Outcome:
    return in_process(_run_by_names, names)


def _run_by_names(names: tuple[tuple[str, ...], str, int]) -> Outcome:
    drills, moment, seed = names
    return sail(Case(tuple(item for name in drills for item in BOOK if item.name == name), moment, seed))


def _cells(outcome: Outcome) -> tuple[str, ...]:
    return (
        outcome.name,
        outcome.moment,
        _times(outcome.report_s),
        _times(outcome.clear_s),
        f"{outcome.worst_error_deg:.0f}",
        f"FAILED: {'; '.join(outcome.misses)}" if outcome.misses else "",
    )


def _times(times_s: Sequence[float | None]) -> str:
    return ", ".join("-" if t_s is None else f"{t_s:.1f}" for t_s in times_s)


def _page(outcomes: Sequence[Outcome]) -> str:
    failed = sum(bool(outcome.misses) for outcome in outcomes)
    count = f"{len(outcomes)} drills, {failed} failed."
    return page.page(
        "Fault drills", [page.paragraph(f"{LEAD} {count}", "lead"), page.table([COLUMNS, *map(_cells, outcomes)])]
    )
