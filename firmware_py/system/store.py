"""Crash-safe state on disk: whole versions only, written in the background, proven by a checksum.

Each name has its own result. One that could not be stored stays a job until it is on disk, or, where the
caller is to go on with the version before, until the failed one is surely withdrawn.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue

from msgspec.structs import replace

from firmware_py.common.records import Progress, Stored
from firmware_py.system.directory_lock import DirectoryLock, InUseError, StoreError
from firmware_py.system.slots import SlotWriter, earlier_name, earlier_slots, examine
from firmware_py.system.store_jobs import Failure, Job, finish_import, write_job

RETRY_S = 2.0  # after a pause of this length, what has failed is tried again
_ARRIVING = "the state directory is being taken up"


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

    def __init__(self, directory: Path, private: Collection[str] = (), *, wait: bool = False) -> None:
        """Make and lock the directory, start the writer; StoreError when it cannot be used.

        The names in `private` are for nobody but the owner to read. With `wait` only another process that
        holds the directory is an error: whatever else is wrong is a `failure`, and tried again.
        """
        self._directory = directory
        self._private = frozenset(private)
        self._directory_lock = DirectoryLock(directory)
        self.start_problem = ""  # what kept the directory from being held as it should be at the start
        self._lock_problem = ""  # why nothing can be written now: the directory is not held
        try:
            self.start_problem = self._directory_lock.acquire(strict=not wait)
            self.start_problem = finish_import(directory) or self.start_problem
        except InUseError:
            raise
        except StoreError as error:
            if not wait:
                self._directory_lock.release()
                raise
            self.start_problem = self._lock_problem = str(error)
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._idle = threading.Condition(self._lock)
        self._wake: SimpleQueue[bool] = SimpleQueue()  # of the writer: half the cost of a condition; True: it ends
        self._jobs: dict[str, Job] = {}
        self._asked: dict[str, int] = {}  # saves asked for, by name
        self._settled: dict[str, int] = {}  # saves finished, well or badly
        self._saves = self._finished = (
            0  # of all names; the first is changed by the caller's thread, the other by the writer
        )
        self._settlings = 0  # saves finished, those that are tried again counted again
        self._rested = (-1, -1)  # saves and settlings when nothing was under way and nothing due
        self._failed: dict[str, Failure] = {}
        self._written = (0, 0)
        self._waiting: deque[_Waiter] = deque()
        self._due: deque[tuple[Callable[[bool], None], bool]] = deque()
        self._welcomes: list[tuple[Collection[str], Callable[[Mapping[str, Stored]], None]]] = []
        self._thread = threading.Thread(target=self._write_jobs, name="store", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:  # there is no thread to be had
            self._release()
            raise

    @property
    def failure(self) -> str:
        """What is wrong with the names that are not on disk; empty when all are and others can be."""
        with self._lock:
            return "; ".join(failure.text for failure in self._failed.values()) or self._lock_problem

    def fileno(self) -> int:
        """The descriptor that is readable when `service` has callbacks to run."""
        return self._wake_fd

    def load(self, name: str) -> bytes | None:
        """Return the newest whole version, or None when there is none."""
        return self.examine(name).content

    def examine(self, name: str) -> Stored:
        """Return the newest whole version, and what is wrong with what is stored."""
        return examine(self._directory, name, os.geteuid() if name in self._private else None)

    def save(self, name: str, content: bytes, *, both_slots: bool = False) -> None:
        """Queue a new version, tried until it is on disk; a newer one of the same name replaces one not yet begun.

        `both_slots`: it is on disk when it is in both slots, so that nothing is left of the versions before.
        """
        with self._lock:
            waiting = self._jobs.get(name)
            self._queue(name, Job(content, both_slots=both_slots or (waiting is not None and waiting.both_slots)))

    def save_if_idle(self, name: str, content: bytes) -> None:
        """Queue a version as `save` does, unless one is queued: whoever waits for that would be told of this."""
        with self._lock:
            if name not in self._jobs:
                self._queue(name, Job(content))

    def set_aside(self, names: Collection[str]) -> None:
        """Queue the renaming of the slots in which an earlier version keeps these records, where there are any.

        Until then, `examine` reads none of these records.
        """
        for name in names:
            if earlier_slots(self._directory, name):
                with self._lock:
                    self._queue(earlier_name(name), Job(None, aside=name))

    def try_save(self, name: str, content: bytes, done: Callable[[bool], None]) -> None:
        """Queue a new version, tried once; run done(True) from `service` when it is on disk.

        When it cannot be stored it is withdrawn, so that the version before stands at the next start: done(False).
        """
        with self._lock:
            self._queue(name, Job(content, once=True))
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

    def on_mount(self, names: Collection[str], welcome: Callable[[Mapping[str, Stored]], None]) -> None:
        """Run welcome(what the names hold) from `service` when a directory is held that was not there at the start.

        It may also have been mounted over the one that was. Nothing is written there before.
        """
        self._welcomes.append((names, welcome))

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

    def settle(self) -> bool:
        """Wait until nothing is under way; return whether callbacks are due. Only where time stands still meanwhile."""
        if self._rested == (self._saves, self._settlings) and not self._due:
            return False  # asked several times a tick, while something is saved once in many
        with self._lock:
            self._idle.wait_for(lambda: all(self._settled.get(name) == asked for name, asked in self._asked.items()))
            if self._due:
                return True
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)  # nobody is to be woken for nothing
            self._rested = (self._saves, self._settlings)
            return False

    @property
    def written(self) -> tuple[int, int]:
        """Versions written since the start, and their bytes in whole blocks of 4 KiB."""
        return self._written

    def progress(self) -> Progress:
        """Return how many saves the writer has finished, well or badly, and whether more are asked for."""
        thread, finished = self._thread, self._finished
        return Progress(
            "state store", self._saves > finished, finished, alive=thread.is_alive(), thread=thread.native_id
        )

    def close(self) -> None:
        """Finish the queued saves, try once more what has failed, and release the directory."""
        self._wake.put(True)
        self._thread.join(timeout=10.0)
        self._release()

    def _release(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._wake_fd)
        self._directory_lock.release()

    def _queue(self, name: str, job: Job) -> None:
        """Hand a job to the writer; the lock is held."""
        first = not self._jobs
        self._jobs[name] = job
        self._asked[name] = self._asked.get(name, 0) + 1
        self._saves += 1
        if first:
            self._wake.put(False)

    def _write_jobs(self) -> None:
        writer = SlotWriter(self._directory, self._private)
        closing = False
        while not closing:
            try:
                closing = retry = self._wake.get(timeout=RETRY_S if self._failed or self._lock_problem else None)
            except Empty:
                retry = True
            if not (self._lock_problem or self._directory_lock.is_valid()):
                self._lock_problem = f"state directory {self._directory} is gone, or another one"
            if self._lock_problem and retry:
                writer.close()
                writer = SlotWriter(self._directory, self._private)
                self._take_up()
            with self._lock:
                jobs = dict(self._jobs)
                for name, failure in self._failed.items() if retry else ():
                    jobs.setdefault(name, failure.job)
                owed = [name for name in jobs if name in self._failed and self._failed[name].job.both_slots]
                jobs |= {name: replace(jobs[name], both_slots=True) for name in owed}
                asked = {name: self._asked[name] for name in jobs}
                self._jobs = {}
            for name, job in jobs.items():
                result = write_job(writer, name, job, self._lock_problem)
                self._written = (writer.versions, writer.written_bytes)
                self._settle(name, asked[name], result)
        writer.close()

    def _take_up(self) -> None:
        """Try to hold the directory; what it holds is handed over before anything is written there."""
        if self._lock_problem == _ARRIVING:
            return
        before = self._directory_lock.identity
        try:
            self._directory_lock.acquire(strict=False)
            finish_import(self._directory)
        except StoreError as error:
            self._lock_problem = str(error)
            return
        if self._directory_lock.identity == before:
            self._lock_problem = ""  # it was away: there is nothing in it but what is known
            return
        welcomes = tuple(self._welcomes)
        found = {name: self.examine(name) for names, _call in welcomes for name in names}
        self._lock_problem = _ARRIVING

        def welcome(_: bool) -> None:  # noqa: FBT001 - as the store's other callbacks
            for _names, call in welcomes:
                call(found)
            self._lock_problem = ""

        with self._lock:
            self._due.append((welcome, True))
        os.eventfd_write(self._wake_fd, 1)

    def _settle(self, name: str, asked: int, failure: Failure | None) -> None:
        """Note how the saves of a name have ended, by this writing and not by one that may follow."""
        with self._lock:
            self._finished += asked - self._settled.get(name, 0)
            self._settlings += 1
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
            self._idle.notify_all()
