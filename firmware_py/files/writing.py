"""Creates files and directories with fixed modes, without access for other users, and replaces files atomically."""

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
    """Set the umask within the context, so that new files have exactly the modes above."""
    previous_umask = os.umask(_UMASK)
    try:
        yield
    finally:
        os.umask(previous_umask)


def make_directory(path: Path) -> None:
    """Create a directory and its missing parents; an existing one keeps its mode. Raise OSError on failure."""
    if path.is_dir():
        return
    if path.parent != path:
        make_directory(path.parent)
    with contextlib.suppress(FileExistsError):  # created by another process, or not a directory
        path.mkdir(DIRECTORY_MODE)
    if not path.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))


def write_atomically(path: Path, content: bytes, mode: int = FILE_MODE) -> None:
    """Replace a file atomically and force it to disk. Raise OSError on failure.

    After a failure the old file is unchanged, unless the final sync of the directory failed: then it is replaced.
    """
    temporary = path.with_name(f".{path.name}.new")
    try:
        os.unlink(temporary)  # noqa: PTH108 - tests replace the functions of os
    except IsADirectoryError:
        set_aside(temporary)
    except FileNotFoundError:
        pass
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        try:
            os.fchmod(descriptor, mode)  # independent of the umask
            remaining = memoryview(content)
            while remaining:
                if not (written := os.write(descriptor, remaining)):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                remaining = remaining[written:]
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        os.replace(temporary, path)  # noqa: PTH105
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(temporary)  # noqa: PTH108
        raise
    sync_directory(path.parent)


def set_aside(path: Path) -> Path:
    """Rename an entry of any type to NAME.aside and return its new path; raise OSError on failure.

    A file that was renamed earlier is replaced; if it is a directory, a number is appended to the name.
    """
    for number in range(10):
        new_path = path.with_name(f"{path.name}.aside{number or ''}")
        with contextlib.suppress(FileExistsError, IsADirectoryError, NotADirectoryError):
            if not new_path.is_dir():
                os.replace(path, new_path)  # noqa: PTH105 - tests replace the functions of os
                return new_path
    raise FileExistsError(errno.EEXIST, f"too many renamed copies of {path.name}; delete some")


def sync_directory(directory: Path) -> None:
    """Force the entries of a directory to disk; raise OSError on failure."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
