"""`rambler-hil bench`: what the autopilot and the tools cost and how fast they are on this machine."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from hil.bench.circumstances import circumstances, text_of
from hil.bench.figure import Finding
from hil.bench.measurements import TABLE
from hil.bench.report import as_entries, as_json, table
from hil.bench.setting import Setting, quick, thorough
from hil.cli import outputs
from hil.errors import UsageError
from hil.report import figure_file
from hil.report.figure_file import merge, origin


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    names = "; ".join(f"{name}: {row.text}" for name, row in TABLE.items())
    parser.add_argument("--quick", action="store_true", help="some four minutes instead of ten, and coarser")
    parser.add_argument("--only", choices=tuple(TABLE), metavar="NAME", help=f"one of the measurements ({names})")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there as well")
    parser.add_argument(
        "--figures", type=Path, metavar="FILE", help="write them over those in FILE, docs/figures.json, for the pages"
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
    names = tuple(TABLE) if arguments.only is None else (arguments.only,)
    found = circumstances()
    print(text_of(found), flush=True)
    make = quick if arguments.quick else thorough
    # SIGTERM unwinds as Ctrl-C does, so that no autopilot is left running.
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with tempfile.TemporaryDirectory(prefix="rambler-bench-", dir=arguments.dir) as directory:
            findings = _measured(names, make(Path(directory).resolve()))
    finally:
        signal.signal(signal.SIGTERM, before)
    print(table(findings))
    if arguments.json is not None:
        arguments.json.write_text(as_json(findings, found), encoding="utf-8")
    if arguments.figures is not None:
        source = origin("rambler-hil bench" + (" --quick" if arguments.quick else ""), text_of(found))
        merge(arguments.figures, as_entries(dict(zip(names, findings, strict=True)), source))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be written to before the minutes that it takes, not after."""
    if not (arguments.dir.is_dir() and os.access(arguments.dir, os.W_OK)):
        raise UsageError(f"--dir {arguments.dir} is no directory that can be written to; give another")
    outputs.check("--json", arguments.json)
    figure_file.check("--figures", arguments.figures)


def _measured(names: Sequence[str], setting: Setting) -> list[Finding]:
    findings = []
    for number, name in enumerate(names, start=1):
        if sys.stderr.isatty():
            print(f"\r\033[K{number}/{len(names)} {TABLE[name].text} ...", end="", file=sys.stderr, flush=True)
        findings.append(TABLE[name].measure(setting))
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
    return findings
