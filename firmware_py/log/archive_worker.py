"""Compresses closed logs and creates black boxes in small steps on the writer's thread.

Each turn processes one block and twice the bytes written since the last turn, so compression is faster than any rate of
logging. A closed log of 64 MB is compressed in 15 min with 0.25 % of a processor.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final

from firmware_py.files.packed import BLOCK_BYTES
from firmware_py.log.archive import archive_log
from firmware_py.log.black_box import AFTER_EVENT_S, is_first_of_run, make_box
from firmware_py.log.disk import THIN, log_files

MIN_BOX_INTERVAL_S: Final = 600.0  # between the boxes of severe faults; a box covers about half of this interval
WRITE_DELAY_S: Final = 2.0  # maximum time until a logged tick is on disk
IDLE_TURNS: Final = 20  # pause without a job; a turn is a second
RETRY_TURNS: Final = 60  # pause after a failure: the disk may be full or broken

Job = Iterator[None]


class ArchiveWorker:
    """Archives closed logs in small steps; a failed one is repeated later, but not the black box of a fault.

    `failure` is the reason or empty.
    """

    def __init__(self, directory: Path) -> None:
        """Archive the logs of a directory, except the newest one, which is being written."""
        self._directory = directory
        self._pending_events_s: deque[float] = deque(maxlen=4)  # times of pending boxes; the loop's thread appends
        self._next_box_s = -float("inf")
        self._now_s = 0.0
        self._box_job: Job | None = None
        self._archive_job: Job | None = None
        self._current_log: Path | None = None  # the log of the current job
        self._failures: Counter[Path] = Counter()
        self._pause_turns = 0
        self.failure = ""

    # ------------------------------------------------------ called on the loop's thread

    def note_tick(self, t_s: float, *, is_severe: bool) -> None:
        """Store the time of a logged tick; a severe fault requests a black box, at most one per MIN_BOX_INTERVAL_S."""
        self._now_s = t_s
        if is_severe and t_s >= self._next_box_s:
            self._next_box_s = t_s + MIN_BOX_INTERVAL_S
            self._pending_events_s.append(t_s)

    # ---------------------------------------------------- called on the writer's thread

    def work(self, written_bytes: int) -> None:
        """Do steps in proportion to the bytes written since the last call; store an error as text."""
        if self._pause_turns:
            self._pause_turns -= 1
            return
        try:
            for _ in range(1 + 2 * written_bytes // BLOCK_BYTES):
                if not self._step():
                    self._pause_turns = IDLE_TURNS
                    return
        except Exception as error:  # noqa: BLE001 - logging continues after any error
            if self._current_log is not None:
                self._failures[self._current_log] += 1
            self._box_job = self._archive_job = None
            self._pause_turns = RETRY_TURNS
            text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
            self.failure = f"log: not compressed: {text}"

    def _step(self) -> bool:
        """Do a step of the most urgent job; return False without a job."""
        if (
            self._box_job is None
            and self._pending_events_s
            and self._now_s >= self._pending_events_s[0] + AFTER_EVENT_S + WRITE_DELAY_S
        ):
            event_s = self._pending_events_s.popleft()
            logs = self._list_logs()
            self._box_job = make_box(logs[-1], f"{event_s:.0f}", event_s) if logs else None
        if self._box_job is not None:
            if next(self._box_job, self) is self:
                self._box_job = None
            return True
        if self._archive_job is None:
            self._archive_job = self._next_job()
        if self._archive_job is None:
            self.failure = ""  # the failed job was done in the meantime, or its log was removed
            return False
        if next(self._archive_job, self) is self:
            self._archive_job, self.failure = None, ""
        return True

    def _next_job(self) -> Job | None:
        """Return the job of the oldest among the closed logs with the fewest failures, None if all are archived."""
        closed_logs = [pair for logs in (self._list_logs(), self._list_logs(THIN)) for pair in pairwise(logs)]
        uncompressed = [(path, next_log) for path, next_log in closed_logs if path.suffix == ".BIN"]
        if not uncompressed:
            return None
        self._current_log, next_log = min(uncompressed, key=lambda pair: self._failures[pair[0]])
        return self._archive_closed_log(self._current_log, next_log)

    def _archive_closed_log(self, log: Path, next_log: Path) -> Job:
        """Create a black box if the program ended with this log, then compress the log."""
        if log.parent == self._directory and is_first_of_run(next_log):
            yield from make_box(log, "end")
        yield from archive_log(log)

    def _list_logs(self, subdirectory: str = "") -> list[Path]:
        directory = self._directory / subdirectory
        return [path for _, path in sorted(log_files(directory).items())] if directory.is_dir() else []
