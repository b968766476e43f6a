"""`rambler export`: a log as a file that other tools open: tables, Foxglove's MCAP, tracks for maps."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from firmware_py.cli.refusal import refused
from firmware_py.files.packed import SUFFIX
from firmware_py.log.open_file import open_buffer

EXTRA: Final = "rambler-autopilot[export]"
# format -> the module that writes it, and what it is; a module is imported only when it is asked for.
FORMATS: Final[Mapping[str, tuple[str, str]]] = {
    "csv": ("table", "a row a tick"),
    "parquet": ("table", "the same, for pandas, polars and DuckDB"),
    "mcap": ("mcap_file", "every message, for Foxglove, with a layout beside it"),
    "gpx": ("tracks", "track and waypoints"),
    "kml": ("tracks", "track, mission and fence, for Google Earth and GIS"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("log", metavar="LOG", type=Path, help="an onboard log (.BIN or .BIN.gz)")
    told = "; ".join(f"{name}: {text}" for name, (_, text) in FORMATS.items())
    parser.add_argument("--to", required=True, choices=FORMATS, help=told)
    parser.add_argument("--out", metavar="FILE", type=Path, help="where to; else here, under the log's name")


def run(arguments: argparse.Namespace) -> int:
    """Exit 0 when it is written, 1 for a log without a tick (or a position, where a track is wanted), 2 on refusal."""
    kind, log = arguments.to, arguments.log
    out = arguments.out or Path(f"{log.name.removesuffix(SUFFIX).removesuffix('.BIN')}.{kind}")
    if log.exists() and out.exists() and out.samefile(log):
        return refused("export", f"{out} is the log itself; give another --out")
    part = out.with_name(f"{out.name}.part")
    module = importlib.import_module(f"firmware_py.cli.export.{FORMATS[kind][0]}")
    try:
        with open_buffer(log) as buffer:
            written = module.write(kind, buffer, part, out)
        if not written:
            part.unlink(missing_ok=True)
            return refused("export", f"{log}: there is nothing in it for {kind}: no tick, or no position", code=1)
        part.replace(out)
    except ImportError as error:
        return refused("export", f"--to {kind} needs {error.name}; install {EXTRA}")
    except OSError as error:
        part.unlink(missing_ok=True)
        what = error.filename or f"{log} to {out}"
        return refused("export", f"{what}: {error.strerror or error}; name a log and a place to write")
    print(f"{out}: {written}")
    return 0
