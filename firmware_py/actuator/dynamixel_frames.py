"""Codec of Robotis Dynamixel protocol 2.0, without I/O and time.

A frame is FF FF FD 00 | ID | LEN u16 LE | INSTRUCTION | parameters | CRC16 LE. Within instruction and parameters every
FF FF FD is followed by a stuffed FD, so the header cannot occur inside a frame. The CRC (polynomial 0x8005, initial
value 0, not reflected) is computed over all stuffed bytes before it.
Source: Robotis e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

import struct

import msgspec

from firmware_py.common import crc16

HEADER = b"\xff\xff\xfd\x00"
STUFFED_PATTERN, UNSTUFFED_PATTERN = b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"
MAX_ID = 252
BROADCAST_ID = 254  # servos reply only to a broadcast ping or read

PING, READ, WRITE, REBOOT, SYNC_WRITE = 0x01, 0x02, 0x03, 0x08, 0x83
STATUS = 0x55

ALERT_BIT = 0x80  # in the error byte of a status packet: the hardware error register is not 0
ERROR_TEXT = {
    1: "result fail",
    2: "instruction error",
    3: "CRC error",
    4: "range error",
    5: "length error",
    6: "limit error",
    7: "access error",
}

_HEAD_SIZE = 7  # header, id and length; the length field covers the bytes after them
_CRC_SIZE = 2
_MIN_LENGTH = 4  # of a status packet: instruction, error, CRC


def _frame(device_id: int, body: bytes) -> bytes:
    stuffed = body.replace(UNSTUFFED_PATTERN, STUFFED_PATTERN)
    covered = HEADER + struct.pack("<BH", device_id, len(stuffed) + _CRC_SIZE) + stuffed
    return covered + struct.pack("<H", crc16.umts(covered))


def instruction(device_id: int, code: int, parameters: bytes = b"") -> bytes:
    """Return the frame of any instruction."""
    return _frame(device_id, bytes((code,)) + parameters)


def ping(device_id: int) -> bytes:
    """Return a ping; the status packet contains model number u16 and firmware version u8."""
    return instruction(device_id, PING)


def read(device_id: int, address: int, length: int) -> bytes:
    """Return the instruction that reads a range of the control table."""
    return instruction(device_id, READ, struct.pack("<HH", address, length))


def write(device_id: int, address: int, data: bytes) -> bytes:
    """Return the instruction that writes a range of the control table."""
    return instruction(device_id, WRITE, struct.pack("<H", address) + data)


def sync_write(device_id: int, address: int, data: bytes) -> bytes:
    """Return the instruction that writes a range without a reply, so that another may follow at once."""
    return instruction(BROADCAST_ID, SYNC_WRITE, struct.pack("<HHB", address, len(data), device_id) + data)


def reboot(device_id: int) -> bytes:
    """Return the instruction that restarts the device."""
    return instruction(device_id, REBOOT)


class StatusPacket(msgspec.Struct, frozen=True):
    """The reply of a device, without stuffing."""

    device_id: int
    error: int
    parameters: bytes

    @property
    def alert(self) -> bool:
        """Whether the device has a hardware error."""
        return bool(self.error & ALERT_BIT)

    @property
    def code(self) -> int:
        """The error code (ERROR_TEXT), 0 if the instruction was accepted."""
        return self.error & ~ALERT_BIT


class StatusParser:
    """Finds status packets in any stream of bytes; never raises.

    Instruction packets, such as the echo of a half-duplex adapter, are skipped. Between calls the buffer
    contains less than one packet of maximum length. `rejected` is the number of status packets with a wrong CRC or
    length, including truncated ones.
    """

    __slots__ = ("_buffer", "_max_length", "rejected")

    def __init__(self, max_length: int = 256) -> None:
        """Store the maximum of the length field, which limits how long a damaged length delays the next packet."""
        self._buffer = bytearray()
        self._max_length = max_length
        self.rejected = 0

    @property
    def pending(self) -> int:
        """The number of bytes of an unfinished packet."""
        return len(self._buffer)

    def clear(self) -> None:
        """Discard the bytes of an unfinished packet."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[StatusPacket]:
        """Add bytes; return the completed packets."""
        buffer = self._buffer
        buffer += data
        packets: list[StatusPacket] = []
        search_start = 0
        while (start := buffer.find(HEADER, search_start)) >= 0:
            consumed = self._check_packet(start, packets)
            if consumed == 0:
                break
            search_start = start + consumed
        # Without a header, the last three bytes may be the start of one.
        del buffer[: start if start >= 0 else max(search_start, len(buffer) - len(HEADER) + 1)]
        return packets

    def _check_packet(self, start: int, packets: list[StatusPacket]) -> int:
        """Check the header at start; return the number of bytes to skip, 0 to wait for more bytes."""
        buffer = self._buffer
        available = len(buffer) - start
        if available <= _HEAD_SIZE:
            return 0
        if buffer[start + _HEAD_SIZE] != STATUS:
            return 1
        length = buffer[start + 5] | buffer[start + 6] << 8
        if not _MIN_LENGTH <= length <= self._max_length:
            self.rejected += 1
            return 1
        size = _HEAD_SIZE + length
        # A header before the CRC shows that this packet is truncated: the rest belongs to the next one.
        next_header = buffer.find(HEADER, start + _HEAD_SIZE, min(start + size - _CRC_SIZE, len(buffer)))
        if next_header != -1:
            self.rejected += 1
            return next_header - start
        if available < size:
            return 0
        packet = bytes(buffer[start : start + size])
        if crc16.umts(packet[:-_CRC_SIZE]) != packet[-2] | packet[-1] << 8:
            self.rejected += 1
            return 1
        body = packet[_HEAD_SIZE:-_CRC_SIZE].replace(STUFFED_PATTERN, UNSTUFFED_PATTERN)
        packets.append(StatusPacket(packet[4], body[1], body[2:]))
        return size
