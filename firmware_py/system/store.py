"""Crash-safe state on disk: whole versions only, written in the background, proven by a checksum.

Each name has two slots, files `NAME.0` and `NAME.1`, written in turn and in place: the newest
whole version is never touched by the next write, and no directory or file size changes, which
on a journalling file system cost ten times as much as the data. A reader takes the newest
version that is whole. A slot begins with a line of sequence number, length and checksum; the
content follows as it is.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import threading
import zlib
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

SLOTS = (0, 1)
SLOT_BYTES = 4096  # a slot is made this large at once, and grows by as much
MODE, PRIVATE_MODE = 0o644, 0o600
_HEAD = re.compile(rb"# rambler state (\d{1,18}) (\d{1,12}) ([0-9a-f]{8})\n")


class StoreError(RuntimeError):
    """The state directory cannot be used; the text names the remedy."""


class Store:
    """Named byte strings in a directory that this process holds alone.

    `save` returns at once; `when_stored` tells when all saves so far are on disk. The
    callbacks run in `service`, on the caller's thread, when `fileno` is readable.
    """

    def __init__(self, directory: Path, private: Collection[str] = ()) -> None:
        """Make and lock the directory, start the writer; StoreError when it cannot be used.

        The names in `private` are for nobody but the owner to read.
        """
        self._directory = directory
        self._private = frozenset(private)
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
        self._lock = threading.Lock()
        self._wake: SimpleQueue[None] = SimpleQueue()  # of the writer: half the cost of a condition
        self._jobs: dict[str, bytes] = {}
        self._asked = 0  # saves asked for
        self._done = 0  # saves finished, well or badly
        self._failed_text = ""
        self._waiting: deque[tuple[int, Callable[[bool], None]]] = deque()
        self._due: deque[tuple[Callable[[bool], None], bool]] = deque()
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
        return stored_content(self._directory, name)

    def save(self, name: str, content: bytes) -> None:
        """Queue a new version; a newer one of the same name replaces one not yet begun."""
        with self._lock:
            first = not self._jobs
            self._jobs[name] = content
            self._asked += 1
        if first:
            self._wake.put(None)

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Run call(True) from `service` once all saves so far are on disk, call(False) if they cannot be."""
        with self._lock:
            settled = self._done >= self._asked
            if settled:
                self._due.append((call, not self._failed_text))
            else:
                self._waiting.append((self._asked, call))
        if settled:
            os.eventfd_write(self._wake_fd, 1)

    def service(self) -> None:
        """Run the callbacks that are due."""
        try:
            os.eventfd_read(self._wake_fd)
        except BlockingIOError:
            return
        with self._lock:
            due, self._due = self._due, deque()
        for call, stored in due:
            call(stored)

    def close(self) -> None:
        """Finish the queued saves and release the directory."""
        self._wake.put(None)
        self._thread.join(timeout=10.0)
        os.close(self._wake_fd)
        os.close(self._lock_fd)

    def _write_jobs(self) -> None:
        writer = _Writer(self._directory, self._private)
        while True:
            self._wake.get()
            with self._lock:
                jobs, asked = self._jobs, self._asked
                self._jobs = {}
            if not jobs:  # woken by close
                writer.close()
                return
            failed = ""
            for name, content in jobs.items():
                try:
                    writer.write(name, content)
                except OSError as error:
                    failed = f"{name} cannot be stored: {error.strerror}"
            with self._lock:
                self._failed_text = failed
                self._done = asked
                # Judged by this round of writing, not by one that may follow before anybody looks.
                while self._waiting and self._waiting[0][0] <= asked:
                    self._due.append((self._waiting.popleft()[1], not failed))
            os.eventfd_write(self._wake_fd, 1)


@dataclass(frozen=True, slots=True)
class _Version:
    """A whole version: where it lies, its place in the sequence and its content."""

    slot: int
    sequence: int
    content: bytes


