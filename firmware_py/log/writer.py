"""The background writer of the log: a bounded queue between the loop and the disk.

The loop's thread appends to a deque and compares counters. Each counter is changed by one thread only, and the threads
share no lock while the queue is less than half full, so the loop does not wait. The writer's thread wakes every
`flush_s` and empties the queue; its write and fdatasync calls release the interpreter lock. A power cut loses at most
the data of that interval and the ticks held by the recorder.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from firmware_py.common.records import Progress
from firmware_py.log.disk import Disk

CHUNK_BYTES: Final = 1 << 18  # written at once: limits the memory in addition to the queue
CLOSE_WAIT_S: Final = 10.0


class Batch(NamedTuple):
    """The bytes of one tick; with `opens_file` they start a new file."""

    data: bytes
    opens_file: bool


class LogWriter:
    """Appends batches to numbered files; after an error it requests a new file.

    `requested_files` counts the requests: one at the start and one after every error. Until a batch opens a file,
    batches are lost and counted in `lost`. `failure` is the text of the last error, empty after a success.
    """

    def __init__(
        self,
        directory: Path,
        disk: Disk,
        *,
        max_log_bytes: int,
        queue_batches: int,
        queue_bytes: int,
        flush_s: float,
        min_free_bytes: int = 0,
        wait_for_disk: bool = False,
        turn: Callable[[int], None] = lambda _written_bytes: None,
        finish: Callable[[], None] = lambda: None,
    ) -> None:
        """Write into a directory; before a new file, the oldest are removed until the rest has at most `max_log_bytes`.

        No file is created while less than `min_free_bytes` are free. With `wait_for_disk`, for simulated time, the loop
        waits until the first batch is on disk, and for space in the queue. `turn` is called after each work cycle, with
        the number of bytes taken from the queue in this cycle. A cycle starts on the writer's thread every `flush_s`
        and when the queue is half full; without a thread, only when it is half full. `finish` is called at the end.
        Neither may raise.
        """
        self._directory = directory
        self._disk = disk
        self._max_log_bytes = max_log_bytes
        self._min_free_bytes = min_free_bytes
        self._turn_callback = turn
        self._finish_callback = finish
        self._queue_batches = queue_batches
        self._queue_bytes = queue_bytes
        self._flush_s = flush_s
        self._queue: deque[Batch] = deque()
        self._queued_total_bytes = 0  # changed by the loop's thread only
        self._taken_total_bytes = 0  # changed by the writer's thread only, as all following
        self._file: tuple[int, Path] | None = None
        self._batches_in_file = 0
        self._unsynced_batches = 0
        self.requested_files = 1
        self._turns = 0
        self.lost = 0
        self.failure = ""
        self.low_space = False
        self.has_written = False  # at least one batch is on the medium
        self._closing = False
        self._wait_for_disk = wait_for_disk
        self._wake, self._work_done = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    # ------------------------------------------------------ called on the loop's thread

    def is_full(self) -> bool:
        """Return whether the queue is full, so that the next batch must be dropped."""
        queued_bytes = self._queued_total_bytes - self._taken_total_bytes
        return len(self._queue) >= self._queue_batches or queued_bytes >= self._queue_bytes

    def put(self, data: bytes, *, opens_file: bool) -> None:
        """Queue a batch of any size; the caller checks `is_full` first."""
        self._queue.append(Batch(data, opens_file))
        self._queued_total_bytes += len(data)
        is_half_full = (
            2 * len(self._queue) > self._queue_batches
            or 2 * (self._queued_total_bytes - self._taken_total_bytes) > self._queue_bytes
        )
        if is_half_full and self._thread is None:
            self.work()
        elif is_half_full:
            self._wake.set()
        if self._wait_for_disk and (thread := self._thread) is not None:
            while thread.is_alive() and (self.is_full() or not (self.has_written or self.failure)):
                self._work_done.clear()
                self._wake.set()
                if not self._work_done.wait(CLOSE_WAIT_S):
                    break

    def start(self) -> None:
        """Start the writer's thread."""
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def is_alive(self) -> bool:
        """Return whether the thread is running; True if none has been started or the writer is closing."""
        return self._thread is None or self._closing or self._thread.is_alive()

    def progress(self) -> tuple[Progress, ...]:
        """Return the number of work cycles, which increases at least every `flush_s`; empty without a thread."""
        thread = self._thread
        if thread is None or self._closing:
            return ()
        return (Progress("log", True, self._turns, alive=thread.is_alive(), thread=thread.native_id),)

    def close(self) -> None:
        """Write the queue and close the file; give up after CLOSE_WAIT_S if the disk blocks."""
        self._closing = True
        if self._thread is None:
            self._finish()
        else:
            self._wake.set()
            self._thread.join(CLOSE_WAIT_S)

    # ---------------------------------------------------- called on the writer's thread

    def _run(self) -> None:
        while not self._closing:
            self._wake.wait(self._flush_s)
            self._wake.clear()
            self.work()
        self._finish()

    def work(self) -> None:
        """Do a work cycle: write the queue, then call `turn`."""
        taken_before_bytes = self._taken_total_bytes
        self.drain()
        self._turn_callback(self._taken_total_bytes - taken_before_bytes)
        self._turns += 1
        self._work_done.set()

    def _finish(self) -> None:
        self.drain()
        self._finish_callback()
        self._close_file()

    def drain(self) -> None:
        """Write and sync the queue; errors are stored and counted, not raised."""
        chunk: list[bytes] = []
        chunk_bytes = 0
        for _ in range(len(self._queue)):
            batch = self._queue.popleft()
            self._taken_total_bytes += len(batch.data)
            if batch.opens_file or chunk_bytes >= CHUNK_BYTES:
                self._write(chunk)
                chunk, chunk_bytes = [], 0
            if batch.opens_file:
                self._close_file()
                self._open_file()
            chunk.append(batch.data)
            chunk_bytes += len(batch.data)
        self._write(chunk)
        self._sync()
        self._check_free_space()

    def _check_free_space(self) -> None:
        with contextlib.suppress(OSError):
            self.low_space = self._disk.free_bytes(self._directory) < self._min_free_bytes

    def _open_file(self) -> None:
        try:
            self._disk.prune(self._directory, self._max_log_bytes)
            if self._disk.free_bytes(self._directory) < self._min_free_bytes:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # noqa: TRY301 - as the disk would
            self._file = self._disk.create(self._directory)
        except OSError as error:
            self._fail(error)
        self._batches_in_file = 0

    def _write(self, chunk: list[bytes]) -> None:
        if self._file is None:
            self.lost += len(chunk)
            return
        data = memoryview(b"".join(chunk))
        written = 0
        try:
            while written < len(data):
                written += self._disk.write(self._file[0], data[written:])
        except OSError as error:
            written_batches = _count_whole_batches(chunk, written)
            self._batches_in_file += written_batches
            self.lost += len(chunk) - written_batches
            self._fail(error)
            return
        self._batches_in_file += len(chunk)
        self._unsynced_batches += len(chunk)

    def _sync(self) -> None:
        if self._file is None or self._unsynced_batches == 0:
            return
        try:
            self._disk.sync(self._file[0])
        except OSError as error:
            self.lost += self._unsynced_batches
            self._batches_in_file -= self._unsynced_batches
            self._fail(error)
            return
        self._unsynced_batches = 0
        self.has_written = True
        self.failure = ""

    def _close_file(self) -> None:
        self._sync()
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._disk.close(self._file[0])
            self._file = None

    def _fail(self, error: OSError) -> None:
        """Close the file and request a new one; remove the file if it contains no complete tick."""
        self.failure = f"log: {error.strerror or error}"
        self._unsynced_batches = 0
        if self._file is not None:
            descriptor, path = self._file
            self._file = None
            with contextlib.suppress(OSError):
                self._disk.close(descriptor)
            if self._batches_in_file == 0:
                with contextlib.suppress(OSError):
                    self._disk.remove(path)
        self.requested_files += 1


def _count_whole_batches(chunk: list[bytes], written: int) -> int:
    """Return the number of batches that are completely within the first `written` bytes."""
    count = 0
    for data in chunk:
        written -= len(data)
        if written < 0:
            break
        count += 1
    return count
