"""A thread for long disk work of the link; results are returned on the loop's thread."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from firmware_py.common.records import Progress

THREAD = "link files"
_MAX_JOBS = 32
_PATIENCE_S = 300.0  # a job may read a log of 2 GiB

Job = Callable[[], Any]
Done = Callable[[Any], None]  # takes the result, or the exception that ended the job


class Worker:
    """A bounded queue of jobs, executed one after the other.

    Without `background` a job is executed at once on the caller's thread: for tests, and without storage.
    """

    def __init__(self, *, background: bool) -> None:
        """Start the thread, before the loop sets its priority, which the thread would inherit."""
        self._jobs: SimpleQueue[tuple[Job, Done] | None] = SimpleQueue()
        self._results: deque[tuple[Done, Any]] = deque()
        self._under_way = 0
        self._done = 0  # changed by the thread alone
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC) if background else -1
        self._thread: threading.Thread | None = None
        if background:
            self._thread = threading.Thread(target=self._work, name=THREAD, daemon=True)
            try:
                self._thread.start()
            except RuntimeError:  # no thread is available
                os.close(self._wake_fd)
                raise

    def fileno(self) -> int:
        """The descriptor that is readable when `poll` has results, or -1."""
        return self._wake_fd

    @property
    def has_pending_jobs(self) -> bool:
        """Whether there are jobs whose results `poll` has not returned."""
        return self._under_way > 0

    def submit(self, job: Job, done: Done) -> bool:
        """Queue a job; `done` is called by `poll`. False if there are too many."""
        if self._thread is None:
            done(_result_of(job))
            return True
        if self._under_way >= _MAX_JOBS:
            return False
        self._under_way += 1
        self._jobs.put((job, done))
        return True

    def poll(self) -> None:
        """Call `done` of the finished jobs."""
        if self._wake_fd >= 0:
            # The event is read before the results: one that is set late is then seen the next time.
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
        for _ in range(len(self._results)):
            done, result = self._results.popleft()
            self._under_way -= 1
            done(result)

    def progress(self) -> tuple[Progress, ...]:
        """Return the progress of the thread; empty without one."""
        thread = self._thread
        if thread is None:
            return ()
        has_work = self._under_way > len(self._results)
        return (Progress(THREAD, has_work, self._done, _PATIENCE_S, thread.is_alive(), thread.native_id),)

    def close(self) -> None:
        """Finish the queued jobs and end the thread; give up on a disk that hangs."""
        if self._thread is None:
            return
        self._jobs.put(None)
        self._thread.join(timeout=10.0)
        self._thread = None
        os.close(self._wake_fd)
        self._wake_fd = -1

    def _work(self) -> None:
        while True:
            entry = self._jobs.get()
            if entry is None:
                return
            job, done = entry
            # The result before the event, so that a reader of the event finds the result.
            self._results.append((done, _result_of(job)))
            self._done += 1
            os.eventfd_write(self._wake_fd, 1)


def _result_of(job: Job) -> Any:
    try:
        return job()
    except Exception as failure:  # noqa: BLE001 - any exception is the result of the job
        return failure
