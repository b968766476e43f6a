"""Finds checksummed binary packets in any stream of bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED


class Packet(msgspec.Struct, frozen=True):
    """A whole packet, or a run of bytes that is none.

    `offset` counts the bytes of the stream; `fault` is empty, CHECKSUM (something in
    the run looked like a packet) or MALFORMED. A run has no data.
    """

    offset: int
    size: int
    data: bytes = b""
    fault: str = ""


class Check(Protocol):
    """Tells whether a packet is whole; follows the framer's buffer, so that it can sum up in advance."""

    def extend(self, data: bytes) -> None:
        """Take bytes that were put at the end of the buffer."""

    def drop(self, count: int) -> None:
        """Forget bytes that were taken from its beginning."""

    def holds(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a whole packet."""


class EachAlone:
    """Checks each packet by itself: for short ones."""

    def __init__(self, verify: Callable[[bytes], bool]) -> None:
        """Take what checks a packet."""
        self._verify = verify

    def extend(self, data: bytes) -> None:
        """Do nothing."""

    def drop(self, count: int) -> None:
        """Do nothing."""

    def holds(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a whole packet."""
        return self._verify(bytes(buffer[begin:end]))


class PacketFramer:
    """Cuts a stream into packets and resynchronises after any garbage.

    A packet that is still incomplete does not hold back a good one that begins inside
    it: its length was then the damaged part. However the stream is cut into pieces, the
    result is the same. At most one packet of the longest kind stays in the buffer, and
    each header is looked for, and its packet checked, once: crafted noise in small
    pieces costs no more than in large ones.
    """

    def __init__(
        self,
        header: re.Pattern[bytes],
        header_size: int,
        measure: Callable[[bytes], int],
        check: Check,
    ) -> None:
        """Search `header`, at most `header_size` long; `measure` gives the bytes of a packet from its header."""
        self._header = header
        self._header_size = header_size
        self._measure = measure
        self._check = check
        self._buffer = bytearray()
        self._offset = 0  # of the first byte in the buffer, as all that follow
        self._searched = 0  # no header begins before this that is not known
        self._open: list[tuple[int, int]] = []  # begin and end of what may become packets
        self._false: list[int] = []  # begins of what looked like packets and were none
        self._run = 0  # bytes skipped just before the buffer
        self._run_fault = MALFORMED

    def feed(self, data: bytes) -> list[Packet]:
        """Take more bytes and return the packets, and the runs between them, that they complete."""
        buffer = self._buffer
        buffer += data
        self._check.extend(data)
        self._search()
        packets: list[Packet] = []
        present = self._offset + len(buffer)
        still_open: list[tuple[int, int]] = []
        done = self._offset
        for begin, end in self._open:
            if begin < done:
                continue  # inside a good packet
            if end > present:
                still_open.append((begin, end))
            elif self._check.holds(buffer, begin - self._offset, end - self._offset):
                self._skip(done, begin, still_open)
                self._close_run(packets, begin)
                packets.append(Packet(begin, end - begin, bytes(buffer[begin - self._offset : end - self._offset])))
                still_open, self._false = [], []
                done = end
            else:
                self._false.append(begin)
        self._open = still_open
        keep = still_open[0][0] if still_open else max(done, present - self._header_size + 1)
        self._skip(done, keep, still_open)
        self._false = [begin for begin in self._false if begin >= keep]
        self._check.drop(keep - self._offset)
        del buffer[: keep - self._offset]
        self._offset = keep
        return packets

    def finish(self) -> list[Packet]:
        """Return what the end of a capture leaves as a run."""
        packets: list[Packet] = []
        if self._header.search(self._buffer):
            self._run_fault = CHECKSUM
        self._run += len(self._buffer)
        self._offset += len(self._buffer)
        self._check.drop(len(self._buffer))
        self._buffer.clear()
        self._open, self._false = [], []
        self._close_run(packets, self._offset)
        return packets

    def _search(self) -> None:
        """Find the headers in what has not been searched yet."""
        buffer = self._buffer
        place = max(0, self._searched - self._offset)
        while match := self._header.search(buffer, place):
            begin = match.start()
            size = self._measure(bytes(buffer[begin : begin + self._header_size]))
            self._open.append((self._offset + begin, self._offset + begin + size))
            place = begin + 1
        self._searched = self._offset + max(place, len(buffer) - self._header_size + 1)

    def _skip(self, start: int, stop: int, still_open: list[tuple[int, int]]) -> None:
        self._run += stop - start
        if any(start <= begin < stop for begin in self._false) or any(begin < stop for begin, _ in still_open):
            self._run_fault = CHECKSUM

    def _close_run(self, packets: list[Packet], end_offset: int) -> None:
        if self._run:
            packets.append(Packet(end_offset - self._run, self._run, fault=self._run_fault))
        self._run = 0
        self._run_fault = MALFORMED
