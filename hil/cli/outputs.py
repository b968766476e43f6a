"""Output files of a command, checked before work that takes minutes."""

from __future__ import annotations

import os
from pathlib import Path

from hil.errors import HilError, UsageError


def check(option: str, path: Path | None) -> None:
    """Raise UsageError if a requested file cannot be written."""
    if path is None:
        return
    place = path.absolute()
    if not place.parent.is_dir():
        raise UsageError(f"{option} {path}: directory {place.parent} does not exist; create it first")
    if place.is_dir():
        raise UsageError(f"{option} {path} is a directory; name a file in it")
    if not os.access(place if place.exists() else place.parent, os.W_OK):
        raise UsageError(f"{option} {path}: no permission to write; give another")


def write(option: str, path: Path, content: str | bytes) -> None:
    """Write a file, or raise HilError."""
    try:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    except OSError as error:
        raise HilError(f"{option} {path} cannot be written: {error.strerror}; give another") from None
