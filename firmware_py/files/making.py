"""How what is kept on disk is made: its modes, of the owner and the group, never of others; files as a whole or not."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

DIRECTORY_MODE, FILE_MODE, PRIVATE_MODE = 0o750, 0o640, 0o600
_UMASK = 0o027


@contextlib.contextmanager
def exact_modes() -> Iterator[None]:
    """Let what is made have just these modes, whatever umask the program was started with."""
    before = os.umask(_UMASK)
    try:
        yield
    finally:
        os.umask(before)


def make_directory(path: Path) -> None:
    """Make a directory and those above it that are missing; one that is there keeps its mode. OSError."""
    if path.is_dir():
        return
    if path.parent != path:
        make_directory(path.parent)
    with contextlib.suppress(FileExistsError):  # by somebody else meanwhile, or as no directory
        path.mkdir(DIRECTORY_MODE)
    if not path.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))


def write_whole(path: Path, content: bytes, mode: int = FILE_MODE) -> None:
    """Put a new file of this very mode in place of what is there, on disk when this returns; OSError: nothing is done.

    An OSError after the new one is in place can only be that of forcing its name to disk.
    """
    fresh = path.with_name(f".{path.name}.new")
    try:
        os.unlink(fresh)  # noqa: PTH108 - the tests' disk stands before the calls of os
    except IsADirectoryError:
        set_aside(fresh)
    except FileNotFoundError:
        pass
    descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        try:
            os.fchmod(descriptor, mode)  # whatever the umask is
            left = memoryview(content)
            while left:
                if not (written := os.write(descriptor, left)):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                left = left[written:]
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        os.replace(fresh, path)  # noqa: PTH105
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(fresh)  # noqa: PTH108
        raise
    sync_directory(path.parent)


def set_aside(path: Path) -> Path:
    """Rename an entry that is in the way of a file, of any kind, and return its new name; OSError.

    A file that was set aside before by that name is replaced; a directory is not.
    """
    for number in range(10):
        aside = path.with_name(f"{path.name}.aside{number or ''}")
        with contextlib.suppress(FileExistsError, IsADirectoryError, NotADirectoryError):
            if not aside.is_dir():
                os.replace(path, aside)  # noqa: PTH105 - the tests' disk stands before the calls of os
                return aside
    raise FileExistsError(errno.EEXIST, f"too many of {path.name} were set aside")


def sync_directory(directory: Path) -> None:
    """Force the names in a directory to disk; OSError."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
