"""The modes of what is kept on disk, and directories made with them: of the owner and the group, never of others."""

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
