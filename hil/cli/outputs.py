"""Files that a command writes at its end: looked at before the minutes that it takes, not after."""

from __future__ import annotations

import os
from pathlib import Path

from hil.errors import HilError, UsageError


def check(option: str, path: Path | None) -> None:
    """Raise UsageError when a file that was asked for cannot be written; without a path all is well."""
    if path is None:
        return
    place = path.absolute()
    if not place.parent.is_dir():
        raise UsageError(f"{option} {path}: there is no directory {place.parent}; make it first")
    if place.is_dir():
        raise UsageError(f"{option} {path} is a directory; name a file in it")
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UsageError(f"{option} {path} may not be written; give another")


def write(option: str, path: Path, content: str | bytes) -> None:
    """Write a file, or raise HilError."""
    try:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    except OSError as error:
        raise HilError(f"{option} {path} cannot be written: {error.strerror}; give another") from None