def stored_content(directory: Path, name: str) -> bytes | None:
    """Return the newest whole version of a name, or None: safe beside an autopilot that is writing."""
    version = _newest(directory, name)
    return None if version is None else version.content


def _slot_path(directory: Path, name: str, slot: int) -> Path:
    return directory / f"{name}.{slot}"


def _newest(directory: Path, name: str) -> _Version | None:
    """Return the newest whole version of a name, or None."""
    versions = []
    for slot in SLOTS:
        try:
            data = _slot_path(directory, name, slot).read_bytes()
        except OSError:
            continue
        head = _HEAD.match(data)
        if head is None:
            continue
        content = data[head.end() : head.end() + int(head[2])]
        if len(content) == int(head[2]) and _checksum(head[1], content) == head[3]:
            versions.append(_Version(slot, int(head[1]), content))
    return max(versions, key=lambda version: version.sequence, default=None)


def _checksum(sequence: bytes, content: bytes) -> bytes:
    return f"{zlib.crc32(content, zlib.crc32(sequence)):08x}".encode()


class _Writer:
    """The writer's side: where the newest versions lie, and the files, which stay open.

    Opening one again costs more than half of what the disk takes.
    """

    def __init__(self, directory: Path, private: frozenset[str]) -> None:
        self._directory = directory
        self._private = private
        self._places: dict[str, tuple[int, int]] = {}  # slot and sequence of the newest version
        self._files: dict[tuple[str, int], int] = {}
        self._named = False  # a file was made whose name may not be on disk yet, whatever became of its content

    def close(self) -> None:
        """Close the files."""
        for descriptor in self._files.values():
            os.close(descriptor)
        self._files.clear()

    def write(self, name: str, content: bytes) -> None:
        """Write a new version into the slot that does not hold the newest one, and force it to disk; or OSError."""
        try:
            self._places[name] = self._write_slot(name, content)
        except OSError:
            # What is there now must be looked up again.
            self._places.pop(name, None)
            for slot in SLOTS:
                self._close_slot(name, slot)
            raise

    def _write_slot(self, name: str, content: bytes) -> tuple[int, int]:
        place = self._places.get(name)
        if place is None:
            newest = _newest(self._directory, name)
            place = (SLOTS[1], 0) if newest is None else (newest.slot, newest.sequence)
        slot, number = 1 - place[0], place[1] + 1
        sequence = b"%d" % number
        data = b"# rambler state %s %d %s\n" % (sequence, len(content), _checksum(sequence, content)) + content
        size = -(-len(data) // SLOT_BYTES) * SLOT_BYTES
        descriptor, present = self._open_slot(name, slot)
        if name in self._private:
            data = data.ljust(max(size, present), b"\0")  # nothing of a longer secret is to stay behind this one
        if present < size:
            # Real zeros, so that the space is there before it is needed.
            os.pwrite(descriptor, bytes(size), 0)
        written = os.pwrite(descriptor, data, 0)
        if written < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fdatasync(descriptor)
        if self._named:
            directory_fd = os.open(self._directory, os.O_RDONLY | os.O_DIRECTORY)
            try:
                os.fsync(directory_fd)
            finally:
                os.close(directory_fd)
            self._named = False
        return slot, number

    def _open_slot(self, name: str, slot: int) -> tuple[int, int]:
        """Return the descriptor of a slot and its size."""
        kept = self._files.get((name, slot))
        if kept is not None:
            status = os.fstat(kept)
            if status.st_nlink:
                return kept, status.st_size
            self._close_slot(name, slot)  # removed, or another put in its place
        path, mode = _slot_path(self._directory, name, slot), PRIVATE_MODE if name in self._private else MODE
        self._named |= not path.exists()
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, mode)
        self._files[name, slot] = descriptor
        if name in self._private:
            os.fchmod(descriptor, mode)  # of a file that somebody has copied here, too
        return descriptor, os.fstat(descriptor).st_size

    def _close_slot(self, name: str, slot: int) -> None:
        descriptor = self._files.pop((name, slot), None)
        if descriptor is not None:
            os.close(descriptor)
