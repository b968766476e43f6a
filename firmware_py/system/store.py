"""Crash-safe state on disk: complete versions with a checksum, written in the background.

Each name has its own result. A failed job is repeated until the version is on disk or, for `try_save`, until the failed
version is withdrawn.
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

import msgspec
from msgspec.structs import replace

from firmware_py.common.records import Progress, Stored
from firmware_py.files.writing import set_aside
from firmware_py.system.directory_lock import DirectoryLock, InUseError, StoreError
from firmware_py.system.slots import SlotWriter, earlier_name, examine, find_earlier_slots, is_secret
from firmware_py.system.state_export import (
    PENDING_IMPORT,
    BrokenExportError,
    end_import,
    pending_import,
    remove_leftovers,
)

RETRY_S = 2.0  # pause before a failed job is repeated
_MOUNTING = "the state directory is being loaded"


class Job(msgspec.Struct, frozen=True):
    """A version to write, or None to withdraw a failed version.

    `no_retry`: after a failure, withdraw the version. `both_slots`: write into both slots. `aside`: do not write, but
    rename the slots of this record that an earlier version of the program wrote.
    """

    content: bytes | None
    no_retry: bool = False
    both_slots: bool = False
    aside: str = ""


class Failure(msgspec.Struct, frozen=True):
    """The error of a name, and the job to repeat."""

    text: str
    job: Job


def write_job(writer: SlotWriter, name: str, job: Job, lock_problem: str) -> Failure | None:
    """Do a job, unless the directory is not locked; return the failure, or None."""
    if lock_problem:
        return Failure(f"{name} cannot be stored: {lock_problem}", Job(None) if job.no_retry else job)
    try:
        if job.aside:
            writer.set_aside(job.aside)
        elif job.content is None:
            writer.withdraw(name)
        else:
            for _ in range(1 + job.both_slots):
                writer.write(name, job.content)
    except OSError as error:
        text = f"{name} cannot be {'set aside' if job.aside else 'stored'}: {error.strerror or error}"
        if writer.is_uncertain(name):
            text += "; the next start may find it nevertheless"
        return Failure(text, Job(None) if job.no_retry else job)
    return None


def finish_import(directory: Path) -> str:
    """Write a pending import into the slots of a locked directory; call it before any other write.

    An unusable import is renamed and its problem returned. Raises StoreError on a disk error.
    """
    try:
        remove_leftovers(directory)
        import_ = pending_import(directory)
        if import_ is None:
            return ""
        writer = SlotWriter(directory, frozenset(filter(is_secret, import_.files)))
        try:
            for name in import_.files:
                content = import_.content(name)
                if content is None:
                    writer.clear(name)
                else:
                    for _ in range(1 + is_secret(name)):  # a secret is written to both slots
                        writer.write(name, content)
                writer.set_aside(name)
        finally:
            writer.close()
        end_import(directory)
    except BrokenExportError as error:
        with contextlib.suppress(OSError):
            return f"Import not used: {error}; set aside as {set_aside(directory / PENDING_IMPORT).name}"
        return f"Import not used: {error}"
    except OSError as error:
        text = f"state directory {directory}: import cannot be written: {error.strerror}"
        raise StoreError(f"{text}; free disk space and start again") from None
    return ""


@dataclass(slots=True)
class _PendingCallback:
    """A callback that waits for saves of names.

    `saves` is the required number of completed saves of each name; `is_ok` is False after a failed one.
    """

    saves: dict[str, int]
    call: Callable[[bool], None]
    is_ok: bool = True


class Store:
    """Named byte strings in a directory that only this process uses.

    `save` returns at once; `when_stored` calls back when names are on disk. When `fileno` is readable, the caller runs
    the callbacks with `service`.
    """

    def __init__(self, directory: Path, private: Collection[str] = (), *, wait: bool = False) -> None:
        """Create and lock the directory, and start the writer; raises StoreError.

        Only the owner may read the names in `private`. With `wait`, only a lock by another process is an error; any
        other problem becomes a `failure` and is retried.
        """
        self._directory = directory
        self._private = frozenset(private)
        self._directory_lock = DirectoryLock(directory)
        self.start_problem = ""  # why the directory was not completely locked at the start
        self._lock_problem = ""  # why the directory is not locked now, so that nothing can be written
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
        self._wake: SimpleQueue[bool] = SimpleQueue()  # wakes the writer, faster than a condition; True: end
        self._jobs: dict[str, Job] = {}
        self._requested: dict[str, int] = {}  # number of requested saves by name
        self._completed: dict[str, int] = {}  # number of completed saves by name, including failed ones
        self._requested_saves = 0  # requested saves of all names; changed by the caller's thread
        self._completed_saves = 0  # completed saves of all names; changed by the writer
        self._attempts = 0  # completed saves including repeated ones
        self._idle_at = (-1, -1)  # `_requested_saves` and `_attempts` when there were no jobs and no callbacks
        self._failed: dict[str, Failure] = {}
        self._written = (0, 0)
        self._pending_callbacks: deque[_PendingCallback] = deque()
        self._due_callbacks: deque[tuple[Callable[[bool], None], bool]] = deque()
        self._mount_callbacks: list[tuple[Collection[str], Callable[[Mapping[str, Stored]], None]]] = []
        self._thread = threading.Thread(target=self._write_jobs, name="store", daemon=True)
        try:
            self._thread.start()
        except RuntimeError:  # no thread available
            self._release()
            raise

    @property
    def failure(self) -> str:
        """The errors of names that are not on disk, or of the lock; empty without errors."""
        with self._lock:
            return "; ".join(failure.text for failure in self._failed.values()) or self._lock_problem

    def fileno(self) -> int:
        """Return the descriptor that is readable when `service` has callbacks to run."""
        return self._wake_fd

    def load(self, name: str) -> bytes | None:
        """Return the newest valid version, or None."""
        return self.examine(name).content

    def examine(self, name: str) -> Stored:
        """Return the newest valid version and the problems of the slots."""
        return examine(self._directory, name, os.geteuid() if name in self._private else None)

    def save(self, name: str, content: bytes, *, both_slots: bool = False) -> None:
        """Queue a new version; writing is retried until it is on disk or a newer version is queued.

        With `both_slots`, both slots are written, so that no earlier version remains.
        """
        with self._lock:
            queued_job = self._jobs.get(name)
            self._queue(name, Job(content, both_slots=both_slots or (queued_job is not None and queued_job.both_slots)))

    def save_if_idle(self, name: str, content: bytes) -> None:
        """Queue a version like `save`, unless one is queued: its callback would get the result of this one."""
        with self._lock:
            if name not in self._jobs:
                self._queue(name, Job(content))

    def set_aside(self, names: Collection[str]) -> None:
        """Queue the renaming of the slots of these records that an earlier version of the program wrote.

        While such slots exist, `examine` does not read the records.
        """
        for name in names:
            if find_earlier_slots(self._directory, name):
                with self._lock:
                    self._queue(earlier_name(name), Job(None, aside=name))

    def try_save(self, name: str, content: bytes, done: Callable[[bool], None]) -> None:
        """Queue a new version without retry; `service` calls done(True) when it is on disk.

        On an error the version is withdrawn, so that the next start loads the previous one, and done(False) is called.
        """
        with self._lock:
            self._queue(name, Job(content, no_retry=True))
            self._pending_callbacks.append(_PendingCallback({name: self._requested[name]}, done))

    def when_stored(self, names: Collection[str], call: Callable[[bool], None]) -> None:
        """Run call(True) from `service` when the names are on disk as last saved, call(False) on an error.

        Failed jobs are retried at once, except those of `try_save`.
        """
        with self._lock:
            failed = {name: self._failed[name].job for name in names if name in self._failed and name not in self._jobs}
            withdrawn = any(job.content is None for job in failed.values())
            for name, job in failed.items():
                self._queue(name, job)
            saves = {
                name: requested
                for name in names
                if (requested := self._requested.get(name, 0)) > self._completed.get(name, 0)
            }
            if saves:
                self._pending_callbacks.append(_PendingCallback(saves, call, not withdrawn))
            else:
                self._due_callbacks.append((call, True))
        if not saves:
            os.eventfd_write(self._wake_fd, 1)

    def on_mount(self, names: Collection[str], callback: Callable[[Mapping[str, Stored]], None]) -> None:
        """Run callback(content of the names) from `service` when a new directory is locked, before any write to it.

        A new directory did not exist at the start, or was mounted over the first one.
        """
        self._mount_callbacks.append((names, callback))

    def service(self) -> None:
        """Run the callbacks that are due."""
        try:
            os.eventfd_read(self._wake_fd)
        except BlockingIOError:
            return
        with self._lock:
            due_callbacks, self._due_callbacks = self._due_callbacks, deque()
        for call, stored in due_callbacks:
            call(stored)

    def settle(self) -> bool:
        """Wait until all jobs are done; return whether callbacks are due. Only for simulated time."""
        if self._idle_at == (self._requested_saves, self._attempts) and not self._due_callbacks:
            return False  # the usual case, several times per tick
        with self._lock:
            self._idle.wait_for(
                lambda: all(self._completed.get(name) == requested for name, requested in self._requested.items())
            )
            if self._due_callbacks:
                return True
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)  # there is no callback to run
            self._idle_at = (self._requested_saves, self._attempts)
            return False

    @property
    def written(self) -> tuple[int, int]:
        """Number of versions written since the start, and their bytes in whole blocks of 4 KiB."""
        return self._written

    def progress(self) -> Progress:
        """Return the number of completed saves, and whether more are requested."""
        thread, completed = self._thread, self._completed_saves
        is_busy = self._requested_saves > completed
        return Progress("state store", is_busy, completed, alive=thread.is_alive(), thread=thread.native_id)

    def close(self) -> None:
        """Finish the queued saves, retry failed ones once, and release the directory."""
        self._wake.put(True)
        self._thread.join(timeout=10.0)
        self._release()

    def _release(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._wake_fd)
        self._directory_lock.release()

    def _queue(self, name: str, job: Job) -> None:
        """Pass a job to the writer; the caller must have locked `_lock`."""
        was_idle = not self._jobs
        self._jobs[name] = job
        self._requested[name] = self._requested.get(name, 0) + 1
        self._requested_saves += 1
        if was_idle:
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
                self._lock_problem = f"state directory {self._directory} was removed or replaced"
            if self._lock_problem and retry:
                writer.close()
                writer = SlotWriter(self._directory, self._private)
                self._acquire_again()
            with self._lock:
                jobs = dict(self._jobs)
                for name, failure in self._failed.items() if retry else ():
                    jobs.setdefault(name, failure.job)
                for name in jobs.keys() & self._failed.keys():
                    if self._failed[name].job.both_slots:
                        jobs[name] = replace(jobs[name], both_slots=True)
                requested = {name: self._requested[name] for name in jobs}
                self._jobs = {}
            for name, job in jobs.items():
                result = write_job(writer, name, job, self._lock_problem)
                self._written = (writer.versions, writer.written_bytes)
                self._store_result(name, requested[name], result)
        writer.close()

    def _acquire_again(self) -> None:
        """Try to lock the directory again; pass the content of a new one to the callbacks before any write to it."""
        if self._lock_problem == _MOUNTING:
            return
        previous_identity = self._directory_lock.identity
        try:
            self._directory_lock.acquire(strict=False)
            finish_import(self._directory)
        except StoreError as error:
            self._lock_problem = str(error)
            return
        if self._directory_lock.identity == previous_identity:
            self._lock_problem = ""  # the same directory, whose content is known
            return
        callbacks = tuple(self._mount_callbacks)
        contents = {name: self.examine(name) for names, _call in callbacks for name in names}
        self._lock_problem = _MOUNTING

        def run_callbacks(_: bool) -> None:  # noqa: FBT001 - as the store's other callbacks
            for _names, call in callbacks:
                call(contents)
            self._lock_problem = ""

        with self._lock:
            self._due_callbacks.append((run_callbacks, True))
        os.eventfd_write(self._wake_fd, 1)

    def _store_result(self, name: str, requested: int, failure: Failure | None) -> None:
        """Store the result of a save of a name, and queue the callbacks whose saves are all completed."""
        with self._lock:
            self._completed_saves += requested - self._completed.get(name, 0)
            self._attempts += 1
            self._completed[name] = requested
            if failure is None:
                self._failed.pop(name, None)
            else:
                self._failed[name] = failure
            still_pending: deque[_PendingCallback] = deque()
            for pending_callback in self._pending_callbacks:
                if pending_callback.saves.get(name, requested + 1) <= requested:
                    del pending_callback.saves[name]
                    pending_callback.is_ok &= failure is None
                if pending_callback.saves:
                    still_pending.append(pending_callback)
                else:
                    self._due_callbacks.append((pending_callback.call, pending_callback.is_ok))
            self._pending_callbacks = still_pending
            os.eventfd_write(self._wake_fd, 1)
            self._idle.notify_all()
