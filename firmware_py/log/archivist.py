"""Keeps months: compresses closed logs and cuts out black boxes, a small step at a time, on the writer's thread.

How much is done follows what is written: a block a turn, and twice what has come since. So a closed log of 64 MB is
compressed in a quarter of an hour for a quarter of a percent of a processor, and no rate of logging outruns it.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final

from firmware_py.files.packed import BLOCK_BYTES
from firmware_py.log.black_box import AFTER_S, begins_a_run, make_box
from firmware_py.log.disk import THIN, log_files
from firmware_py.log.pack import pack_log

SPACING_S: Final = 600.0  # between the boxes of severe faults, each of which holds half of that
WRITTEN_S: Final = 2.0  # after which a tick that was logged is on disk
IDLE_TURNS: Final = 20  # with nothing to do; a turn is a second
PATIENCE_TURNS: Final = 60  # after a failure: a disk that is full or ill is not asked each second

Job = Iterator[None]


class Archivist:
    """Works in small steps at logs that are closed; what fails is tried again later, and `failure` says why."""

    def __init__(self, directory: Path) -> None:
        """Work in a directory of logs, whose newest is being written."""
        self._directory = directory
        self._severe_s: deque[float] = deque(maxlen=4)  # boxes that are due; appended to by the loop's thread
        self._next_box_s = -float("inf")
        self._now_s = 0.0
        self._box: Job | None = None
        self._packing: Job | None = None
        self._log: Path | None = None  # that the job at hand is about
        self._failures: Counter[Path] = Counter()
        self._resting = 0
        self.failure = ""

    # ------------------------------------------------------------- the loop's side

    def note_tick(self, t_s: float, *, severe: bool) -> None:
        """Take the time of a tick that is being logged; the minutes around a `severe` one are kept."""
        self._now_s = t_s
        if severe and t_s >= self._next_box_s:
            self._next_box_s = t_s + SPACING_S
            self._severe_s.append(t_s)

    # ----------------------------------------------------------- the writer's side

    def work(self, written_bytes: int) -> None:
        """Do as many steps as what has been written since the last call asks for; an error is kept as text."""
        if self._resting:
            self._resting -= 1
            return
        try:
            for _ in range(1 + 2 * written_bytes // BLOCK_BYTES):
                if not self._step():
                    self._resting = IDLE_TURNS
                    return
        except Exception as error:  # noqa: BLE001 - whatever it is, the log goes on being written
            if self._log is not None:
                self._failures[self._log] += 1
            self._box = self._packing = None
            self._resting = PATIENCE_TURNS
            text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
            self.failure = f"log: not compressed: {text}"

    def _step(self) -> bool:
        """Do a step of the most urgent job; False when there is none."""
        if self._box is None and self._severe_s and self._now_s >= self._severe_s[0] + AFTER_S + WRITTEN_S:
            event_s = self._severe_s.popleft()
            logs = self._logs()
            self._box = make_box(logs[-1], f"{event_s:.0f}", event_s) if logs else None
        if self._box is not None:
            if next(self._box, self) is self:
                self._box = None
            return True
        if self._packing is None:
            self._packing = self._next_job()
        if self._packing is None:
            self.failure = ""  # what was to be done has been done since, or has gone
            return False
        if next(self._packing, self) is self:
            self._packing, self.failure = None, ""
        return True

    def _next_job(self) -> Job | None:
        """Return what is to be done for the oldest closed log that has failed least often, None without one."""
        closed = [pair for logs in (self._logs(), self._logs(THIN)) for pair in pairwise(logs)]
        plain = [(path, after) for path, after in closed if path.suffix == ".BIN"]
        if not plain:
            return None
        self._log, after = min(plain, key=lambda pair: self._failures[pair[0]])
        return self._close(self._log, after)

    def _close(self, log: Path, after: Path) -> Job:
        """Keep the last minutes of a log at whose end the program ended, then compress it."""
        if log.parent == self._directory and begins_a_run(after):
            yield from make_box(log, "end")
        yield from pack_log(log)

    def _logs(self, kind: str = "") -> list[Path]:
        directory = self._directory / kind
        return [path for _, path in sorted(log_files(directory).items())] if directory.is_dir() else []
