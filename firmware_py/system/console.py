"""Prints the autopilot's messages without ever blocking the loop on a stuck terminal or pipe."""

from __future__ import annotations

import queue
import sys
import threading

LIMIT = 200


class Console:
    """A bounded queue of lines and the thread that writes them to standard error."""

    def __init__(self) -> None:
        """Start the writer."""
        self._lines: queue.Queue[str | None] = queue.Queue(LIMIT)
        self._thread = threading.Thread(target=self._write, name="console", daemon=True)
        self._thread.start()

    def line(self, text: str) -> None:
        """Queue a line; a full queue drops it."""
        try:
            self._lines.put_nowait(text)
        except queue.Full:
            return

    def close(self) -> None:
        """Write what is queued, for at most a second."""
        try:
            self._lines.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(timeout=1.0)

    def _write(self) -> None:
        while (text := self._lines.get()) is not None:
            try:
                print(text, file=sys.stderr, flush=True)  # noqa: T201 - the program's own messages
            except OSError:
                return  # nobody reads them any more
