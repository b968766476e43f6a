"""Prints the messages of the autopilot without blocking the loop on a blocked terminal or pipe.

Lines are written to the descriptor, not to a Python stream: unflushed data of a stream would change the exit code, and
a thread that waits with the lock of a stream would abort the process at its end.
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
        """Start the thread."""
        self._lines: queue.Queue[str | None] = queue.Queue(MAX_QUEUED_LINES)
        self._lost_lines = 0
        self._printed_early: list[str] = []
        self._thread = threading.Thread(target=self._write_queue, name="console", daemon=True)
        self._thread.start()

    def line(self, text: str) -> None:
        """Queue a line; drop and count it if the queue is full."""
        try:
            self._lines.put_nowait(text)
        except queue.Full:
            self._lost_lines += 1

    def print_early(self, text: str) -> None:
        """Queue the text of an event of the first tick before that tick, in case the start fails."""
        self._printed_early.append(text)
        self.line(text)

    def event(self, head: str, text: str) -> None:
        """Queue the line of an event unless `print_early` has printed it."""
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

    def _write_queue(self) -> None:
        while (text := self._lines.get()) is not None:
            lost = self._lost_lines
            if lost and _write_line(f"({lost} lines lost: output was blocked)"):
                self._lost_lines -= lost
            if not _write_line(text):
                self._lost_lines += 1


def _write_line(text: str) -> bool:
    """Write a line and wait for the reader; return False on an error such as a closed pipe or a full disk."""
    unwritten = f"{text}\n".encode(errors="backslashreplace")
    try:
        while unwritten:
            try:
                unwritten = unwritten[os.write(STANDARD_ERROR, unwritten) :]
            except BlockingIOError:  # another program has set the shared terminal to non-blocking
                select.select([], [STANDARD_ERROR], [])
    except (OSError, ValueError):
        return False
    return True
