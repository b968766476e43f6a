"""A pair of wires between two ports: both ends share it, each byte takes its time, and who talks hears himself."""

import heapq
import select
import threading
import time

from hil.devices.pty_line import PtyLine
from hil.devices.timing import BITS_PER_BYTE

LOOK_S = 0.005


class Wire:
    """A half-duplex line between two ptys, as two serial adapters on one bus see it.

    A byte arrives when it is complete at the baud rate, at the other end and, with `echo`, at its own. Two bytes that
    are on the wire together spoil each other (`collisions`). `before_collision_s` is the longest that there had taken
    to answer here, or the wire to carry, when that happened first: who gets no processor does so when there is some.
    """

    def __init__(self, here, there, baud, *, echo=True, half_duplex=True):
        """Make the two ports and begin to carry; times are real."""
        self.collisions = 0
        self.before_collision_s = None
        self._slowest_s = 0.0
        self._asked_s = None  # since when here waits for there
        self._looked_s = time.monotonic()
        self._ends = (PtyLine(here), PtyLine(there))
        self._byte_s = BITS_PER_BYTE / baud
        self._echo, self._half_duplex = echo, half_duplex
        self._free_s = [0.0, 0.0]  # when each end's last byte is complete
        self._under_way = []  # (when complete, count, from which end, byte)
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
            due_s = self._under_way[0][0] - time.monotonic() if self._under_way else LOOK_S
            ready = select.select(numbers, [], [], max(0.0, min(due_s, LOOK_S)))[0]
            looked_s, self._looked_s = self._looked_s, time.monotonic()
            self._slowest_s = max(self._slowest_s, self._looked_s - looked_s)
            for descriptor in ready:
                self._take(numbers[descriptor], time.monotonic())
            self._deliver(time.monotonic())

    def _take(self, number, now_s):
        data = self._ends[number].read()
        if data and number == 0 and self._asked_s is None:
            self._asked_s = now_s
        elif data and number and self._asked_s is not None:
            self._slowest_s = max(self._slowest_s, now_s - self._asked_s)
            self._asked_s = None
        for output in data:
            begin_s = max(now_s, self._free_s[number])
            self._free_s[number] = begin_s + self._byte_s
            collides = self._half_duplex and begin_s < self._free_s[1 - number]
            self.collisions += collides
            if collides and self.before_collision_s is None:
                self.before_collision_s = self._slowest_s
            self._count += 1
            heap_entry = (self._free_s[number], self._count, number, output ^ (0x55 if collides else 0))
            heapq.heappush(self._under_way, heap_entry)

    def _deliver(self, now_s):
        pieces = (bytearray(), bytearray())
        while self._under_way and self._under_way[0][0] <= now_s:
            _, _, number, byte = heapq.heappop(self._under_way)
            pieces[1 - number].append(byte)
            if self._echo:
                pieces[number].append(byte)
        for end, piece in zip(self._ends, pieces, strict=True):
            if piece:
                end.write(bytes(piece))
