"""Reassembles the messages of NMEA 2000 from CAN frames.

A CAN identifier of 29 bits contains priority, parameter group number (PGN) and source address (ISO 11783-3). A message
of up to 8 bytes is one frame. A longer one is a fast packet: the first byte of each frame contains a sequence number
(3 bits) and the number of the frame (5 bits); frame 0 contains the length of the message and its first 6 bytes, every
other frame 7 bytes. Source: NMEA 2000 network fundamentals (Garmin 190-00891-00); canboat.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

from firmware_py.sensors.nmea2000_layout import MAX_MESSAGE_BYTES

ADDRESS_CLAIM = 60928
MAX_ADDRESS = 251  # 252 and 253 are not assigned, 254: null address, 255: global address
FRAME_BYTES = 8
MAX_OPEN_MESSAGES = 32  # incomplete fast packets; then the oldest is dropped
MAX_FRAME_INTERVAL_S = 0.75  # between two frames of a fast packet
_FIRST_BYTES, _NEXT_BYTES = 6, 7


class Message(NamedTuple):
    """A complete message."""

    pgn: int
    source: int
    data: bytes


def split_identifier(identifier: int) -> tuple[int, int]:
    """Return PGN and source address of a CAN identifier of 29 bits.

    If the third byte from the end (PDU format) is below 240, the next byte is a destination, not part of the PGN.
    """
    pgn = identifier >> 8 & 0x3FFFF
    return (pgn if pgn & 0xFF00 >= 0xF000 else pgn & 0x3FF00), identifier & 0xFF


@dataclass(slots=True)
class _OpenMessage:
    """A fast packet with missing frames: its length in bytes, and the number of frames received."""

    sequence: int
    length: int
    frames: int
    data: bytes
    newest_s: float


class FrameJoiner:
    """Returns the messages of the selected PGNs; `lost` counts the incomplete fast packets.

    Frames of a fast packet must arrive in order. A missing, repeated or late frame drops the message.
    """

    def __init__(self, single: Collection[int], fast: Collection[int]) -> None:
        """Select the PGNs of one frame and the PGNs of fast packets."""
        self._single = frozenset(single)
        self._fast = frozenset(fast)
        self._open: dict[tuple[int, int], _OpenMessage] = {}
        self.lost = 0

    def add(self, identifier: int, data: bytes, now_s: float) -> Message | None:
        """Return the message that a frame completes, or None.

        None: another PGN, frames are still missing, or the frame is invalid: a single frame without 8 bytes, or a frame
        that drops its fast packet.
        """
        pgn, source = split_identifier(identifier)
        if pgn in self._single:
            return Message(pgn, source, data) if len(data) == FRAME_BYTES else None
        if pgn not in self._fast or len(data) < 2:
            return None
        key = pgn, source
        sequence, number = data[0] >> 5, data[0] & 0x1F
        if number == 0:
            return self._begin(key, sequence, data, now_s)
        message = self._open.get(key)
        if message is None:
            return None  # the beginning was lost and counted, or was before the start
        if sequence != message.sequence or number != message.frames or now_s - message.newest_s > MAX_FRAME_INTERVAL_S:
            del self._open[key]
            self.lost += 1
            return None
        message.data += data[1:]
        message.frames, message.newest_s = number + 1, now_s
        return self._complete(key, message)

    def _begin(self, key: tuple[int, int], sequence: int, data: bytes, now_s: float) -> Message | None:
        if self._open.pop(key, None) is not None:
            self.lost += 1
        length = data[1]
        if not 0 < length <= MAX_MESSAGE_BYTES:
            self.lost += 1
            return None
        if len(self._open) >= MAX_OPEN_MESSAGES:
            del self._open[min(self._open, key=lambda oldest: self._open[oldest].newest_s)]
            self.lost += 1
        message = self._open[key] = _OpenMessage(sequence, length, 1, data[2:], now_s)
        return self._complete(key, message)

    def _complete(self, key: tuple[int, int], message: _OpenMessage) -> Message | None:
        """Return the message if all its bytes have arrived; a frame that is too short drops it."""
        expected = _FIRST_BYTES + (message.frames - 1) * _NEXT_BYTES
        if len(message.data) >= message.length:
            del self._open[key]
            return Message(*key, message.data[: message.length])
        if len(message.data) != expected:
            del self._open[key]
            self.lost += 1
        return None
