"""`rambler-hil campaign`: run a campaign, repeat one of its runs, or compare two campaigns."""

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
from hil.lab.campaign.campaign import Workers
from hil.lab.campaign.store import import_extra
from hil.lab.campaign.workers import check_address
from hil.sim import run_file
from hil.sim.run_directory import CAMPAIGN, check_free, locked_directory

MAX_WORKERS = 1024
JSON = "compare.json"
REPLAY = "replay"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "words",
        nargs="+",
        metavar="SPEC | replay DIR ROW | compare DIR DIR",
        help="SPEC: run the campaign that a TOML file specifies; replay: repeat one run with its log and page; "
        "compare: compare two campaigns",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the results")
    parser.add_argument("--resume", action="store_true", help="continue the campaign in DIR")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, metavar="N", help="worker processes (default: one per core)"
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help="run on the workers of a dask scheduler, for example tcp://10.0.0.1:8786"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the command of the first word; any other word is a specification."""
    first_word, *other_words = arguments.words
    action, names = ACTIONS.get(first_word, (_run_campaign, ()))
    words = other_words if first_word in ACTIONS else arguments.words
    if first_word not in ACTIONS:
        names = ("SPEC",)
    if len(words) != len(names):
        raise UsageError(f"{' '.join(arguments.words)[:80]}: give {' or '.join(map(_syntax, ('', *ACTIONS)))}")
    _check(first_word, words, arguments)
    # Checked before the first run, not after it.
    for package in ("pyarrow", *(("distributed",) if arguments.scheduler is not None else ())):
        import_extra(package)
    return action(words, arguments)


def _check(first_word: str, words: Sequence[str], arguments: argparse.Namespace) -> None:
    """Check the command line before packages are imported and connections are made."""
    if first_word == REPLAY:
        _parse_index(words[1])
    if first_word in ACTIONS:
        if arguments.resume or arguments.scheduler is not None:
            raise UsageError(f"{first_word} does not take --resume or --scheduler; remove them")
        return
    if not 1 <= arguments.workers <= MAX_WORKERS:
        raise UsageError(f"--workers {arguments.workers}: give a whole number from 1 to {MAX_WORKERS}")
    if arguments.scheduler is not None:
        check_address(arguments.scheduler)


def _parse_index(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise UsageError(f"{word[:30]!r} is not the number of a run") from None


def _syntax(name: str) -> str:
    return " ".join((name, *ACTIONS[name][1])) if name else "SPEC"


def _run_campaign(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Run a campaign."""
    workers = Workers(arguments.workers, arguments.scheduler)
    path = Path(words[0])
    spec = campaign.read_spec(path)
    for note in spec.notes:
        print(f"{path}: {note}", file=sys.stderr)
    try:
        with progress.progress_line(sys.stderr, time.monotonic) as report:
            figures = campaign.run(spec, path.parent.resolve(), arguments.out, workers, report, resume=arguments.resume)
    except KeyboardInterrupt:
        if (arguments.out / CAMPAIGN).exists():
            print("rambler-hil: interrupted; finished runs are stored, continue with --resume", file=sys.stderr)
        raise
    print(f"{figures['runs']} runs, {figures['failed']} failed: {arguments.out / store.RUNS}")
    print(f"report: {arguments.out / store.PAGE}")
    return 0


def _replay(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Repeat one run of a campaign; return 1 if the results differ."""
    from hil.lab.campaign import replay  # noqa: PLC0415 - only needed here

    index = _parse_index(words[1])
    result = replay.replay(Path(words[0]), index, arguments.out)
    for line in result.differences:
        print(f"run {index}: {line}")
    if not result.differences:
        print(f"run {index}: identical to the last bit")
    print(f"report: {result.page}")
    return 1 if result.differences else 0


def _compare(words: Sequence[str], arguments: argparse.Namespace) -> int:
    """Compare two campaigns run by run, and write the page and the figures."""
    from hil.lab.campaign import compare  # noqa: PLC0415 - only needed here

    check_free(arguments.out, (CAMPAIGN, run_file.NAME))
    first, second = (store.read_results(Path(word)) for word in words)
    result = compare.compare(first, second)
    with locked_directory(arguments.out):
        store.write_file(arguments.out / JSON, (json.dumps(compare.as_json(result), indent=2) + "\n").encode())
        store.write_file(arguments.out / store.PAGE, compare.page_text(first, second, result).encode())
    rows = compare.table_rows(result)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    print(compare.summary(first, second, result))
    for line in compare.changed_versions(first, second):
        print(line)
    for name, *cells in rows:
        print("  ".join((name.ljust(widths[0]), *map(str.rjust, cells, widths[1:]))).rstrip())
    print(f"report: {arguments.out / store.PAGE}")
    return 0


# Commands of the first word, and their arguments.
ACTIONS: dict[str, tuple[Callable[[Sequence[str], argparse.Namespace], int], tuple[str, ...]]] = {
    REPLAY: (_replay, ("DIR", "ROW")),
    "compare": (_compare, ("DIR", "DIR")),
}
