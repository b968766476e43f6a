"""Binary protocol of PNI TCM, Prime and TRAX compass modules.

Source: TRAX user manual, DOC#1016505 r06, section 7.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from enum import IntEnum

from firmware_py.common.crc16 import xmodem
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer

# Byte count (all components of a TRAX together have less than 128 bytes), then a known frame id.
_HEADER = re.compile(rb"\x00[\x05-\x80][\x01-\x1f\x24\x25\x2b\x2c\x34\x35\x4f-\x51\x6b-\x6e\x77-\x79\x80-\x82]")


class Frame(IntEnum):
    """Frame ids that the driver sends or receives."""

    GET_MODULE_INFO = 1
    MODULE_INFO = 2
    SET_DATA_COMPONENTS = 3
    DATA = 5
    SET_CONFIG = 6
    SAVE = 9
    START_CAL = 10
    STOP_CAL = 11
    SAVE_DONE = 16
    CAL_SAMPLE_COUNT = 17
    CAL_SCORE = 18
    SET_CONFIG_DONE = 19
    START_CONTINUOUS = 21
    STOP_CONTINUOUS = 22
    POWER_UP_DONE = 23
    SET_ACQUISITION = 24
    SET_ACQUISITION_DONE = 26


class Component(IntEnum):
    """Component ids of a DATA frame that the driver uses."""

    HEADING = 5
    TEMPERATURE = 7
    DISTORTION = 8
    PITCH = 24
    ROLL = 25


# Other components: 9 calibration status, 21-23 accelerometer, 27-29 magnetometer, 74-76 gyro,
# 77 quaternion, 79 heading status.
_FLOAT_COMPONENTS = (5, 7, 21, 22, 23, 24, 25, 27, 28, 29, 74, 75, 76)
_COMPONENT_SIZES: Mapping[int, int] = {**dict.fromkeys(_FLOAT_COMPONENTS, 4), 8: 1, 9: 1, 77: 16, 79: 1}


def encode(frame_id: int, payload: bytes = b"") -> bytes:
    """Return a frame: byte count, frame id, payload, CRC-16 (poly 0x1021, init 0), big endian."""
    body = struct.pack(">HB", len(payload) + 5, frame_id) + payload
    return body + struct.pack(">H", xmodem(body))


def create_framer() -> PacketFramer:
    """Return a framer for this protocol."""
    return PacketFramer(_HEADER, 3, lambda header: header[1], PacketCheck(_is_checksum_valid))


def _is_checksum_valid(packet: bytes) -> bool:
    return bool(xmodem(packet[:-2]) == int.from_bytes(packet[-2:], "big"))


def frame_id(packet: bytes) -> int:
    """Return the frame id of a packet."""
    return packet[2]


def payload(packet: bytes) -> bytes:
    """Return the payload of a packet."""
    return packet[3:-2]


def parse_data(data: bytes) -> dict[int, float] | None:
    """Return the components of a DATA frame as {component id: value}; None if the sizes do not match.

    Multi-value components are skipped. The values are not checked.
    """
    if not data:
        return None
    values: dict[int, float] = {}
    index = 1
    for _ in range(data[0]):
        size = _COMPONENT_SIZES.get(data[index], 0) if index < len(data) else 0
        raw = data[index + 1 : index + 1 + size]
        if not size or len(raw) < size:
            return None
        if size == 4:
            values[data[index]] = struct.unpack(">f", raw)[0]
        elif size == 1:
            values[data[index]] = raw[0]
        index += 1 + size
    return values if index == len(data) else None
