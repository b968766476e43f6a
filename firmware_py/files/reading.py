"""Opens and reads regular files up to a size limit.

Pipes and devices are refused: opening them may block or have effects, and reading may never end.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Collection
from pathlib import Path
from typing import Any

# Errors of entries that are not usable as such: not a regular file, too large, or not readable.
UNFIT = (errno.EINVAL, errno.EISDIR, errno.EFBIG, errno.ELOOP, errno.ENXIO, errno.EACCES)
_CHUNK_BYTES = 1 << 20
MAX_DEPTH, MAX_NUMBER = 12, 1e15
_KINDS = {
    stat.S_IFIFO: "is a pipe",
    stat.S_IFSOCK: "is a socket",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFLNK: "is a symbolic link",
}


def open_regular(
    path: Path, *, flags: int = os.O_RDONLY, mode: int = 0, follow: bool = True, max_bytes: int | None = None
) -> int:
    """Open a regular file and return its descriptor; raise OSError with an explanatory strerror for anything else.

    Without `follow` symbolic links are refused; files larger than max_bytes are refused unread.
    """
    try:
        # Checked before opening: opening a device may have effects.
        _check(path.stat(follow_symlinks=follow), max_bytes)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    except ValueError:
        raise OSError(errno.EINVAL, "its name contains a NUL") from None
    # Checked again: it may have been replaced meanwhile.
    flags |= os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY | (0 if follow else os.O_NOFOLLOW)
    descriptor = os.open(path, flags, mode)
    try:
        _check(os.fstat(descriptor), max_bytes)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(path: Path, max_bytes: int, *, follow: bool = True, owners: Collection[int] | None = None) -> bytes:
    """Return the content of a regular file up to max_bytes; raise OSError with an explanatory strerror.

    With `owners`, the file must belong to one of these users and not be writable by others; otherwise EPERM.
    """
    descriptor = open_regular(path, follow=follow, max_bytes=max_bytes)
    try:
        status = os.fstat(descriptor)
        if owners is not None and status.st_uid not in owners:
            raise PermissionError(errno.EPERM, f"belongs to user {status.st_uid}, who is not trusted here")
        if owners is not None and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError(errno.EPERM, "is writable by other users")
        parts, left = [], max_bytes + 1  # the file may grow meanwhile
        while left and (part := os.read(descriptor, min(left, _CHUNK_BYTES))):
            parts.append(part)
            left -= len(part)
    finally:
        os.close(descriptor)
    if not left:
        raise _too_large(max_bytes)
    return b"".join(parts)


def read_text(path: Path, max_bytes: int) -> str:
    """Return the content of a UTF-8 text file as `read_regular` does; raise OSError for other encodings."""
    try:
        return read_regular(path, max_bytes).decode("utf-8")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"is not UTF-8 text: {error.reason} at byte {error.start}") from None


def read_json(data: bytes) -> Any:
    """Return JSON with at most MAX_DEPTH levels and numbers up to MAX_NUMBER; raise ValueError for other data.

    Control characters are replaced by their escapes.
    """
    try:
        return _bounded(json.loads(data, parse_constant=float), MAX_DEPTH)
    except (RecursionError, OverflowError):
        raise ValueError("it is nested too deeply, or a number is too large") from None


def _bounded(value: Any, depth: int) -> Any:
    if depth == 0:
        raise ValueError("it is nested too deeply")
    if isinstance(value, dict):
        return {_printable(name): _bounded(part, depth - 1) for name, part in value.items()}
    if isinstance(value, list):
        return [_bounded(part, depth - 1) for part in value]
    if isinstance(value, str):
        return _printable(value)
    if isinstance(value, (int, float)) and not abs(value) <= MAX_NUMBER:
        raise ValueError("a number is too large or NaN")
    return value


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)[1:-1]


def _check(status: os.stat_result, max_bytes: int | None) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if kind != stat.S_IFREG:
        raise OSError(errno.EINVAL, f"{_KINDS.get(kind, 'is of another type')}, not a regular file")
    if max_bytes is not None and status.st_size > max_bytes:
        raise _too_large(max_bytes)


def _too_large(max_bytes: int) -> OSError:
    size = f"{max_bytes >> 20} MiB" if max_bytes >= 1 << 20 else f"{max_bytes >> 10} KiB"
    return OSError(errno.EFBIG, f"is larger than {size}")
