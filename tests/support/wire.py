"""A simulated RS-485 line between two ports, with byte times, echo and collisions."""

import heapq
import select
import threading
import time

from hil.devices.pty_line import PtyLine
from hil.devices.timing import BITS_PER_BYTE

MAX_WAIT_S = 0.005


class Wire:
    """A half-duplex line between two ptys, like two serial adapters on one bus.

    A byte arrives after its time at the baud rate, at the other end and, with `echo`, at its own end. Two bytes at the
    same time are damaged (`collisions`). `before_collision_s` is the longest reply time, or delay of this thread,
    before the first collision: it is large if a process did not get the processor.
    """

    def __init__(self, here, there, baud, *, echo=True, half_duplex=True):
        """Create the two ports and start the line, in real time."""
        self.collisions = 0
        self.before_collision_s = None
        self._slowest_s = 0.0
        self._request_s = None  # time of a request without a reply
        self._loop_s = time.monotonic()
        self._ends = (PtyLine(here), PtyLine(there))
        self._byte_s = BITS_PER_BYTE / baud
        self._echo, self._half_duplex = echo, half_duplex
        self._free_s = [0.0, 0.0]  # end of the last byte of each end
        self._pending_bytes = []  # (time of arrival, count, sending end, byte)
        self._count = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        for end in self._ends:
            end.close()

    def _carry(self):
        numbers = {end.fileno(): number for number, end in enumerate(self._ends)}
        while not self._stop.is_set():
            due_s = self._pending_bytes[0][0] - time.monotonic() if self._pending_bytes else MAX_WAIT_S
            ready = select.select(numbers, [], [], max(0.0, min(due_s, MAX_WAIT_S)))[0]
            previous_s, self._loop_s = self._loop_s, time.monotonic()
            self._slowest_s = max(self._slowest_s, self._loop_s - previous_s)
            for descriptor in ready:
                self._take(numbers[descriptor], time.monotonic())
            self._deliver(time.monotonic())

    def _take(self, number, now_s):
        data = self._ends[number].read()
        if data and number == 0 and self._request_s is None:
            self._request_s = now_s
        elif data and number and self._request_s is not None:
            self._slowest_s = max(self._slowest_s, now_s - self._request_s)
            self._request_s = None
        for output in data:
            begin_s = max(now_s, self._free_s[number])
            self._free_s[number] = begin_s + self._byte_s
            collides = self._half_duplex and begin_s < self._free_s[1 - number]
            self.collisions += collides
            if collides and self.before_collision_s is None:
                self.before_collision_s = self._slowest_s
            self._count += 1
            heap_entry = (self._free_s[number], self._count, number, output ^ (0x55 if collides else 0))
            heapq.heappush(self._pending_bytes, heap_entry)

    def _deliver(self, now_s):
        pieces = (bytearray(), bytearray())
        while self._pending_bytes and self._pending_bytes[0][0] <= now_s:
            _, _, number, byte = heapq.heappop(self._pending_bytes)
            pieces[1 - number].append(byte)
            if self._echo:
                pieces[number].append(byte)
        for end, piece in zip(self._ends, pieces, strict=True):
            if piece:
                end.write(bytes(piece))
