"""Finds binary packets with checksums in a stream of bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Protocol

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED


class Packet(msgspec.Struct, frozen=True):
    """A complete packet, or the skipped bytes between two packets.

    `offset` is the position in the stream; `fault` is empty, CHECKSUM (a part of the skipped bytes looked like a
    packet) or MALFORMED. For skipped bytes, `data` is empty.
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

    def is_packet(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a complete packet."""


class PacketCheck:
    """Verifies each packet separately: for short packets."""

    def __init__(self, verify: Callable[[bytes], bool]) -> None:
        """Store the function that verifies a packet."""
        self._verify = verify

    def extend(self, data: bytes) -> None:
        """Do nothing."""

    def drop(self, count: int) -> None:
        """Do nothing."""

    def is_packet(self, buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a complete packet."""
        return self._verify(bytes(buffer[begin:end]))


class PacketFramer:
    """Splits a stream into packets and resynchronises after garbage.

    An incomplete packet with a damaged length does not delay a valid packet that starts inside it. The result does not
    depend on how the stream is divided into calls of `feed`. The buffer contains at most one packet of maximum length.
    Each header is searched once and each packet is verified once, so the computing time of noise does not depend on
    the number of calls.
    """

    def __init__(
        self,
        header: re.Pattern[bytes],
        header_size: int,
        packet_size: Callable[[bytes], int],
        check: Check,
    ) -> None:
        """Search for `header`, at most `header_size` long; `packet_size` returns the packet size from a header."""
        self._header = header
        self._header_size = header_size
        self._packet_size = packet_size
        self._check = check
        self._buffer = bytearray()
        # Positions in the stream:
        self._offset = 0  # first byte in the buffer
        self._search_end = 0  # end of the part that was searched for headers
        self._candidates: list[tuple[int, int]] = []  # start and end of possible packets
        self._skipped_size = 0  # number of bytes skipped before the buffer
        self._skipped_fault = MALFORMED

    def feed(self, data: bytes) -> list[Packet]:
        """Add bytes; return the completed packets and the skipped bytes between them."""
        buffer = self._buffer
        buffer += data
        self._check.extend(data)
        self._search()
        packets: list[Packet] = []
        stream_end = self._offset + len(buffer)
        incomplete: list[tuple[int, int]] = []
        header: int | None = None  # start of the first candidate after packet_end that failed the check
        packet_end = self._offset
        for begin, end in self._candidates:
            if begin < packet_end:
                continue  # inside a valid packet
            if end > stream_end:
                incomplete.append((begin, end))
            elif self._check.is_packet(buffer, begin - self._offset, end - self._offset):
                self._skip(packet_end, begin, header)
                self._end_skipped(packets, begin)
                packets.append(Packet(begin, end - begin, bytes(buffer[begin - self._offset : end - self._offset])))
                incomplete, header = [], None
                packet_end = end
                continue
            header = begin if header is None else header
        self._candidates = incomplete
        keep_from = incomplete[0][0] if incomplete else max(packet_end, stream_end - self._header_size + 1)
        self._skip(packet_end, keep_from, header)
        self._check.drop(keep_from - self._offset)
        del buffer[: keep_from - self._offset]
        self._offset = keep_from
        return packets

    def finish(self) -> list[Packet]:
        """End the stream; return the remaining bytes as skipped."""
        packets: list[Packet] = []
        if self._header.search(self._buffer):
            self._skipped_fault = CHECKSUM
        self._skipped_size += len(self._buffer)
        self._offset += len(self._buffer)
        self._check.drop(len(self._buffer))
        self._buffer.clear()
        self._candidates = []
        self._end_skipped(packets, self._offset)
        return packets

    def _search(self) -> None:
        """Find the headers after the end of the last search."""
        buffer = self._buffer
        index = max(0, self._search_end - self._offset)
        while match := self._header.search(buffer, index):
            begin = match.start()
            size = self._packet_size(bytes(buffer[begin : begin + self._header_size]))
            self._candidates.append((self._offset + begin, self._offset + begin + size))
            index = begin + 1
        self._search_end = self._offset + max(index, len(buffer) - self._header_size + 1)

    def _skip(self, start: int, stop: int, header: int | None) -> None:
        """Note skipped bytes, in which a possible packet may start at `header`."""
        self._skipped_size += stop - start
        if header is not None and header < stop:
            self._skipped_fault = CHECKSUM

    def _end_skipped(self, packets: list[Packet], end_offset: int) -> None:
        if self._skipped_size:
            packets.append(Packet(end_offset - self._skipped_size, self._skipped_size, fault=self._skipped_fault))
        self._skipped_size = 0
        self._skipped_fault = MALFORMED
