"""`rambler example`: write a commented example of a vehicle file."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from firmware_py.cli.errors import print_error
from firmware_py.install.service_files import example

FILE_NAMES = {"wave-glider": "ocean_rambler.toml", "shared-port": "shared_port_volz.toml"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument("file", metavar="FILE", type=Path, help="new file, such as boat.toml; an existing file is kept")
    parser.add_argument(
        "--kind", choices=tuple(FILE_NAMES), default="wave-glider", help="type of boat (default: wave-glider)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the example; return 2 if the file exists."""
    path: Path = arguments.file
    if path.is_dir():
        return print_error("example", f"{path} is a directory; give a file name, such as {path / 'boat.toml'}")
    if os.path.lexists(path):
        return print_error("example", f"{path} exists; give another name")
    text = example(FILE_NAMES[arguments.kind]).read_text(encoding="utf-8")
    path.parent.mkdir(parents=True, exist_ok=True)
    _write_new_file(path, text)
    print(f"wrote {path}")
    print(f"enter your ports and drivers in it, then run: rambler check {path}")
    return 0


def _write_new_file(path: Path, content: str) -> None:
    """Write a new file; on failure remove it and raise OSError with its name."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(content)
    except OSError as error:
        if error.filename is None:  # the write failed, not the opening
            path.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from error
