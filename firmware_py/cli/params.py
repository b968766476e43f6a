"""`rambler params`: the parameter table; checks a parameter file."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from firmware_py import faults
from firmware_py.params import TABLE, ParameterError, format_value, markdown, parse_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("file", metavar="FILE", type=Path, nargs="?", help="a parameter file to check")
    parser.add_argument("--markdown", action="store_true", help="print params/REFERENCE.md")
    parser.add_argument("--faults", action="store_true", help="print params/FAULTS.md")
    parser.add_argument("--messages", action="store_true", help="print params/MESSAGES.md")


def run(arguments: argparse.Namespace) -> int:
    """Print the table, or check a file and say what it changes."""
    if arguments.markdown or arguments.faults:
        print(markdown() if arguments.markdown else faults.markdown(), end="")
        return 0
    if arguments.messages:
        # Imported here: it draws the whole link in.
        from firmware_py.cli import link_page  # noqa: PLC0415

        print(link_page.markdown(), end="")
        return 0
    if arguments.file is None:
        for row in TABLE:
            print(f"{row.name:<16} {format_value(row.default):>8} {row.unit:<6} {row.text} [{row.allowed()}]")
        return 0
    try:
        values = parse_file(arguments.file.read_text(encoding="utf-8"), str(arguments.file))
    except (OSError, UnicodeDecodeError) as error:
        print(f"rambler params: {arguments.file}: cannot be read: {error}", file=sys.stderr)
        return 2
    except ParameterError as error:
        print(f"rambler params: {error}", file=sys.stderr)
        return 1
    defaults = {row.name: row.default for row in TABLE}
    changed = {name: value for name, value in values.items() if value != defaults[name]}
    for name, value in changed.items():
        print(f"{name:<16} {format_value(defaults[name])} -> {format_value(value)}")
    print(f"{arguments.file}: {len(values)} parameters, all valid; {len(changed)} differ from their defaults")
    return 0
