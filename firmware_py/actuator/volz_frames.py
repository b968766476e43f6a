"""Codec of the Volz DA servo protocol, without I/O and time.

Requests and replies are six bytes without a header: code | id | argument 1 | argument 2 | CRC16 BE. The CRC (polynomial
0x8005, initial value 0xFFFF, not reflected) covers the first four. Replies have other codes than requests, so an echo
cannot be confused with a reply. Source: Volz DA 26 RS-485 protocol specification; for voltage, current and temperature,
argument 1 is the first supply or the motor, argument 2 the second supply or the circuit board (as in ArduPilot's
AP_Volz_Protocol).
"""

from __future__ import annotations

import struct

import msgspec

from firmware_py.common import crc16
from firmware_py.common.angles import clamp, radians

SET_POSITION, READ_CURRENT, READ_VOLTAGE, READ_TEMPERATURE = 0xDC, 0xB0, 0xB1, 0xC0
POSITION_REPLY, CURRENT_REPLY, VOLTAGE_REPLY, TEMPERATURE_REPLY = 0x2C, 0x30, 0x31, 0x10
REPLY_CODES_BY_REQUEST = {
    SET_POSITION: POSITION_REPLY,
    READ_CURRENT: CURRENT_REPLY,
    READ_VOLTAGE: VOLTAGE_REPLY,
    READ_TEMPERATURE: TEMPERATURE_REPLY,
}

FRAME_SIZE = 6
CENTRE_COUNTS = 0x0800
MIN_COUNTS, MAX_COUNTS = 0x0080, 0x0F80  # -100 and +100 deg
MAX_SENSOR_COUNTS = 0x0FFF  # the shaft can be pushed beyond the range of commands
RADIANS_PER_COUNT = radians(100.0) / (MAX_COUNTS - CENTRE_COUNTS)
AMPERES_PER_COUNT = 0.02
VOLTS_PER_COUNT = 0.2
TEMPERATURE_OFFSET_C = -50.0
MAX_TEMPERATURE_C = 150.0

_REPLY_CODES = frozenset(REPLY_CODES_BY_REQUEST.values())


def request(code: int, device_id: int, argument: int = 0) -> bytes:
    """Return the frame of a request with a 16-bit argument."""
    head = struct.pack(">BBH", code, device_id, argument)
    return head + struct.pack(">H", crc16.cms(head))


def set_position(device_id: int, shaft_rad: float) -> bytes:
    """Return the request to move to a finite shaft angle, limited to +-100 deg."""
    counts = round(clamp(CENTRE_COUNTS + shaft_rad / RADIANS_PER_COUNT, MIN_COUNTS, MAX_COUNTS))
    return request(SET_POSITION, device_id, counts)


class Reply(msgspec.Struct, frozen=True):
    """A reply with a valid checksum; its values are not checked yet."""

    code: int
    first: int
    second: int

    def shaft_rad(self) -> float | None:
        """Return the measured angle of a position reply, None if out of the range of the sensor."""
        counts = self.first << 8 | self.second
        return (counts - CENTRE_COUNTS) * RADIANS_PER_COUNT if counts <= MAX_SENSOR_COUNTS else None

    def current_a(self) -> float:
        """Return the total current of both supplies."""
        return (self.first + self.second) * AMPERES_PER_COUNT

    def voltage_v(self) -> float | None:
        """Return the higher of the two supplies, which feeds the motor; None if both are 0."""
        counts = max(self.first, self.second)
        return counts * VOLTS_PER_COUNT if counts else None

    def temperature_c(self) -> float | None:
        """Return the higher temperature of motor and circuit board, None if out of range."""
        hotter_c = max(self.first, self.second) + TEMPERATURE_OFFSET_C
        return hotter_c if hotter_c <= MAX_TEMPERATURE_C else None


class ReplyParser:
    """Finds the replies of one servo in any stream of bytes; never raises.

    `rejected` is the number of replies with a wrong checksum.
    """

    __slots__ = ("_buffer", "_device_id", "rejected")

    def __init__(self, device_id: int) -> None:
        """Store the id of the servo."""
        self._buffer = bytearray()
        self._device_id = device_id
        self.rejected = 0

    @property
    def pending(self) -> int:
        """The number of bytes of an unfinished frame."""
        return len(self._buffer)

    def clear(self) -> None:
        """Discard the bytes of an unfinished frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[Reply]:
        """Add bytes; return the completed replies."""
        buffer = self._buffer
        buffer += data
        replies: list[Reply] = []
        start = 0
        while len(buffer) - start >= FRAME_SIZE:
            code = buffer[start]
            is_frame = buffer[start + 1] == self._device_id and (code in _REPLY_CODES or code in REPLY_CODES_BY_REQUEST)
            if not is_frame:
                start += 1
                continue
            frame = bytes(buffer[start : start + FRAME_SIZE])
            if crc16.cms(frame[:4]) != frame[4] << 8 | frame[5]:
                self.rejected += code in _REPLY_CODES
                start += 1
                continue
            if code in _REPLY_CODES:  # otherwise the echo of a request
                replies.append(Reply(code, frame[2], frame[3]))
            start += FRAME_SIZE
        del buffer[:start]
        return replies
