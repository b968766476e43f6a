"""Framing of Dynamixel protocol 2.0, the servo's side (ROBOTIS e-Manual, Protocol 2.0)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from hil.devices.crc import crc16_8005
from hil.devices.timing import ReceiveBuffer

BROADCAST_ID = 254
_HEADER = b"\xff\xff\xfd\x00"
_PATTERN, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
_LENGTH_END = 7  # header, id, length
_MAX_BODY = 320  # instruction, parameters and CRC; more than any packet that this servo uses


class Instruction(IntEnum):
    """Instructions of this servo; bulk, fast, clear and factory reset are answered as undefined."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


class Fault(IntEnum):
    """Error numbers of a status packet; bit 7, the hardware alert, is added on sending."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


ALERT = 0x80


@dataclass(frozen=True, slots=True)
class Packet:
    """An instruction packet; `intact` is False when its CRC does not match."""

    device_id: int
    instruction: int
    parameters: bytes
    intact: bool = True


def status_packet(device_id: int, error: int, parameters: bytes = b"") -> bytes:
    """Return a complete status packet with byte stuffing."""
    body = (bytes([Instruction.STATUS, error]) + parameters).replace(_PATTERN, _STUFFED)
    head = _HEADER + bytes([device_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16_8005(head).to_bytes(2, "little")


class PacketReader:
    """Finds instruction packets in the bytes from the host."""

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._buffer = ReceiveBuffer(longest=2 * _MAX_BODY)

    def feed(self, now_s: float, data: bytes) -> list[Packet]:
        """Add bytes and return the packets that they complete, damaged ones included."""
        self._buffer.append(now_s, data)
        held = self._buffer.data
        found: list[Packet] = []
        while True:
            start = held.find(_HEADER)
            if start < 0:
                del held[: max(0, len(held) - len(_HEADER) + 1)]
                return found
            del held[:start]
            if len(held) < _LENGTH_END:
                return found
            end = _LENGTH_END + int.from_bytes(held[5:7], "little")
            if not _LENGTH_END + 3 <= end <= _LENGTH_END + _MAX_BODY:
                del held[: len(_HEADER)]
                continue
            if len(held) < end:
                return found
            packet = _decode(bytes(held[:end]))
            found.append(packet)
            # A damaged length may cover the next packet, so only the header is skipped.
            del held[: end if packet.intact else len(_HEADER)]

    def clear(self) -> None:
        """Discard an incomplete packet."""
        self._buffer.clear()


def _decode(raw: bytes) -> Packet:
    body = raw[_LENGTH_END:-2].replace(_STUFFED, _PATTERN)
    intact = crc16_8005(raw[:-2]) == int.from_bytes(raw[-2:], "little")
    return Packet(raw[4], body[0], body[1:], intact)
