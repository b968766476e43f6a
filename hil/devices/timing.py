"""Timing of emulated devices: a periodic clock, and the transfer time of each byte.

Time is an argument; this module reads no clock.
"""

from __future__ import annotations

import math
from collections import deque

BITS_PER_BYTE = 10  # one start bit, eight data bits, one stop bit
MAX_QUEUED_MESSAGES = 64  # in a transmitter; further messages are dropped
MAX_PERIODS_PER_CALL = 8  # returned by one call; older ones are skipped, the phase is kept


def transfer_s(count: int, baud: int) -> float:
    """Return the time that `count` bytes take on a line."""
    return count * BITS_PER_BYTE / baud


class Pace:
    """The times start_s + n period_s / (1 + error_ppm 1e-6) of a device with its own clock.

    `error_ppm` is the frequency error of the clock. Times are computed from a count, so rounding errors do not add up.
    """

    def __init__(self, period_s: float, *, start_s: float = 0.0, error_ppm: float = 0.0) -> None:
        """Start at start_s; raise ValueError for a period that is not positive."""
        if not (math.isfinite(period_s) and period_s > 0.0):
            raise ValueError(f"the period must be positive, not {period_s}")
        self._period_s = period_s / (1.0 + error_ppm * 1e-6)
        self._start_s = start_s
        self._count = 0

    @property
    def next_s(self) -> float:
        """The next time that has not been taken."""
        return self._start_s + self._count * self._period_s

    def take(self, now_s: float) -> list[float]:
        """Return the times up to now_s that have not been taken, at most the last eight."""
        if now_s < self.next_s:
            return []
        last = math.floor((now_s - self._start_s) / self._period_s)
        last = max(last, self._count)
        # The division may round to just below an integer; the due time would then never be taken.
        if self._start_s + (last + 1) * self._period_s <= now_s:
            last += 1
        first = max(self._count, last - MAX_PERIODS_PER_CALL + 1)
        self._count = last + 1
        return [self._start_s + period * self._period_s for period in range(first, last + 1)]


class Transmitter:
    """The transmitter of a UART: messages leave one after the other at the baud rate.

    A message is complete when its last byte has left. With `is_on_real_line` the line itself takes that time, so the
    message is complete when its first byte may leave.
    """

    def __init__(self, baud: int) -> None:
        """Start with an empty queue; raise ValueError for a baud rate that is not positive."""
        if baud <= 0:
            raise ValueError(f"the baud rate must be positive, not {baud}")
        self.baud = baud
        self.is_on_real_line = False
        self._queue: deque[tuple[float, float, bytes]] = deque()

    def send(self, start_s: float, data: bytes) -> float:
        """Queue a message that may start at start_s; return when it is complete (infinity: the queue is full)."""
        if len(self._queue) >= MAX_QUEUED_MESSAGES:
            return math.inf
        begin_s = max(start_s, self._queue[-1][1]) if self._queue else start_s
        end_s = begin_s + (0.0 if self.is_on_real_line else transfer_s(len(data), self.baud))
        self._queue.append((begin_s, end_s, data))
        return end_s

    def next_s(self) -> float:
        """Return when the next message is complete, or infinity."""
        return self._queue[0][1] if self._queue else math.inf

    def last_s(self) -> float:
        """Return when the last message is complete; minus infinity for an empty queue."""
        return self._queue[-1][1] if self._queue else -math.inf

    def occupies(self, begin_s: float, end_s: float) -> bool:
        """Return whether a message is transmitted at some time within the open interval."""
        return any(begin_s < end and start < end_s for start, end, _ in self._queue)

    def take(self, now_s: float) -> bytes:
        """Return the messages complete at or before now_s and remove them."""
        complete = []
        while self._queue and self._queue[0][1] <= now_s:
            complete.append(self._queue.popleft()[2])
        return b"".join(complete)

    def clear(self) -> None:
        """Discard all bytes, as in a power failure."""
        self._queue.clear()


class ReceiveBuffer:
    """Bytes of an incomplete message; the bytes after a pause on the line begin a new one.

    The owner removes decoded messages from the front of `data`.
    """

    def __init__(self, *, max_bytes: int, pause_s: float = 0.010) -> None:
        """Keep at most the last `max_bytes` bytes."""
        self.data = bytearray()
        self._max_bytes = max_bytes
        self._pause_s = pause_s
        self._received_s = -math.inf

    def append(self, now_s: float, data: bytes) -> None:
        """Add bytes that were complete at now_s; after a pause older bytes are dropped."""
        if now_s - self._received_s > self._pause_s:
            self.data.clear()
        self._received_s = now_s
        self.data += data
        del self.data[: max(0, len(self.data) - self._max_bytes)]

    def clear(self) -> None:
        """Discard all bytes, as in a power failure."""
        self.data.clear()
