"""Thread for long disk operations of the link. The loop receives the results on its own thread."""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

from firmware_py.common.records import Progress

THREAD_NAME = "link files"
_MAX_JOBS = 32
_MAX_JOB_S = 300.0  # a job may read a log of 2 GiB

Job = Callable[[], Any]
Callback = Callable[[Any], None]  # its argument is the result, or the exception of the job


class Worker:
    """Bounded queue of jobs, executed one after the other.

    Without `background`, `submit` executes the job on the thread of the caller: for tests and links without storage.
    """

    def __init__(self, *, background: bool) -> None:
        """Start the thread. Call this before the loop sets its priority, since the thread would inherit it."""
        self._jobs: SimpleQueue[tuple[Job, Callback] | None] = SimpleQueue()
        self._results: deque[tuple[Callback, Any]] = deque()
        self._pending_count = 0
        self._done_count = 0  # written by the thread only
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC) if background else -1
        self._thread: threading.Thread | None = None
        if background:
            self._thread = threading.Thread(target=self._work, name=THREAD_NAME, daemon=True)
            try:
                self._thread.start()
            except RuntimeError:  # no thread is available
                os.close(self._wake_fd)
                raise

    def fileno(self) -> int:
        """Return the descriptor that is readable when `poll` has results; -1 without a thread."""
        return self._wake_fd

    @property
    def has_pending_jobs(self) -> bool:
        """Whether there are jobs whose callback was not called yet."""
        return self._pending_count > 0

    def submit(self, job: Job, callback: Callback) -> bool:
        """Queue a job, whose callback is called by `poll`; return False if the queue is full."""
        if self._thread is None:
            callback(_result_of(job))
            return True
        if self._pending_count >= _MAX_JOBS:
            return False
        self._pending_count += 1
        self._jobs.put((job, callback))
        return True

    def poll(self) -> None:
        """Call the callbacks of the finished jobs."""
        if self._thread is not None:
            # The event is read before the results, so that a later event is not lost.
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
        for _ in range(len(self._results)):
            callback, result = self._results.popleft()
            self._pending_count -= 1
            callback(result)

    def progress(self) -> tuple[Progress, ...]:
        """Return the progress of the thread; empty without one."""
        thread = self._thread
        if thread is None:
            return ()
        has_work = self._pending_count > len(self._results)
        return (Progress(THREAD_NAME, has_work, self._done_count, _MAX_JOB_S, thread.is_alive(), thread.native_id),)

    def close(self) -> None:
        """Finish the queued jobs and end the thread; wait at most 10 s, since a disk may not respond."""
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
            job, callback = entry
            # The result is stored before the event, so that a reader of the event finds the result.
            self._results.append((callback, _result_of(job)))
            self._done_count += 1
            os.eventfd_write(self._wake_fd, 1)


def _result_of(job: Job) -> Any:
    """Execute a job; return its result or exception."""
    try:
        return job()
    except Exception as failure:  # noqa: BLE001 - any exception is the result of the job
        return failure
