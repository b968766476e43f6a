"""Forms in which NMEA 2000 arrives: Actisense (NGT-1), Yacht Devices RAW, and frames of SocketCAN.

Actisense: DLE STX, command, length, data, checksum, DLE ETX; a DLE between them is doubled; command, length, data and
checksum add up to 0 modulo 256. A received message (0x93) contains priority, PGN (3 bytes, little endian), destination,
source, time stamp (4 bytes), number of bytes, bytes. The gateway has joined the fast packets. Source: canboat,
actisense-serial; "Actisense N2K gateway, BST message format".

Yacht Devices RAW: lines `17:33:21.107 R 19F51323 01 2F 30 70 00 2F 30 70`: time, direction, CAN identifier, bytes.
Source: YDWG-02 user manual, appendix E.

SocketCAN: `struct can_frame` of 16 bytes (linux/can.h), as firmware_py/system/can_line.py returns it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator
from typing import Protocol

from firmware_py.sensors.nmea2000_frames import FrameJoiner, Message
from firmware_py.sensors.nmea2000_layout import MAX_MESSAGE_BYTES

# Command 0x11 (operating mode) of the gateway itself, with mode 2: forward all messages. Nothing is sent to the bus.
START_COMMAND = bytes.fromhex("10 02 A1 03 11 02 00 49 10 03")

_BODY = rb"[^\x10]*+(?:\x10\x10[^\x10]*+)*+"
_FRAME = re.compile(rb"\x10\x02\x93(%b)\x10\x03" % _BODY)
_INCOMPLETE_FRAME = re.compile(rb"\x10(?:\x02(?:\x93%b\x10?)?)?\Z" % _BODY)
_HEADER_BYTES = 12  # length, priority, PGN, destination, source, time stamp, number of bytes
_MAX_FRAME_BYTES = 5 + 2 * (_HEADER_BYTES + MAX_MESSAGE_BYTES + 1)
_MAX_LINE_BYTES = 80
_CAN_FRAME = struct.Struct("=IB3x8s")
_EXTENDED, _NOT_DATA, _IDENTIFIER = 0x8000_0000, 0x6000_0000, 0x1FFF_FFFF  # linux/can.h


class Gateway(Protocol):
    """Decodes the bytes of one form."""

    @property
    def rejected(self) -> int:
        """Number of damaged frames and incomplete messages so far."""

    @property
    def has_frames(self) -> bool:
        """Whether there was any valid frame."""

    def feed(self, data: bytes, now_s: float) -> list[Message]:
        """Add bytes; return the messages of the selected PGNs that they complete."""


class ActisenseGateway:
    """Reads Actisense frames."""

    def __init__(self, pgns: Collection[int]) -> None:
        """Select the PGNs."""
        self._pgns = frozenset(pgns)
        self._buffer = b""
        self.rejected = 0
        self.has_frames = False

    def feed(self, data: bytes, now_s: float) -> list[Message]:  # noqa: ARG002 - part of Gateway
        """Add bytes; return the messages of the selected PGNs that they complete."""
        buffer = self._buffer + data
        messages: list[Message] = []
        end = 0
        for match in _FRAME.finditer(buffer):
            end = match.end()
            body = match[1].replace(b"\x10\x10", b"\x10")
            if len(body) <= _HEADER_BYTES or body[2] | body[3] << 8 | body[4] << 16 not in self._pgns:
                self.has_frames = self.has_frames or is_valid_body(body)
            elif is_valid_body(body):
                self.has_frames = True
                messages.append(message_of_body(body))
            else:
                self.rejected += 1
        incomplete = _INCOMPLETE_FRAME.search(buffer, end)
        self._buffer = incomplete[0] if incomplete and len(incomplete[0]) <= _MAX_FRAME_BYTES else b""
        return messages


def actisense_bodies(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the offset and the body, from length to checksum, of each frame of a capture."""
    return ((match.start(), match[1].replace(b"\x10\x10", b"\x10")) for match in _FRAME.finditer(data))


def is_valid_body(body: bytes) -> bool:
    """Return whether the checksum, the length and the number of bytes of an Actisense frame are right."""
    return (
        len(body) > _HEADER_BYTES
        and (0x93 + sum(body)) & 0xFF == 0
        and body[0] == len(body) - 2
        and body[11] == len(body) - _HEADER_BYTES - 1
    )


def message_of_body(body: bytes) -> Message:
    """Return the message of a valid body."""
    return Message(body[2] | body[3] << 8 | body[4] << 16, body[6], body[_HEADER_BYTES:-1])


class YachtDevicesGateway:
    """Reads the lines of RAW mode. A search for the selected PGNs is much faster than a look at each line."""

    def __init__(self, joiner: FrameJoiner, pgns: Collection[int]) -> None:
        """Store the joiner of frames and select the PGNs."""
        self._joiner = joiner
        self._line = re.compile(
            rb" R ([01](?:%b)[0-9A-F]{2})((?: [0-9A-F]{2}){1,8}) ?\r?\n" % b"|".join(map(_hex_pattern, pgns))
        )
        self._buffer = b""
        self.has_frames = False

    @property
    def rejected(self) -> int:
        """Number of incomplete messages."""
        return self._joiner.lost

    def feed(self, data: bytes, now_s: float) -> list[Message]:
        """Add bytes; return the messages of the selected PGNs that they complete."""
        buffer = self._buffer + data
        complete = buffer.rfind(b"\n") + 1
        self._buffer = buffer[complete:][-_MAX_LINE_BYTES:]
        messages: list[Message] = []
        for match in self._line.finditer(buffer, 0, complete):
            message = self._joiner.add(int(match[1], 16), bytes.fromhex(match[2].decode("ascii")), now_s)
            if message is not None:
                messages.append(message)
        self.has_frames = self.has_frames or ANY_LINE.search(buffer, 0, complete) is not None
        return messages


ANY_LINE = re.compile(rb"\d\d:\d\d:\d\d\.\d{3} ([RT]) ([01][0-9A-F]{7})((?: [0-9A-F]{2}){1,8}) ?\r?\n")


def _hex_pattern(pgn: int) -> bytes:
    """Return the pattern of the second to sixth digit of the CAN identifiers of a PGN."""
    page, pdu_format = pgn >> 16, pgn >> 8 & 0xFF
    digits = b"".join(b"%X" % (priority << 2 | page) for priority in range(4))
    specific = b"%02X" % (pgn & 0xFF) if pdu_format >= 0xF0 else b"[0-9A-F]{2}"
    return b"[%b]%02X%b" % (digits, pdu_format, specific)


class SocketCanGateway:
    """Reads frames of SocketCAN."""

    def __init__(self, joiner: FrameJoiner) -> None:
        """Store the joiner of frames."""
        self._joiner = joiner
        self._buffer = b""
        self.has_frames = False

    @property
    def rejected(self) -> int:
        """Number of incomplete messages."""
        return self._joiner.lost

    def feed(self, data: bytes, now_s: float) -> list[Message]:
        """Add bytes; return the messages of the selected PGNs that they complete."""
        buffer = self._buffer + data
        complete = len(buffer) - len(buffer) % _CAN_FRAME.size
        self._buffer = buffer[complete:]
        messages: list[Message] = []
        for identifier, length, frame in _CAN_FRAME.iter_unpack(buffer[:complete]):
            if identifier & _EXTENDED and not identifier & _NOT_DATA:
                self.has_frames = True
                message = self._joiner.add(identifier & _IDENTIFIER, frame[:length], now_s)
                if message is not None:
                    messages.append(message)
        return messages
