"""Opens and reads what is a regular file and no larger than it may be: nothing is waited for, nothing read without end.

A pipe would be waited for until somebody writes, a device may have no end or act on being opened.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

# Of what cannot be read because of what it is: no regular file, too large, or closed to its reader.
UNFIT = (errno.EINVAL, errno.EISDIR, errno.EFBIG, errno.ELOOP, errno.ENXIO, errno.EACCES)
_CHUNK_BYTES = 1 << 20
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


def read_regular(path: Path, most_bytes: int, *, follow: bool = True) -> bytes:
    """Return the content of a regular file of at most so many bytes; OSError, whose strerror says what is wrong."""
    descriptor = open_regular(path, follow=follow, most_bytes=most_bytes)
    try:
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
