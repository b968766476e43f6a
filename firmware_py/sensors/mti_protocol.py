"""Binary protocol Xbus of Xsens (Movella) MTi motion trackers: framing, states, output configuration.

Sources: MTi User Manual MT0605P, section 5.3 (message structure, GoToConfig, GoToMeasurement, SetOutputConfiguration,
MTData2); MT Low Level Communication Protocol Documentation MT0101P, 2019.A (data identifiers, formats, Error);
mtidocs.movella.com, "States" (WakeUp). All numbers are big endian.
"""

from __future__ import annotations

import itertools
import re
import struct
from collections.abc import Iterable, Mapping
from enum import IntEnum

from firmware_py.sensors.binary_framing import PacketFramer
from firmware_py.sensors.message_error import MALFORMED, MessageError

_PREAMBLE, _BUS_ID = 0xFA, 0xFF  # 0xFF is the address of a single device on a line
_EXTENDED_LENGTH = 0xFF  # a length byte of 255: two bytes of length follow
EACH_MESSAGE = 0xFFFF  # the rate of a value that is in every message


class Message(IntEnum):
    """Message ids; the id of an acknowledgement is that of its command plus one."""

    DEVICE_ID = 0x01
    CONFIGURATION = 0x0D
    GO_TO_MEASUREMENT = 0x10
    GO_TO_MEASUREMENT_ACK = 0x11
    FIRMWARE_REVISION = 0x13
    GO_TO_CONFIG = 0x30
    GO_TO_CONFIG_ACK = 0x31
    MT_DATA2 = 0x36
    WAKE_UP = 0x3E
    WAKE_UP_ACK = 0x3F
    ERROR = 0x42
    WARNING = 0x43
    CALIBRATION = 0x91  # eMTS, for the software of the manufacturer
    OUTPUT_CONFIGURATION = 0xC0  # empty: requests the list; otherwise sets it
    OUTPUT_CONFIGURATION_ACK = 0xC1


class DataId(IntEnum):
    """Data identifiers used by the driver, without the format bits."""

    TEMPERATURE = 0x0810
    EULER_ANGLES = 0x2030
    RATE_OF_TURN = 0x8020
    STATUS_WORD = 0xE020


class Frame(IntEnum):
    """Bits 2 and 3 of a data identifier: the earth-fixed axes that an orientation refers to."""

    ENU = 0x0
    NED = 0x4
    NWU = 0x8


FORMAT_BITS = 0x000F  # precision in bits 0 and 1, frame in bits 2 and 3

_DEVICE_MESSAGES = (
    Message.DEVICE_ID,
    Message.CONFIGURATION,
    Message.GO_TO_MEASUREMENT_ACK,
    Message.FIRMWARE_REVISION,
    Message.GO_TO_CONFIG_ACK,
    Message.MT_DATA2,
    Message.WAKE_UP,
    Message.ERROR,
    Message.WARNING,
    Message.CALIBRATION,
    Message.OUTPUT_CONFIGURATION_ACK,
)
# Preamble, bus id, a message that a device sends, then the length in one byte or in three (up to 2048).
# The header is this strict because the checksum is only a sum.
_HEADER = re.compile(
    rb"\xfa\xff[%b](?:[\x00-\xfe]|\xff(?:[\x00-\x07][\x00-\xff]|\x08\x00))"
    % b"".join(b"\\x%02x" % message for message in _DEVICE_MESSAGES)
)
_MAX_HEADER_SIZE = 6

# The codes of the Error message.
_ERROR_TEXTS: Mapping[int, str] = {
    3: "period out of range",
    4: "message invalid or not known",
    30: "timer overflow: rate too high",
    32: "baud rate out of range",
    33: "parameter invalid",
    35: "its transmit buffer is full",
    36: "its transmit buffer overflowed",
    40: "device error: update its firmware",
    41: "more data than the baud rate allows",
    42: "its sample buffer overflowed",
}


def encode(message: int, data: bytes = b"") -> bytes:
    """Return the packet of a command; raises ValueError for more than the 254 bytes of the short form."""
    if len(data) >= _EXTENDED_LENGTH:
        raise ValueError(f"a command has at most 254 bytes, not {len(data)}")
    body = bytes((_BUS_ID, message, len(data))) + data
    return bytes((_PREAMBLE,)) + body + bytes((-sum(body) & 0xFF,))


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, _MAX_HEADER_SIZE, _packet_size, _ByteSum())


def _packet_size(header: bytes) -> int:
    if header[3] == _EXTENDED_LENGTH:
        return _MAX_HEADER_SIZE + int.from_bytes(header[4:6], "big") + 1
    return 4 + header[3] + 1


class _ByteSum:
    """The checksum: the sum of all bytes after the preamble is 0 modulo 256.

    It is computed from cumulative sums, so false headers with long lengths cost no extra time.
    """

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._sums = [0]  # sum of all bytes since the start before each index

    def extend(self, data: bytes) -> None:
        """Note bytes that were appended to the buffer."""
        self._sums += list(itertools.accumulate(data, initial=self._sums[-1]))[1:]

    def drop(self, count: int) -> None:
        """Note that bytes were removed from the start of the buffer."""
        del self._sums[:count]

    def is_packet(self, _buffer: bytearray, begin: int, end: int) -> bool:
        """Return whether buffer[begin:end] is a complete packet."""
        return (self._sums[end] - self._sums[begin + 1]) & 0xFF == 0


def message_id(packet: bytes) -> int:
    """Return the message id of a packet."""
    return packet[2]


def payload(packet: bytes) -> bytes:
    """Return the data of a packet."""
    return packet[_MAX_HEADER_SIZE if packet[3] == _EXTENDED_LENGTH else 4 : -1]


def encode_output_configuration(rows: Iterable[tuple[int, int]]) -> bytes:
    """Return the data of an OUTPUT_CONFIGURATION from rows of data identifier and rate in Hz."""
    return b"".join(struct.pack(">HH", *row) for row in rows)


def parse_output_configuration(data: bytes) -> dict[int, int]:
    """Return {data identifier: rate in Hz or EACH_MESSAGE}, or raise MessageError."""
    if len(data) % 4:
        raise MessageError(MALFORMED, "output configuration malformed")
    return dict(struct.iter_unpack(">HH", data))


def parse_items(data: bytes) -> dict[int, bytes]:
    """Return the items of an MT_DATA2 as {data identifier: value bytes}, or raise MessageError."""
    items: dict[int, bytes] = {}
    index = 0
    while index < len(data):
        value = data[index + 3 : index + 3 + data[index + 2]] if index + 3 <= len(data) else b""
        if index + 3 > len(data) or len(value) < data[index + 2]:
            raise MessageError(MALFORMED, "data message malformed")
        items[int.from_bytes(data[index : index + 2], "big")] = value
        index += 3 + len(value)
    return items


def error_text(data: bytes) -> str:
    """Return the text of an ERROR message: its code and, if known, the meaning."""
    if not data:
        return "device error without a code"
    meaning = _ERROR_TEXTS.get(data[0])
    return f"device error {data[0]}" + (f": {meaning}" if meaning else "")
