"""Check of output files before long computations, and their writing."""

from __future__ import annotations

import os
from pathlib import Path

from hil.errors import HilError, UsageError


def check(option: str, path: Path | None) -> None:
    """Raise UsageError if a requested file cannot be written."""
    if path is None:
        return
    absolute_path = path.absolute()
    if not absolute_path.parent.is_dir():
        raise UsageError(f"{option} {path}: directory {absolute_path.parent} does not exist; create it first")
    if absolute_path.is_dir():
        raise UsageError(f"{option} {path} is a directory; name a file in it")
    if not os.access(absolute_path if absolute_path.exists() else absolute_path.parent, os.W_OK):
        raise UsageError(f"{option} {path}: no permission to write; give another")


def write(option: str, path: Path, content: str | bytes) -> None:
    """Write a file; raise HilError if that fails."""
    try:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    except OSError as error:
        raise HilError(f"{option} {path} cannot be written: {error.strerror}; give another") from None
