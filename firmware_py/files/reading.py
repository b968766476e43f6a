"""Opens and reads what is a regular file and no larger than it may be: nothing is waited for, nothing read without end.

A pipe would be waited for until somebody writes, a device may have no end or act on being opened.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Collection
from pathlib import Path
from typing import Any

# Of what cannot be read because of what it is: no regular file, too large, or closed to its reader.
UNFIT = (errno.EINVAL, errno.EISDIR, errno.EFBIG, errno.ELOOP, errno.ENXIO, errno.EACCES)
_CHUNK_BYTES = 1 << 20
MOST_DEPTH, LARGEST = 12, 1e15
_KINDS = {
    stat.S_IFIFO: "is a pipe",
    stat.S_IFSOCK: "is a socket",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFLNK: "is a symbolic link",
}


def open_regular(
    path: Path, *, flags: int = os.O_RDONLY, mode: int = 0, follow: bool = True, most_bytes: int | None = None
) -> int:
    """Open a regular file and return its descriptor; OSError, whose strerror says what is wrong, for anything else.

    Without `follow` a symbolic link is refused too; a file of more than most_bytes is refused unread.
    """
    try:
        # Looked at first: opening a device may do something.
        _check(path.stat(follow_symlinks=follow), most_bytes)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    except ValueError:
        raise OSError(errno.EINVAL, "its name holds a NUL") from None
    # And once more, for it may have been exchanged meanwhile.
    flags |= os.O_CLOEXEC | os.O_NONBLOCK | os.O_NOCTTY | (0 if follow else os.O_NOFOLLOW)
    descriptor = os.open(path, flags, mode)
    try:
        _check(os.fstat(descriptor), most_bytes)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(path: Path, most_bytes: int, *, follow: bool = True, owners: Collection[int] | None = None) -> bytes:
    """Return the content of a regular file of at most so many bytes; OSError, whose strerror says what is wrong.

    With `owners`, the file must belong to one of these users and not be writable by others; otherwise EPERM.
    """
    descriptor = open_regular(path, follow=follow, most_bytes=most_bytes)
    try:
        status = os.fstat(descriptor)
        if owners is not None and status.st_uid not in owners:
            raise PermissionError(errno.EPERM, f"belongs to user {status.st_uid}, who is not trusted here")
        if owners is not None and status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            raise PermissionError(errno.EPERM, "can be written by others")
        parts, left = [], most_bytes + 1  # it may grow meanwhile
        while left and (part := os.read(descriptor, min(left, _CHUNK_BYTES))):
            parts.append(part)
            left -= len(part)
    finally:
        os.close(descriptor)
    if not left:
        raise _too_large(most_bytes)
    return b"".join(parts)


def read_text(path: Path, most_bytes: int) -> str:
    """Return the content of a text file in UTF-8 as `read_regular` does; OSError also for what is no text."""
    try:
        return read_regular(path, most_bytes).decode("utf-8")
    except UnicodeDecodeError as error:
        raise OSError(errno.EILSEQ, f"is no text in UTF-8: {error.reason} at byte {error.start}") from None


def read_json(data: bytes) -> Any:
    """Return JSON of bounded depth, with numbers that are finite and no larger than LARGEST; ValueError for other data.

    Characters that a terminal would act on are replaced by their escapes.
    """
    try:
        return _bounded(json.loads(data, parse_constant=float), MOST_DEPTH)
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
    if isinstance(value, (int, float)) and not abs(value) <= LARGEST:
        raise ValueError("a number is too large, or none")
    return value


def _printable(text: str) -> str:
    return text if text.isprintable() else ascii(text)[1:-1]


def _check(status: os.stat_result, most_bytes: int | None) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind == stat.S_IFDIR:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if kind != stat.S_IFREG:
        raise OSError(errno.EINVAL, f"{_KINDS.get(kind, 'is something else')}, no regular file")
    if most_bytes is not None and status.st_size > most_bytes:
        raise _too_large(most_bytes)


def _too_large(most_bytes: int) -> OSError:
    size = f"{most_bytes >> 20} MiB" if most_bytes >= 1 << 20 else f"{most_bytes >> 10} KiB"
    return OSError(errno.EFBIG, f"is larger than {size}")
