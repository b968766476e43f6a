"""One port for two drivers: a satellite compass sends headings and positions on one line."""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.interfaces import ByteLine

READ_LIMIT = 4096
QUEUE_LIMIT = 65536  # a second driver that does not read must not fill the memory


class LineTee:
    """Passes every byte of a line to two views.

    Only `first` reads the port and owns its descriptor; `second` returns the bytes that `first` has read, so it is
    served after `first`. Both may write.
    """

    def __init__(self, line: ByteLine) -> None:
        """Share the line; only the views may read it."""
        self._line = line
        self._openings = line.openings
        self._queue = bytearray()
        self.first: ByteLine = _View(line, self._pull, line.fileno)
        self.second: ByteLine = _View(line, self._take, lambda: -1)

    def _pull(self) -> bytes:
        """Read the port and queue a copy for the second view."""
        self._forget_old()
        data = self._line.read()
        self._queue += data
        if len(self._queue) > QUEUE_LIMIT:
            del self._queue[:-QUEUE_LIMIT]
        return data

    def _take(self) -> bytes:
        """Return bytes that the first view has read."""
        self._forget_old()
        data = bytes(self._queue[:READ_LIMIT])
        del self._queue[:READ_LIMIT]
        return data

    def _forget_old(self) -> None:
        """Drop bytes from before the line was opened again."""
        if self._line.openings != self._openings:
            self._openings = self._line.openings
            self._queue.clear()


class _View:
    """The line as seen by one driver, with its own `read` and `fileno`."""

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
