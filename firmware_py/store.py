"""Crash-safe state on disk: whole versions only, written in the background, proven by a checksum.

A version is written beside the old one, forced to disk and renamed over it; the one before
is kept. A reader takes the newest that is whole.
"""

from __future__ import annotations

import errno
import fcntl
import os
import threading
import zlib
from collections import deque
from collections.abc import Callable
from pathlib import Path

_MARK = b"# crc32 "


class StoreError(RuntimeError):
    """The state directory cannot be used; the text names the remedy."""


class Store:
    """Named byte strings in a directory that this process holds alone.

    `save` returns at once; `when_stored` tells when all saves so far are on disk. The
    callbacks run in `service`, on the caller's thread, when `fileno` is readable.
    """

    def __init__(self, directory: Path) -> None:
        """Make and lock the directory, start the writer; StoreError when it cannot be used."""
        self._directory = directory
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._lock_fd = os.open(directory / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StoreError(f"state directory {directory}: {error.strerror}; choose another with --state") from None
        try:
            fcntl.flock(self._lock_fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._lock_fd)
            if error.errno in (errno.EAGAIN, errno.EACCES):
                raise StoreError(f"state directory {directory} is in use by another autopilot; end that one") from None
            raise StoreError(f"state directory {directory} cannot be locked: {error.strerror}") from None
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._condition = threading.Condition()
        self._jobs: dict[str, bytes] = {}
        self._asked = 0  # saves asked for
        self._done = 0  # saves finished, well or badly
        self._failed_text = ""
        self._waiting: deque[tuple[int, Callable[[bool], None]]] = deque()
        self._closing = False
        self._thread = threading.Thread(target=self._write_jobs, name="store", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str:
        """What went wrong with the last save; empty when it went well."""
        return self._failed_text

    def fileno(self) -> int:
        """The descriptor that is readable when `service` has callbacks to run."""
        return self._wake_fd

    def load(self, name: str) -> bytes | None:
        """Return the newest whole version, or None when there is none."""
        for path in (self._directory / name, self._directory / f"{name}.previous"):
            try:
                data = path.read_bytes()
            except OSError:
                continue
            content = _checked(data)
            if content is not None:
                return content
        return None

    def save(self, name: str, content: bytes) -> None:
        """Queue a new version; a newer one of the same name replaces one not yet begun."""
        with self._condition:
            self._jobs[name] = content
            self._asked += 1
            self._condition.notify()

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Run call(True) from `service` once all saves so far are on disk, call(False) if they cannot be."""
        with self._condition:
            self._waiting.append((self._asked, call))
            settled = self._done >= self._asked
        if settled:
            os.eventfd_write(self._wake_fd, 1)

    def service(self) -> None:
        """Run the callbacks that are due."""
        try:
            os.eventfd_read(self._wake_fd)
        except BlockingIOError:
            return
        due: list[Callable[[bool], None]] = []
        with self._condition:
            while self._waiting and self._waiting[0][0] <= self._done:
                due.append(self._waiting.popleft()[1])
            well = not self._failed_text
        for call in due:
            call(well)

    def close(self) -> None:
        """Finish the queued saves and release the directory."""
        with self._condition:
            self._closing = True
            self._condition.notify()
        self._thread.join(timeout=10.0)
        os.close(self._wake_fd)
        os.close(self._lock_fd)

    def _write_jobs(self) -> None:
        while True:
            with self._condition:
                while not self._jobs and not self._closing:
                    self._condition.wait()
                if not self._jobs:
                    return
                jobs, asked = self._jobs, self._asked
                self._jobs = {}
            failed = ""
            for name, content in jobs.items():
                try:
                    _replace(self._directory, name, content)
                except OSError as error:
                    failed = f"{name} cannot be stored: {error.strerror}"
            with self._condition:
                self._failed_text = failed
                self._done = asked
            os.eventfd_write(self._wake_fd, 1)


def _checked(data: bytes) -> bytes | None:
    """Strip the checksum line; None when it is missing or wrong."""
    content, mark, tail = data.rpartition(_MARK)
    if not mark or tail.strip() != f"{zlib.crc32(content):08x}".encode():
        return None
    return content


def _replace(directory: Path, name: str, content: bytes) -> None:
    """Put a new version in the place of the old one, which becomes the previous one."""
    path, fresh, previous = directory / name, directory / f"{name}.new", directory / f"{name}.previous"
    with fresh.open("wb") as file:
        file.write(content + _MARK + f"{zlib.crc32(content):08x}\n".encode())
        file.flush()
        os.fdatasync(file.fileno())
    if path.exists():
        previous.unlink(missing_ok=True)
        os.link(path, previous)
    fresh.replace(path)
    directory_fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(directory_fd)
    finally:
        os.close(directory_fd)
