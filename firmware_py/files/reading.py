"""Opens and reads regular files up to a size limit.

Pipes and devices are refused, because opening them may block or have effects, and reading may never end.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Collection
from pathlib import Path
from typing import Any

# Errors of entries that cannot be used: not a regular file, too large, or not readable.
UNUSABLE = (errno.EINVAL, errno.EISDIR, errno.EFBIG, errno.ELOOP, errno.ENXIO, errno.EACCES)
_CHUNK_BYTES = 1 << 20
MAX_DEPTH, MAX_NUMBER = 12, 1e15
_KIND_TEXTS = {
    stat.S_IFIFO: "is a pipe",
    stat.S_IFSOCK: "is a socket",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFLNK: "is a symbolic link",
}


def open_regular(
    path: Path, *, flags: int = os.O_RDONLY, mode: int = 0, follow_symlinks: bool = True, max_bytes: int | None = None
) -> int:
    """Open a regular file and return its descriptor; raise OSError with the reason in strerror for other entries.

    Without `follow_symlinks`, symbolic links are refused. Files larger than `max_bytes` are refused without reading.
    """
    try:
        # Before opening, because opening a device may have effects.
        _check_status(path.stat(follow_symlinks=follow_symlinks), max_bytes)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    except ValueError:
        raise OSError(errno.EINVAL, "its name contains a NUL") from None
    # The entry may have been replaced since the check, so it is checked again.
    flags |= os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY | (0 if follow_symlinks else os.O_NOFOLLOW)
    descriptor = os.open(path, flags, mode)
    try:
        _check_status(os.fstat(descriptor), max_bytes)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(
    path: Path, max_bytes: int, *, follow_symlinks: bool = True, owners: Collection[int] | None = None
) -> bytes:
    """Return the content of a regular file of at most `max_bytes`; raise OSError with the reason in strerror.

    With `owners`, PermissionError is raised unless the file belongs to one of these users and others cannot write it.
    """
    descriptor = open_regular(path, follow_symlinks=follow_symlinks, max_bytes=max_bytes)
    try:
        status = os.fstat(descriptor)
        if owners is not None and status.st_uid not in owners:
            raise PermissionError(errno.EPERM, f"belongs to user {status.st_uid}, who is not trusted here")
        if owners is not None and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError(errno.EPERM, "is writable by other users")
        chunks, remaining_bytes = [], max_bytes + 1  # the file may grow
        while remaining_bytes and (chunk := os.read(descriptor, min(remaining_bytes, _CHUNK_BYTES))):
            chunks.append(chunk)
            remaining_bytes -= len(chunk)
    finally:
        os.close(descriptor)
    if not remaining_bytes:
        raise _too_large_error(max_bytes)
    return b"".join(chunks)


def read_text(path: Path, max_bytes: int) -> str:
    """Return the content of a UTF-8 text file as `read_regular` does; raise OSError for other encodings."""
    try:
        return read_regular(path, max_bytes).decode("utf-8")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"is not UTF-8 text: {error.reason} at byte {error.start}") from None


def read_json(data: bytes) -> Any:
    """Parse JSON with at most MAX_DEPTH levels and numbers up to MAX_NUMBER; raise ValueError for other data.

    Unprintable characters are replaced by their escapes.
    """
    try:
        return _check_value(json.loads(data, parse_constant=float), MAX_DEPTH)
    except (RecursionError, OverflowError):
        raise ValueError("it is nested too deeply, or a number is too large") from None


def _check_value(value: Any, depth: int) -> Any:
    if depth == 0:
        raise ValueError("it is nested too deeply")
    if isinstance(value, dict):
        return {_escape(name): _check_value(item, depth - 1) for name, item in value.items()}
    if isinstance(value, list):
        return [_check_value(item, depth - 1) for item in value]
    if isinstance(value, str):
        return _escape(value)
    if isinstance(value, (int, float)) and not abs(value) <= MAX_NUMBER:
        raise ValueError("a number is too large or NaN")
    return value


def _escape(text: str) -> str:
    return text if text.isprintable() else ascii(text)[1:-1]


def _check_status(status: os.stat_result, max_bytes: int | None) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if kind != stat.S_IFREG:
        raise OSError(errno.EINVAL, f"{_KIND_TEXTS.get(kind, 'is of another type')}, not a regular file")
    if max_bytes is not None and status.st_size > max_bytes:
        raise _too_large_error(max_bytes)


def _too_large_error(max_bytes: int) -> OSError:
    size = f"{max_bytes >> 20} MiB" if max_bytes >= 1 << 20 else f"{max_bytes >> 10} KiB"
    return OSError(errno.EFBIG, f"is larger than {size}")
