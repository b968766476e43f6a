"""Finds checksummed binary packets in any stream of bytes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from firmware_py.sensors.refusal import CHECKSUM, MALFORMED


@dataclass(frozen=True, slots=True)
class Packet:
    """A whole packet, or a run of bytes that is none.

    `offset` counts the bytes of the stream; `fault` is empty, CHECKSUM (something in
    the run looked like a packet) or MALFORMED. A run has no data.
    """

    offset: int
    size: int
    data: bytes = b""
    fault: str = ""


class PacketFramer:
    """Cuts a stream into packets and resynchronises after any garbage.

    A packet that is still incomplete does not hold back a good one that begins inside
    it: its length was then the damaged part. However the stream is cut into pieces, the
    result is the same. At most one packet of the longest kind stays in the buffer.
    """

    def __init__(
        self,
        header: re.Pattern[bytes],
        header_size: int,
        measure: Callable[[bytes], int],
        verify: Callable[[bytes], bool],
    ) -> None:
        """Search `header`, of a fixed size; `measure` gives the bytes of a packet from its header."""
        self._header = header
        self._header_size = header_size
        self._measure = measure
        self._verify = verify
        self._buffer = bytearray()
        self._offset = 0  # of the first byte in the buffer
        self._run = 0  # bytes skipped just before it
        self._run_fault = MALFORMED

    def feed(self, data: bytes) -> list[Packet]:
        """Take more bytes and return the packets, and the runs between them, that they complete."""
        buffer = self._buffer
        buffer += data
        packets: list[Packet] = []
        candidates: list[int] = []  # headers since `done` that have not turned out good
        keep: int | None = None  # the first of them that is incomplete
        done = search = 0
        while match := self._header.search(buffer, search):
            begin = match.start()
            end = begin + self._measure(bytes(buffer[begin : begin + self._header_size]))
            search = begin + 1
            if end <= len(buffer) and self._verify(packet := bytes(buffer[begin:end])):
                self._skip(done, begin, candidates)
                self._close_run(packets, self._offset + begin)
                packets.append(Packet(self._offset + begin, len(packet), packet))
                candidates, keep = [], None
                done = search = end
                continue
            candidates.append(begin)
            if keep is None and end > len(buffer):
                keep = begin
        if keep is None:
            keep = max(done, len(buffer) - self._header_size + 1)
        self._skip(done, keep, candidates)
        self._offset += keep
        del buffer[:keep]
        return packets

    def finish(self) -> list[Packet]:
        """Return what the end of a capture leaves as a run."""
        packets: list[Packet] = []
        if self._header.search(self._buffer):
            self._run_fault = CHECKSUM
        self._run += len(self._buffer)
        self._offset += len(self._buffer)
        self._buffer.clear()
        self._close_run(packets, self._offset)
        return packets

    def _skip(self, start: int, stop: int, candidates: list[int]) -> None:
        self._run += stop - start
        if any(begin < stop for begin in candidates):
            self._run_fault = CHECKSUM

    def _close_run(self, packets: list[Packet], end_offset: int) -> None:
        if self._run:
            packets.append(Packet(end_offset - self._run, self._run, fault=self._run_fault))
        self._run = 0
        self._run_fault = MALFORMED
