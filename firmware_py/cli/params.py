"""`rambler params`: print the parameter table or one row of it; check and write parameter files."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Mapping
from pathlib import Path

from firmware_py.cli import parameter_page
from firmware_py.cli.errors import print_error
from firmware_py.common.parameter_row import Kind, ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import MAX_NAME_LENGTH, format_file, format_value, parse_file, similar_names
from firmware_py.faults import page as faults
from firmware_py.files.reading import read_text
from firmware_py.link.parameters.files import parameter_json
from firmware_py.vehicle import MAX_BYTES

INVALID_FILE = 1  # exit code: errors in the file
_PARAMETER_NAME = re.compile(
    rf"[A-Za-z][A-Za-z0-9_]{{0,{2 * MAX_NAME_LENGTH}}}"
)  # unlike a file name, without dot or slash


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "file", metavar="NAME|FILE", type=Path, nargs="?", help="parameter to explain, or parameter file to check"
    )
    pages = parser.add_mutually_exclusive_group()
    pages.add_argument("--markdown", action="store_true", help="print params/REFERENCE.md")
    pages.add_argument("--faults", action="store_true", help="print params/FAULTS.md")
    pages.add_argument("--messages", action="store_true", help="print params/MESSAGES.md")
    pages.add_argument("--texts", action="store_true", help="print params/TEXTS.md")
    pages.add_argument("--metadata", action="store_true", help="print parameter.json (MAVLink component metadata)")
    parser.add_argument(
        "--save",
        metavar="OUT",
        type=Path,
        help="write all parameters to OUT: the defaults, overridden by FILE",
    )
    parser.add_argument(
        "--format",
        choices=sorted(_FORMATS),
        default="plain",
        help="format of OUT: plain (NAME VALUE, for MAVProxy and Mission Planner) or qgc (QGroundControl)",
    )


def format_qgc_file(values: Mapping[str, float]) -> str:
    """Return the content of a QGroundControl parameter file."""
    header = "# Onboard parameters for Vehicle 1\n#\n# Vehicle-Id Component-Id Name Value Type\n"
    types = {name: int(TABLE[INDEX[name]].kind) for name in values}
    return header + "".join(f"1\t1\t{name}\t{value:.18g}\t{types[name]}\n" for name, value in values.items())


_FORMATS: Mapping[str, Callable[[Mapping[str, float]], str]] = {"plain": format_file, "qgc": format_qgc_file}


def _messages_page() -> str:
    from firmware_py.cli import link_page  # noqa: PLC0415 - it imports the whole link

    return link_page.markdown()


def _texts_page() -> str:
    from firmware_py.cli import text_page  # noqa: PLC0415 - it imports the whole firmware

    return text_page.markdown()


_PAGES: Mapping[str, Callable[[], str]] = {
    "markdown": parameter_page.markdown,
    "faults": faults.markdown,
    "messages": _messages_page,
    "texts": _texts_page,
    "metadata": lambda: f"{parameter_json()}\n",
}


def run(arguments: argparse.Namespace) -> int:
    """Print the table or a page, check a file, or write one; return 1 for errors in the file, 2 for other errors."""
    for name, page in _PAGES.items():
        if getattr(arguments, name):
            if arguments.file is not None or arguments.save is not None:
                return print_error("params", f"--{name} prints the whole page; remove {arguments.file or '--save'}")
            print(page(), end="")
            return 0
    if arguments.file is None and arguments.save is None:
        for row in TABLE:
            print(f"{row.name:<16} {format_value(row.default):>8} {row.unit:<6} {row.text} [{row.allowed_values()}]")
        return 0
    values: dict[str, float] = {}
    if arguments.file is not None:
        try:
            values = parse_file(read_text(arguments.file, MAX_BYTES), str(arguments.file))
        except FileNotFoundError as error:
            if arguments.save is None and _PARAMETER_NAME.fullmatch(str(arguments.file)):
                return _explain(str(arguments.file))
            return print_error("params", f"{arguments.file}: cannot be read: {error.strerror}")
        except OSError as error:
            return print_error("params", f"{arguments.file}: cannot be read: {error.strerror}")
        except ParameterError as error:
            return print_error("params", error, INVALID_FILE)
    return _print_changes(arguments.file, values) if arguments.save is None else _save(arguments, values)


def _explain(name: str) -> int:
    """Print the row of a parameter, or an error with similar names."""
    index = INDEX.get(name.upper())
    if index is None:
        return print_error(
            "params", f"no parameter or file {name!r}; similar parameters: {', '.join(similar_names(name))}"
        )
    row = TABLE[index]
    print(f"{row.name}: {row.text}")
    print(f"default   {format_value(row.default)} {row.unit}".rstrip())
    for number, text in (row.choices or {}).items():
        print(f"{'allowed' if number == min(row.choices or ()) else '':<9} {number} {text}")
    if row.choices is None:
        print(f"allowed   {row.allowed_values()}{', whole numbers' if row.kind is Kind.INTEGER else ''}")
    if row.reboot:
        print("takes effect at the next start")
    if row.read_only:
        print("read-only")
    return 0


def _print_changes(path: Path, values: Mapping[str, float]) -> int:
    """Print the values that differ from their defaults."""
    defaults = {row.name: row.default for row in TABLE}
    changed = {name: value for name, value in values.items() if value != defaults[name]}
    for name, value in changed.items():
        print(f"{name:<16} {format_value(defaults[name])} -> {format_value(value)}")
    print(f"{path}: {len(values)} parameters, all valid; {len(changed)} differ from their defaults")
    return 0


def _save(arguments: argparse.Namespace, values: Mapping[str, float]) -> int:
    """Write all parameters to a file: these values, and defaults for the others."""
    # Without read-only parameters, which a ground station that loads the file must not set.
    rows = [row for row in TABLE if not row.read_only]
    written = {row.name: values.get(row.name, row.default) for row in rows}
    try:
        arguments.save.write_text(_FORMATS[arguments.format](written), encoding="ascii")
    except OSError as error:
        return print_error("params", f"{arguments.save}: cannot be written: {error.strerror}")
    print(f"{arguments.save}: {len(written)} parameters written")
    return 0
