"""Framing of Dynamixel protocol 2.0 on the side of the servo (ROBOTIS e-Manual, Protocol 2.0)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from hil.devices.crc import crc16_8005
from hil.devices.timing import ReceiveBuffer

BROADCAST_ID = 254
_HEADER = b"\xff\xff\xfd\x00"
_STUFFING_PATTERN, _STUFFED_PATTERN = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
_BODY_START = 7  # after header, id and length
_MAX_BODY_BYTES = 320  # instruction, parameters and CRC; more than any packet that this servo uses


class Instruction(IntEnum):
    """Instructions that this servo supports; all others get an instruction error."""

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
    """Error numbers of a status packet; bit 7, the hardware alert, is set by the sender."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7


ALERT_BIT = 0x80


@dataclass(frozen=True, slots=True)
class Packet:
    """An instruction packet; `is_intact` is False when its CRC does not match."""

    device_id: int
    instruction: int
    parameters: bytes
    is_intact: bool = True


def status_packet(device_id: int, error: int, parameters: bytes = b"") -> bytes:
    """Return a complete status packet with byte stuffing."""
    body = (bytes([Instruction.STATUS, error]) + parameters).replace(_STUFFING_PATTERN, _STUFFED_PATTERN)
    packet = _HEADER + bytes([device_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return packet + crc16_8005(packet).to_bytes(2, "little")


class PacketReader:
    """Finds instruction packets in the bytes from the host."""

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._buffer = ReceiveBuffer(max_bytes=2 * _MAX_BODY_BYTES)

    def feed(self, now_s: float, data: bytes) -> list[Packet]:
        """Add bytes and return the packets that they complete, including packets with a wrong CRC."""
        self._buffer.append(now_s, data)
        buffer = self._buffer.data
        packets: list[Packet] = []
        while True:
            start = buffer.find(_HEADER)
            if start < 0:
                del buffer[: max(0, len(buffer) - len(_HEADER) + 1)]
                return packets
            del buffer[:start]
            if len(buffer) < _BODY_START:
                return packets
            end = _BODY_START + int.from_bytes(buffer[5:7], "little")
            if not _BODY_START + 3 <= end <= _BODY_START + _MAX_BODY_BYTES:
                del buffer[: len(_HEADER)]
                continue
            if len(buffer) < end:
                return packets
            packet = _decode(bytes(buffer[:end]))
            packets.append(packet)
            # A damaged length may cover the next packet, so only the header is skipped.
            del buffer[: end if packet.is_intact else len(_HEADER)]

    def clear(self) -> None:
        """Discard an incomplete packet."""
        self._buffer.clear()


def _decode(raw: bytes) -> Packet:
    body = raw[_BODY_START:-2].replace(_STUFFED_PATTERN, _STUFFING_PATTERN)
    is_intact = crc16_8005(raw[:-2]) == int.from_bytes(raw[-2:], "little")
    return Packet(raw[4], body[0], body[1:], is_intact)
