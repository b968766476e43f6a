"""`rambler example`: a commented vehicle file to begin with."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from firmware_py.cli.refusal import refused
from firmware_py.install.service_files import example

NAMES = {"wave-glider": "ocean_rambler.toml", "shared-port": "shared_port_volz.toml"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "file", metavar="FILE", type=Path, help="where to write it, such as boat.toml; never over a file"
    )
    parser.add_argument("--kind", choices=tuple(NAMES), default="wave-glider", help="which boat (default: wave-glider)")


def run(arguments: argparse.Namespace) -> int:
    """Write the example; 2 where something is there already."""
    path: Path = arguments.file
    if path.is_dir():
        return refused("example", f"{path} is a directory; name a file in it, such as {path / 'boat.toml'}")
    if os.path.lexists(path):
        return refused("example", f"{path} is there already; give another name")
    text = example(NAMES[arguments.kind]).read_text(encoding="utf-8")
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, text)
    print(f"wrote {path}")
    print(f"name your ports and drivers in it, then: rambler check {path}")
    return 0


def _write(path: Path, content: str) -> None:
    """Write a file that is not there yet; OSError with its name, and nothing is left of it."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(content)
    except OSError as error:
        if error.filename is None:  # it was made, and there is no room for it
            path.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error
