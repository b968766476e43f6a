"""`rambler export`: convert a log to tables, MCAP for Foxglove, or tracks for maps."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_py.cli.errors import print_error
from firmware_py.files.packed import SUFFIX
from firmware_py.log.open_file import open_buffer

EXTRA: Final = "rambler-autopilot[export]"
# format -> module and description. Only the module of the format is imported.
FORMATS: Final[Mapping[str, tuple[str, str]]] = {
    "csv": ("table", "one row per tick"),
    "parquet": ("table", "the same, for pandas, polars and DuckDB"),
    "mcap": ("mcap_file", "all messages, for Foxglove, with a layout file"),
    "gpx": ("tracks", "track and waypoints"),
    "kml": ("tracks", "track, mission and fence, for Google Earth and GIS"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("log", metavar="LOG", type=Path, help="onboard log (.BIN or .BIN.gz)")
    descriptions = "; ".join(f"{name}: {text}" for name, (_, text) in FORMATS.items())
    parser.add_argument("--to", required=True, choices=FORMATS, help=descriptions)
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="output file (default: name of the log in the current directory)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Return 0 if the file is written, 1 for a log without ticks (for a track: without positions), 2 for an error."""
    file_format, log = arguments.to, arguments.log
    out = arguments.out or Path(f"{log.name.removesuffix(SUFFIX).removesuffix('.BIN')}.{file_format}")
    if log.exists() and out.exists() and out.samefile(log):
        return print_error("export", f"{out} is the log itself; use another --out")
    partial_path = out.with_name(f"{out.name}.part")
    module = importlib.import_module(f"firmware_py.cli.export.{FORMATS[file_format][0]}")
    try:
        with open_buffer(log) as buffer:
            summary = module.write(file_format, buffer, partial_path, out)
        if not summary:
            partial_path.unlink(missing_ok=True)
            return print_error("export", f"{log}: nothing to export as {file_format}: no tick, or no position", code=1)
        partial_path.replace(out)
    except ImportError as error:
        return print_error("export", f"--to {file_format} needs {error.name}; install {EXTRA}")
    except OSError as error:
        partial_path.unlink(missing_ok=True)
        subject = error.filename or f"{log} to {out}"
        return print_error("export", f"{subject}: {error.strerror or error}; check the log and --out")
    print(f"{out}: {summary}")
    return 0
