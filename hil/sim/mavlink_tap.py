"""Fast reader of a MAVLink 2 stream, which decodes most frames only on demand."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from pymavlink.dialects.v20 import common as dialect

MAGIC = 0xFD
HEADER_BYTES = 10
CHECKSUM_BYTES = 2
SIGNATURE_BYTES = 13
SIGNED_FLAG = 0x01
MAX_KINDS = 256


class MavlinkTap:
    """Split a byte stream into frames, decode selected messages, and store the last frame of each other kind.

    At a hundred times real time the telemetry of a run is thousands of messages a second, and decoding one takes as
    long as several steps of the ship.
    """

    def __init__(self, decoded_numbers: Collection[int]) -> None:
        """Set the numbers of the messages that `feed` decodes."""
        self._decoded_numbers = frozenset(decoded_numbers)
        self._buffer = bytearray()
        self._latest: dict[int | str, bytes] = {}
        self._parser = dialect.MAVLink(None)

    def feed(self, data: bytes) -> Iterator[Any]:
        """Add bytes and yield the selected messages that they complete, with valid checksums."""
        self._buffer += data
        for number, frame in self._frames():
            if number in self._decoded_numbers:
                message = self._decode(frame)
                if message is not None:
                    yield message
            else:
                key = _name_of(frame) if number == dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT else number
                if key in self._latest or len(self._latest) < MAX_KINDS:
                    self._latest[key] = frame

    def latest(self, key: int | str) -> Any | None:
        """Decode the last message of a number, or the last named value of a name; None if there is none.

        Messages that `feed` yields are not stored.
        """
        frame = self._latest.get(key)
        return None if frame is None else self._decode(frame)

    def _frames(self) -> Iterator[tuple[int, bytes]]:
        buffer, start = self._buffer, 0
        while (start := buffer.find(MAGIC, start)) >= 0 and len(buffer) - start >= HEADER_BYTES:
            if buffer[start + 2] & ~SIGNED_FLAG:  # an undefined incompatibility flag: not a frame
                start += 1
                continue
            signature = SIGNATURE_BYTES if buffer[start + 2] & SIGNED_FLAG else 0
            end = start + HEADER_BYTES + buffer[start + 1] + CHECKSUM_BYTES + signature
            if end > len(buffer):
                break
            number = buffer[start + 7] | buffer[start + 8] << 8 | buffer[start + 9] << 16
            yield number, bytes(buffer[start:end])
            start = end
        del buffer[: start if start >= 0 else len(buffer)]

    def _decode(self, frame: bytes) -> Any | None:
        try:
            return self._parser.decode(bytearray(frame))
        except dialect.MAVError:
            return None


def _name_of(frame: bytes) -> str:
    """Return the name in a NAMED_VALUE_FLOAT (time u32, value f32, name char[10]; trailing zeros are omitted)."""
    return frame[HEADER_BYTES + 8 : HEADER_BYTES + 18][: frame[1] - 8].split(b"\0", 1)[0].decode("ascii", "replace")
