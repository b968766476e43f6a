"""Exclusive locks of the state directory: one on the directory itself and one on the file `lock` in it.

The first lock also works on a read-only disk. The second lock excludes earlier versions, which lock only the file.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Callable
from pathlib import Path

from firmware_py.files.reading import UNUSABLE, open_regular
from firmware_py.files.writing import FILE_MODE, make_directory, set_aside

LOCK_FILE = "lock"


class StoreError(RuntimeError):
    """The state directory cannot be used; the text names the remedy."""


class InUseError(StoreError):
    """Another process has locked the state directory."""


class DirectoryLock:
    """The locks on a directory, which need not exist yet."""

    def __init__(self, directory: Path) -> None:
        """Store the path; `acquire` creates and locks the directory."""
        self._directory = directory
        self._descriptors: list[int] = []
        self.identity = (0, 0)  # device and inode of the directory that was last locked
        self._was_locked = False

    def acquire(self, *, strict: bool) -> str:
        """Create and lock the directory; return an error text if only the lock file could not be locked.

        A directory that was locked before is not created again, because its medium may have been removed. Raises
        InUseError, and StoreError if nothing could be locked or, with `strict`, if only the directory could be locked.
        """
        try:
            if not self._was_locked:
                make_directory(self._directory)
            status = self._directory.stat()
        except OSError as error:
            raise StoreError(self._describe(error)) from None
        self.release()
        directory_error = self._lock(self._open_directory)
        file_error = self._lock(self._open_file)
        if file_error is not None and (strict or directory_error is not None):
            self.release()
            raise StoreError(self._describe(file_error))
        self.identity, self._was_locked = (status.st_dev, status.st_ino), True
        return "" if file_error is None else self._describe(file_error)

    def release(self) -> None:
        """Release the locks."""
        for descriptor in self._descriptors:
            with contextlib.suppress(OSError):  # the descriptor is closed nevertheless
                os.close(descriptor)
        self._descriptors = []

    def is_valid(self) -> bool:
        """Return whether the path still leads to the locked directory; another may have been mounted over it."""
        try:
            status = self._directory.stat()
        except OSError:
            return False
        return bool(self._descriptors) and (status.st_dev, status.st_ino) == self.identity

    def _lock(self, open_target: Callable[[], int]) -> OSError | None:
        """Open and lock a file or directory; return an OSError, or raise InUseError if another process has the lock."""
        try:
            descriptor = open_target()
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
            return open_regular(path, flags=flags, mode=FILE_MODE, follow_symlinks=False)
        except OSError as error:
            if error.errno not in UNUSABLE:
                raise
            with contextlib.suppress(OSError):
                set_aside(path)
            return open_regular(path, flags=flags, mode=FILE_MODE, follow_symlinks=False)

    def _describe(self, error: OSError) -> str:
        return f"state directory {self._directory}: {error.strerror}; choose another with --state"
