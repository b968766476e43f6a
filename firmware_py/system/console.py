"""Prints the autopilot's messages without ever blocking the loop on a stuck terminal or pipe.

Lines go to the descriptor itself: what Python keeps for a stream that takes nothing would spoil the exit code, and a
lock held by a thread that waits for the reader would end the process with an abort.
"""

from __future__ import annotations

import os
import queue
import select
import threading

LIMIT = 200
STANDARD_ERROR = 2


class Console:
    """A bounded queue of lines and the thread that writes them to standard error."""

    def __init__(self) -> None:
        """Start the writer."""
        self._lines: queue.Queue[str | None] = queue.Queue(LIMIT)
        self._lost = 0
        self._ahead: list[str] = []
        self._thread = threading.Thread(target=self._write, name="console", daemon=True)
        self._thread.start()

    def line(self, text: str) -> None:
        """Queue a line; a full queue drops it, which is said when there is room again."""
        try:
            self._lines.put_nowait(text)
        except queue.Full:
            self._lost += 1

    def ahead(self, text: str) -> None:
        """Queue what an event is to tell with the first tick, which a start that fails does not come to."""
        self._ahead.append(text)
        self.line(text)

    def event(self, head: str, text: str) -> None:
        """Queue the line of an event, unless it was said ahead."""
        if text in self._ahead:
            self._ahead.remove(text)
        else:
            self.line(f"{head} {text}")

    def close(self) -> None:
        """Write what is queued, for at most a second."""
        try:
            self._lines.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(timeout=1.0)

    def _write(self) -> None:
        while (text := self._lines.get()) is not None:
            lost = self._lost
            if lost and _written(f"({lost} lines lost: nobody has read them)"):
                self._lost -= lost
            if not _written(text):
                self._lost += 1


def _written(text: str) -> bool:
    """Write a line, however long its reader takes; False when it cannot be had: a pipe closed, a disk full."""
    left = f"{text}\n".encode(errors="backslashreplace")
    try:
        while left:
            try:
                left = left[os.write(STANDARD_ERROR, left) :]
            except BlockingIOError:  # somebody who shares the terminal has set it so
                select.select([], [STANDARD_ERROR], [])
    except (OSError, ValueError):
        return False
    return True
