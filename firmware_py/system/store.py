"""Crash-safe state on disk: whole versions only, written in the background, proven by a checksum.

Each name has its own result. One that could not be stored stays a job until it is on disk, or, where the
caller is to go on with the version before, until the failed one is surely withdrawn.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import threading
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

from firmware_py.system.slots import SlotWriter, Stored, examine

RETRY_S = 2.0  # after a pause of this length, what has failed is tried again


class StoreError(RuntimeError):
    """The state directory cannot be used; the text names the remedy."""


@dataclass(frozen=True, slots=True)
class _Job:
    """A version to be written; None: the failed one is withdrawn. `once`: it is not tried again."""

    content: bytes | None
    once: bool = False


@dataclass(frozen=True, slots=True)
class _Failure:
    """What went wrong with a name, and what is still to be done for it."""

    text: str
    job: _Job


@dataclass(slots=True)
class _Waiter:
    """Who waits: for which save of each name, and whether those that are settled went well."""

    saves: dict[str, int]
    call: Callable[[bool], None]
    well: bool = True


class Store:
    """Named byte strings in a directory that this process holds alone.

    `save` returns at once; `when_stored` tells when names are on disk. The callbacks run in
    `service`, on the caller's thread, when `fileno` is readable.
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
        self._wake: SimpleQueue[bool] = SimpleQueue()  # of the writer: half the cost of a condition; True: it ends
        self._jobs: dict[str, _Job] = {}
        self._asked: dict[str, int] = {}  # saves asked for, by name
        self._settled: dict[str, int] = {}  # saves finished, well or badly
        self._failed: dict[str, _Failure] = {}
        self._waiting: deque[_Waiter] = deque()
        self._due: deque[tuple[Callable[[bool], None], bool]] = deque()
        self._thread = threading.Thread(target=self._write_jobs, name="store", daemon=True)
        self._thread.start()

    @property
    def failure(self) -> str:
        """What is wrong with the names that are not on disk; empty when all are."""
        with self._lock:
            return "; ".join(failure.text for failure in self._failed.values())

    def fileno(self) -> int:
        """The descriptor that is readable when `service` has callbacks to run."""
        return self._wake_fd

    def load(self, name: str) -> bytes | None:
        """Return the newest whole version, or None when there is none."""
        return self.examine(name).content

    def examine(self, name: str) -> Stored:
        """Return the newest whole version, and what is wrong with what is stored."""
        return examine(self._directory, name)

    def save(self, name: str, content: bytes) -> None:
        """Queue a new version, tried until it is on disk; a newer one of the same name replaces one not yet begun."""
        with self._lock:
            self._queue(name, _Job(content))

    def try_save(self, name: str, content: bytes, done: Callable[[bool], None]) -> None:
        """Queue a new version, tried once; run done(True) from `service` when it is on disk.

        When it cannot be stored it is withdrawn, so that the version before stands at the next start: done(False).
        """
        with self._lock:
            self._queue(name, _Job(content, once=True))
            self._waiting.append(_Waiter({name: self._asked[name]}, done))

    def when_stored(self, names: Collection[str], call: Callable[[bool], None]) -> None:
        """Run call(True) from `service` once the names are on disk as saved last, call(False) if one cannot be.

        What has failed before is tried again at once, but for what was to be tried once.
        """
        with self._lock:
            failed = {name: self._failed[name].job for name in names if name in self._failed and name not in self._jobs}
            withdrawn = any(job.content is None for job in failed.values())
            for name, job in failed.items():
                self._queue(name, job)
            saves = {name: asked for name in names if (asked := self._asked.get(name, 0)) > self._settled.get(name, 0)}
            if saves:
                self._waiting.append(_Waiter(saves, call, not withdrawn))
            else:
                self._due.append((call, True))
        if not saves:
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
        """Finish the queued saves, try once more what has failed, and release the directory."""
        self._wake.put(True)
        self._thread.join(timeout=10.0)
        for descriptor in (self._wake_fd, self._lock_fd):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def _queue(self, name: str, job: _Job) -> None:
        """Hand a job to the writer; the lock is held."""
        first = not self._jobs
        self._jobs[name] = job
        self._asked[name] = self._asked.get(name, 0) + 1
        if first:
            self._wake.put(False)

    def _write_jobs(self) -> None:
        writer = SlotWriter(self._directory, self._private)
        closing = False
        while not closing:
            try:
                closing = retry = self._wake.get(timeout=RETRY_S if self._failed else None)
            except Empty:
                retry = True
            with self._lock:
                jobs = dict(self._jobs)
                for name, failure in self._failed.items() if retry else ():
                    jobs.setdefault(name, failure.job)
                asked = {name: self._asked[name] for name in jobs}
                self._jobs = {}
            for name, job in jobs.items():
                self._settle(name, asked[name], _write_job(writer, name, job))
        writer.close()

    def _settle(self, name: str, asked: int, failure: _Failure | None) -> None:
        """Note how the saves of a name have ended, by this writing and not by one that may follow."""
        with self._lock:
            self._settled[name] = asked
            if failure is None:
                self._failed.pop(name, None)
            else:
                self._failed[name] = failure
            still: deque[_Waiter] = deque()
            for waiter in self._waiting:
                if waiter.saves.get(name, asked + 1) <= asked:
                    del waiter.saves[name]
                    waiter.well &= failure is None
                if waiter.saves:
                    still.append(waiter)
                else:
                    self._due.append((waiter.call, waiter.well))
            self._waiting = still
        os.eventfd_write(self._wake_fd, 1)


def _write_job(writer: SlotWriter, name: str, job: _Job) -> _Failure | None:
    """Do a job; return what went wrong, None when nothing did."""
    try:
        if job.content is None:
            writer.withdraw(name)
        else:
            writer.write(name, job.content)
    except OSError as error:
        text = f"{name} cannot be stored: {error.strerror or error}"
        if writer.is_unproven(name):
            text += "; the next start may find it all the same"
        return _Failure(text, _Job(None) if job.once else job)
    return None
