"""`rambler-hil campaign`: many runs drawn from a specification, one of them again, two campaigns side by side."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from hil.cli import progress
from hil.errors import UsageError
from hil.lab.campaign import campaign, store
from hil.lab.campaign.campaign import Crew
from hil.lab.campaign.crew import check_address
from hil.lab.campaign.extra import imported
from hil.sim import run_file
from hil.sim.run_directory import CAMPAIGN, check_free, held

MOST_WORKERS = 1024
JSON = "compare.json"
REPLAY = "replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "words",
        nargs="+",
        metavar="SPEC | replay DIR ROW | compare DIR DIR",
        help="the TOML file that says what each run is drawn from; or one run of a campaign again, alone and in full; "
        "or two campaigns side by side",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where the results are kept")
    parser.add_argument("--resume", action="store_true", help="go on with the campaign in DIR")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one for each core)"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="let the workers of a dask scheduler sail, as in tcp://10.0.0.1:8786"
    )


def run(arguments: argparse.Namespace) -> int:
    """Do what the first word says; any other word is a specification."""
    first, *more = arguments.words
    act, names = ACTS.get(first, (_sail, ()))
    words = more if first in ACTS else arguments.words
    if first not in ACTS:
        names = ("SPEC",)
    if len(words) != len(names):
        raise UsageError(f"{' '.join(arguments.words)[:80]}: give {' or '.join(map(_usage, ('', *ACTS)))}")
    _check(first, words, arguments)
    # Now, and not when the first results are there.
    for package in ("pyarrow", *(("distributed",) if arguments.scheduler is not None else ())):
        imported(package)
    return act(words, arguments)


def _check(first: str, words: Sequence[str], arguments: argparse.Namespace) -> None:
    """UsageError for words that nothing can be done with, whatever is installed and whoever answers."""
    if first == REPLAY:
        _number(words[1])
    if first in ACTS:
        if arguments.resume or arguments.scheduler is not None:
            raise UsageError(f"{first} takes neither --resume nor --scheduler; leave them out")
        return
    if not 1 <= arguments.workers <= MOST_WORKERS:
        raise UsageError(f"--workers {arguments.workers}: give a whole number from 1 to {MOST_WORKERS}")
    if arguments.scheduler is not None:
        check_address(arguments.scheduler)


def _number(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise UsageError(f"{word[:30]!r} is not the number of a run") from None


def _usage(name: str) -> str:
    return " ".join((name, *ACTS[name][1])) if name else "SPEC"


def _sail(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Sail a campaign."""
    crew = Crew(arguments.workers, arguments.scheduler)
    path = Path(words[0])
    spec = campaign.read_spec(path)
    for note in spec.notes:
        print(f"{path}: {note}", file=sys.stderr)
    try:
        with progress.line(sys.stderr, time.monotonic) as tell:
            figures = campaign.run(spec, path.parent.resolve(), arguments.out, crew, tell, resume=arguments.resume)
    except KeyboardInterrupt:
        if (arguments.out / CAMPAIGN).exists():
            print("rambler-hil: interrupted; what is sailed is kept: go on with --resume", file=sys.stderr)
        raise
    print(f"{figures['runs']} runs, {figures['failed']} failed: {arguments.out / store.RUNS}")
    print(f"report: {arguments.out / store.PAGE}")
    return 0


def _replay(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Sail one run of a campaign again; exit 1 when it is not the same."""
    from hil.lab.campaign import replay  # noqa: PLC0415 - the rest does without it

    index = _number(words[1])
    found = replay.replay(Path(words[0]), index, arguments.out)
    for line in found.differences:
        print(f"run {index}: {line}")
    if not found.differences:
        print(f"run {index}: the same to the last bit")
    print(f"report: {found.page}")
    return 1 if found.differences else 0


def _compare(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Compare two campaigns run by run, and write the page and the figures."""
    from hil.lab.campaign import compare, compare_page, table  # noqa: PLC0415 - the rest does without it

    check_free(arguments.out, (CAMPAIGN, run_file.NAME))
    first, second = (table.read(Path(word)) for word in words)
    found = compare.compare(first, second)
    with held(arguments.out):
        store.put(arguments.out / JSON, (json.dumps(compare.as_json(found), indent=2) + "\n").encode())
        store.put(arguments.out / store.PAGE, compare_page.text(first, second, found).encode())
    rows = compare_page.cells(found)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    print(compare_page.lead(first, second, found))
    for line in compare_page.versions_that_differ(first, second):
        print(line)
    for name, *cells in rows:
        print("  ".join((name.ljust(widths[0]), *map(str.rjust, cells, widths[1:]))).rstrip())
    print(f"report: {arguments.out / store.PAGE}")
    return 0


# What the first word can be besides a specification, and what comes behind it.
ACTS: dict[str, tuple[Callable[[Sequence[str], argparse.Namespace], int], tuple[str, ...]]] = {
    REPLAY: (_replay, ("DIR", "ROW")),
    "compare": (_compare, ("DIR", "DIR")),
}
