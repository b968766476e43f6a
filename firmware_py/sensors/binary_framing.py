"""Finds binary packets with checksums in a stream of bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED


class Packet(msgspec.Struct, frozen=True):
    """A whole packet, or a run of bytes without one.

    `offset` is the position in the stream; `fault` is empty, CHECKSUM (part of the run looked like a packet) or
    MALFORMED. A run has no data.
    """

    offset: int
    size: int
    data: bytes = b""
    fault: str = ""


class Check(Protocol):
    """Verifies packets; follows the framer's buffer, so that it can accumulate checksums."""

    def extend(self, data: bytes) -> None:
        """Note bytes that were appended to the buffer."""

    def drop(self, count: int) -> None:
        """Note that bytes were removed from the start of the buffer."""

    def holds(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a whole packet."""


class PacketCheck:
    """Verifies each packet separately: for short packets."""

    def __init__(self, verify: Callable[[bytes], bool]) -> None:
        """Store the function that verifies a packet."""
        self._verify = verify

    def extend(self, data: bytes) -> None:
        """Do nothing."""

    def drop(self, count: int) -> None:
        """Do nothing."""

    def holds(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a whole packet."""
        return self._verify(bytes(buffer[begin:end]))


class PacketFramer:
    """Splits a stream into packets and resynchronises after garbage.

    An incomplete packet does not delay a valid one that starts inside it: the length of the first was damaged. The
    result does not depend on the sizes of the pieces. The buffer holds at most one packet of maximum length. Each
    header is searched and each packet verified once, so crafted noise in small pieces costs no more than in large ones.
    """

    def __init__(
        self,
        header: re.Pattern[bytes],
        header_size: int,
        measure: Callable[[bytes], int],
        check: Check,
    ) -> None:
        """Search for `header`, at most `header_size` long; `measure` returns the packet size from a header."""
        self._header = header
        self._header_size = header_size
        self._measure = measure
        self._check = check
        self._buffer = bytearray()
        # Positions in the stream:
        self._offset = 0  # first byte in the buffer
        self._searched = 0  # end of the part that was searched for headers
        self._open: list[tuple[int, int]] = []  # start and end of possible packets
        self._false: list[int] = []  # starts of possible packets that failed the check
        self._run = 0  # number of bytes skipped before the buffer
        self._run_fault = MALFORMED

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the completed packets and the runs between them."""
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
                continue  # inside a valid packet
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
        """Return the rest of a capture as a run."""
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
        """Find the headers in the part that was not searched yet."""
        buffer = self._buffer
        index = max(0, self._searched - self._offset)
        while match := self._header.search(buffer, index):
            begin = match.start()
            size = self._measure(bytes(buffer[begin : begin + self._header_size]))
            self._open.append((self._offset + begin, self._offset + begin + size))
            index = begin + 1
        self._searched = self._offset + max(index, len(buffer) - self._header_size + 1)

    def _skip(self, start: int, stop: int, still_open: list[tuple[int, int]]) -> None:
        self._run += stop - start
        if any(start <= begin < stop for begin in self._false) or any(begin < stop for begin, _ in still_open):
            self._run_fault = CHECKSUM

    def _close_run(self, packets: list[Packet], end_offset: int) -> None:
        if self._run:
            packets.append(Packet(end_offset - self._run, self._run, fault=self._run_fault))
        self._run = 0
        self._run_fault = MALFORMED
