"""Compresses closed logs and cuts out black boxes in small steps on the writer's thread.

The work per turn follows the rate of logging: one block, and twice the bytes written since the last turn. A closed log
of 64 MB is compressed in 15 min with 0.25 % of a processor, and no rate of logging is faster than that.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final

from firmware_py.files.packed import BLOCK_BYTES
from firmware_py.log.archive import archive_log
from firmware_py.log.black_box import AFTER_S, is_first_of_run, make_box
from firmware_py.log.disk import THIN, log_files

MIN_BOX_INTERVAL_S: Final = 600.0  # between the boxes of severe faults; a box covers about half of it
WRITE_DELAY_S: Final = 2.0  # a logged tick is on disk after this time
IDLE_TURNS: Final = 20  # pause when there is nothing to do; a turn is a second
RETRY_TURNS: Final = 60  # pause after a failure: the disk may be full or broken

Job = Iterator[None]


class ArchiveWorker:
    """Archives closed logs in small steps. A failed step is repeated later; `failure` holds the reason."""

    def __init__(self, directory: Path) -> None:
        """Archive the logs of a directory, except the newest one, which is being written."""
        self._directory = directory
        self._severe_s: deque[float] = deque(maxlen=4)  # times of pending boxes; the loop's thread appends
        self._next_box_s = -float("inf")
        self._now_s = 0.0
        self._box: Job | None = None
        self._archiving: Job | None = None
        self._log: Path | None = None  # the log of the current job
        self._failures: Counter[Path] = Counter()
        self._pause_turns = 0
        self.failure = ""

    # ------------------------------------------------------------- the loop's side

    def note_tick(self, t_s: float, *, severe: bool) -> None:
        """Record the time of a logged tick; a `severe` one requests a black box."""
        self._now_s = t_s
        if severe and t_s >= self._next_box_s:
            self._next_box_s = t_s + MIN_BOX_INTERVAL_S
            self._severe_s.append(t_s)

    # ----------------------------------------------------------- the writer's side

    def work(self, written_bytes: int) -> None:
        """Do a number of steps that follows the bytes written since the last call; store an error as text."""
        if self._pause_turns:
            self._pause_turns -= 1
            return
        try:
            for _ in range(1 + 2 * written_bytes // BLOCK_BYTES):
                if not self._step():
                    self._pause_turns = IDLE_TURNS
                    return
        except Exception as error:  # noqa: BLE001 - logging continues after any error
            if self._log is not None:
                self._failures[self._log] += 1
            self._box = self._archiving = None
            self._pause_turns = RETRY_TURNS
            text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
            self.failure = f"log: not compressed: {text}"

    def _step(self) -> bool:
        """Do a step of the most urgent job; False when there is none."""
        if self._box is None and self._severe_s and self._now_s >= self._severe_s[0] + AFTER_S + WRITE_DELAY_S:
            event_s = self._severe_s.popleft()
            logs = self._logs()
            self._box = make_box(logs[-1], f"{event_s:.0f}", event_s) if logs else None
        if self._box is not None:
            if next(self._box, self) is self:
                self._box = None
            return True
        if self._archiving is None:
            self._archiving = self._next_job()
        if self._archiving is None:
            self.failure = ""  # the failed job was done in the meantime, or its log was removed
            return False
        if next(self._archiving, self) is self:
            self._archiving, self.failure = None, ""
        return True

    def _next_job(self) -> Job | None:
        """Return the job of the oldest closed log with the fewest failures, None if all are archived."""
        closed = [pair for logs in (self._logs(), self._logs(THIN)) for pair in pairwise(logs)]
        plain = [(path, after) for path, after in closed if path.suffix == ".BIN"]
        if not plain:
            return None
        self._log, after = min(plain, key=lambda pair: self._failures[pair[0]])
        return self._close(self._log, after)

    def _close(self, log: Path, after: Path) -> Job:
        """Cut out the last minutes if the program ended at the end of this log, then compress it."""
        if log.parent == self._directory and is_first_of_run(after):
            yield from make_box(log, "end")
        yield from archive_log(log)

    def _logs(self, kind: str = "") -> list[Path]:
        directory = self._directory / kind
        return [path for _, path in sorted(log_files(directory).items())] if directory.is_dir() else []
