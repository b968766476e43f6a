"""Sharing of one port by two drivers: a satellite compass sends headings and positions on one line."""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.interfaces import ByteLine

MAX_READ_BYTES = 4096
MAX_QUEUED_BYTES = 65536  # a second driver that does not read must not fill the memory


class LineTee:
    """Passes every byte of a line to two views.

    Only `first_view` reads the port and has its descriptor; `second_view` returns the bytes that `first_view` has read,
    so its driver is called after that of `first_view`. Both may write.
    """

    def __init__(self, line: ByteLine) -> None:
        """Create both views; only they may read the line."""
        self._line = line
        self._openings = line.openings
        self._queue = bytearray()
        self.first_view: ByteLine = _View(line, self._read_port, line.fileno)
        self.second_view: ByteLine = _View(line, self._read_queue, lambda: -1)

    def _read_port(self) -> bytes:
        """Read the port and queue a copy for the second view."""
        self._discard_stale_bytes()
        data = self._line.read()
        self._queue += data
        del self._queue[:-MAX_QUEUED_BYTES]
        return data

    def _read_queue(self) -> bytes:
        """Return bytes that the first view has read."""
        self._discard_stale_bytes()
        data = bytes(self._queue[:MAX_READ_BYTES])
        del self._queue[:MAX_READ_BYTES]
        return data

    def _discard_stale_bytes(self) -> None:
        """Drop bytes from before the line was opened again."""
        if self._line.openings != self._openings:
            self._openings = self._line.openings
            self._queue.clear()


class _View:
    """The line of one driver, with its own `read` and `fileno`."""

    def __init__(self, line: ByteLine, read: Callable[[], bytes], fileno: Callable[[], int]) -> None:
        self._line = line
        self.read = read
        self.fileno = fileno
        self.write = line.write

    @property
    def name(self) -> str:
        return self._line.name

    @property
    def baud(self) -> int:
        return self._line.baud

    @property
    def openings(self) -> int:
        return self._line.openings

    @property
    def connected(self) -> bool:
        return self._line.connected
