"""Exclusive lock of the state directory: one on the directory itself and one on the file `lock` in it.

The first also works on a read-only disk. The second excludes the previous version, which uses only the file.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Callable
from pathlib import Path

from firmware_py.files.reading import UNFIT, open_regular
from firmware_py.files.writing import FILE_MODE, make_directory, set_aside

LOCK_FILE = "lock"


class StoreError(RuntimeError):
    """The state directory cannot be used; the text names the remedy."""


class InUseError(StoreError):
    """Another process has locked the state directory."""


class DirectoryLock:
    """The locks on a directory, which may not exist yet."""

    def __init__(self, directory: Path) -> None:
        """Store the path; `acquire` creates and locks the directory."""
        self._directory = directory
        self._descriptors: list[int] = []
        self.identity = (0, 0)  # device and inode of the directory that was locked last
        self._was_locked = False

    def acquire(self, *, strict: bool) -> str:
        """Create and lock the directory; return an error text if only the lock file is missing.

        A directory that was locked before is not created again: its medium may have been removed. Raises InUseError,
        and StoreError if there is no lock, or with `strict` no lock file.
        """
        try:
            if not self._was_locked:
                make_directory(self._directory)
            status = self._directory.stat()
        except OSError as error:
            raise StoreError(self._text(error)) from None
        self.release()
        no_directory_lock = self._lock(self._open_directory)
        no_file_lock = self._lock(self._open_file)
        if no_file_lock is not None and (strict or no_directory_lock is not None):
            self.release()
            raise StoreError(self._text(no_file_lock))
        self.identity, self._was_locked = (status.st_dev, status.st_ino), True
        return "" if no_file_lock is None else self._text(no_file_lock)

    def release(self) -> None:
        """Release the locks."""
        for descriptor in self._descriptors:
            with contextlib.suppress(OSError):  # it is closed nevertheless, and nothing was written to it
                os.close(descriptor)
        self._descriptors = []

    def is_valid(self) -> bool:
        """Whether the path still leads to the locked directory; another one may have been mounted over it."""
        try:
            status = self._directory.stat()
        except OSError:
            return False
        return bool(self._descriptors) and (status.st_dev, status.st_ino) == self.identity

    def _lock(self, open_it: Callable[[], int]) -> OSError | None:
        """Open and lock; return an OSError; raises InUseError if another process has the lock."""
        try:
            descriptor = open_it()
            self._descriptors.append(descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise InUseError(
                f"state directory {self._directory} is in use by another autopilot; end that one"
            ) from None
        except OSError as error:
            return error
        return None

    def _open_directory(self) -> int:
        return os.open(self._directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)

    def _open_file(self) -> int:
        path, flags = self._directory / LOCK_FILE, os.O_RDWR | os.O_CREAT
        try:
            return open_regular(path, flags=flags, mode=FILE_MODE, follow=False)
        except OSError as error:
            if error.errno not in UNFIT:
                raise
            with contextlib.suppress(OSError):
                set_aside(path)
            return open_regular(path, flags=flags, mode=FILE_MODE, follow=False)

    def _text(self, error: OSError) -> str:
        return f"state directory {self._directory}: {error.strerror}; choose another with --state"
