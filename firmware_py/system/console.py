"""Prints the messages of the autopilot without blocking the loop on a stuck terminal or pipe.

Lines are written to the descriptor: unflushed data of a Python stream would change the exit code, and the lock of a
stream held by a waiting thread would abort the process at its end.
"""

from __future__ import annotations

import os
import queue
import select
import threading

MAX_QUEUED_LINES = 200
STANDARD_ERROR = 2


class Console:
    """A bounded queue of lines and the thread that writes them to standard error."""

    def __init__(self) -> None:
        """Start the writer."""
        self._lines: queue.Queue[str | None] = queue.Queue(MAX_QUEUED_LINES)
        self._lost_lines = 0
        self._printed_early: list[str] = []
        self._thread = threading.Thread(target=self._write, name="console", daemon=True)
        self._thread.start()

    def line(self, text: str) -> None:
        """Queue a line; a full queue drops and counts it."""
        try:
            self._lines.put_nowait(text)
        except queue.Full:
            self._lost_lines += 1

    def ahead(self, text: str) -> None:
        """Queue the text of an event of the first tick early, in case the start fails before it."""
        self._printed_early.append(text)
        self.line(text)

    def event(self, head: str, text: str) -> None:
        """Queue the line of an event unless it was printed early."""
        if text in self._printed_early:
            self._printed_early.remove(text)
        else:
            self.line(f"{head} {text}")

    def close(self) -> None:
        """Write the queue, for at most a second."""
        try:
            self._lines.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(timeout=1.0)

    def _write(self) -> None:
        while (text := self._lines.get()) is not None:
            lost = self._lost_lines
            if lost and _written(f"({lost} lines lost: output was blocked)"):
                self._lost_lines -= lost
            if not _written(text):
                self._lost_lines += 1


def _written(text: str) -> bool:
    """Write a line, waiting for the reader; False on an error such as a closed pipe or a full disk."""
    left = f"{text}\n".encode(errors="backslashreplace")
    try:
        while left:
            try:
                left = left[os.write(STANDARD_ERROR, left) :]
            except BlockingIOError:  # another program has set the shared terminal to non-blocking
                select.select([], [STANDARD_ERROR], [])
    except (OSError, ValueError):
        return False
    return True
