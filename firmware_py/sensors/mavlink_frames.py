"""Frames of MAVLink 1 and 2 on the line of a flight controller: the messages that are read, and all that are sent.

Sources: mavlink.io, "Packet Serialization" (frames, CRC_EXTRA, payload truncation, extension fields) and "Message
Signing" (13 bytes after the checksum); the definitions common.xml and ardupilotmega.xml. All numbers are little endian,
the fields of a message in decreasing order of their size.

This codec is separate from that of the links, which uses pymavlink. It decodes ten messages and encodes three, so that
a driver cannot send anything that arms, moves or configures a flight controller, and no driver needs pymavlink.
The tests compare it with pymavlink. Signatures are not verified, because the line is a cable inside the hull.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

from firmware_py.common.crc16 import mcrf4xx
from firmware_py.sensors.binary_framing import PacketCheck, PacketFramer

_MARKER_1, _MARKER_2 = 0xFE, 0xFD
_HEADER_BYTES = {_MARKER_1: 6, _MARKER_2: 10}
_SIGNED_FLAG, _SIGNATURE_BYTES, _CHECKSUM_BYTES = 0x01, 13, 2

MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_AUTOPILOT_INVALID, MAV_AUTOPILOT_PX4 = 3, 8, 12
MAV_TYPE_GCS, _MAV_TYPE_ONBOARD_CONTROLLER = 6, 18
_MAV_STATE_ACTIVE, _MAVLINK_VERSION = 4, 3
MAV_CMD_SET_MESSAGE_INTERVAL = 511


class Message(IntEnum):
    """Ids of the messages that are read."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    SYSTEM_TIME = 2
    GPS_RAW_INT = 24
    ATTITUDE = 30
    GLOBAL_POSITION_INT = 33
    COMMAND_ACK = 77
    BATTERY_STATUS = 147
    EKF_STATUS_REPORT = 193  # of ardupilotmega.xml
    ESTIMATOR_STATUS = 230


class _Outgoing(IntEnum):
    """Ids of the messages that are sent: a closed list."""

    HEARTBEAT = 0
    REQUEST_DATA_STREAM = 66
    COMMAND_LONG = 76  # always with MAV_CMD_SET_MESSAGE_INTERVAL


class Stream(IntEnum):
    """Groups of messages of REQUEST_DATA_STREAM, as ArduPilot fills them."""

    EXTENDED_STATUS = 2  # SYS_STATUS, GPS_RAW_INT
    POSITION = 6  # GLOBAL_POSITION_INT
    EXTRA1 = 10  # ATTITUDE
    EXTRA3 = 12  # SYSTEM_TIME, BATTERY_STATUS, EKF_STATUS_REPORT


class _Layout(NamedTuple):
    """Payload of a message: its CRC_EXTRA, the fields of MAVLink 1, and the extension fields of MAVLink 2."""

    crc_extra: int
    base: struct.Struct
    extension: struct.Struct = struct.Struct("<")


_LAYOUTS: Mapping[int, _Layout] = {
    Message.HEARTBEAT: _Layout(50, struct.Struct("<IBBBBB")),
    Message.SYS_STATUS: _Layout(124, struct.Struct("<3IHHh6Hb"), struct.Struct("<3I")),
    Message.SYSTEM_TIME: _Layout(137, struct.Struct("<QI")),
    Message.GPS_RAW_INT: _Layout(24, struct.Struct("<Q3i4HBB"), struct.Struct("<iIIIIH")),
    Message.ATTITUDE: _Layout(39, struct.Struct("<I6f")),
    Message.GLOBAL_POSITION_INT: _Layout(104, struct.Struct("<I4i3hH")),
    Message.COMMAND_ACK: _Layout(143, struct.Struct("<HB"), struct.Struct("<BiBB")),
    Message.BATTERY_STATUS: _Layout(154, struct.Struct("<iih10HhBBBb"), struct.Struct("<iB4HBI")),
    Message.EKF_STATUS_REPORT: _Layout(71, struct.Struct("<5fH"), struct.Struct("<f")),
    Message.ESTIMATOR_STATUS: _Layout(163, struct.Struct("<Q8fH")),
}
_OUTGOING_LAYOUTS: Mapping[_Outgoing, _Layout] = {
    _Outgoing.HEARTBEAT: _LAYOUTS[Message.HEARTBEAT],
    _Outgoing.REQUEST_DATA_STREAM: _Layout(148, struct.Struct("<HBBBB")),
    _Outgoing.COMMAND_LONG: _Layout(152, struct.Struct("<7fHBBB")),
}


def _either(patterns: list[bytes]) -> bytes:
    return b"(?:" + b"|".join(patterns) + b")"


# Marker, length, (flags,) sequence, system, component, id. In MAVLink 1 each message has a fixed length; in MAVLink 2
# trailing zeros are truncated and newer definitions have more fields. The only known incompatibility flag is the
# signature.
_HEADER = re.compile(
    rb"\xfe%b|\xfd[^\x00][\x00\x01]..[^\x00].%b"
    % (
        _either([
            re.escape(bytes((layout.base.size,))) + rb".[^\x00]." + re.escape(bytes((message,)))
            for message, layout in _LAYOUTS.items()
        ]),
        _either([re.escape(message.to_bytes(3, "little")) for message in _LAYOUTS]),
    ),
    re.DOTALL,
)  # fmt: skip


class Frame(NamedTuple):
    """A frame with a valid checksum; `fields` in the order of the payload, extensions that are missing are 0."""

    message: Message
    system: int
    component: int
    fields: tuple[Any, ...]


def create_framer() -> PacketFramer:
    """Return a framer that finds the frames of the known messages; the bytes of all other messages are skipped."""
    return PacketFramer(_HEADER, 10, _frame_size, PacketCheck(_has_valid_checksum))


def _frame_size(header: bytes) -> int:
    signature_bytes = _SIGNATURE_BYTES if header[0] == _MARKER_2 and header[2] & _SIGNED_FLAG else 0
    return _HEADER_BYTES[header[0]] + header[1] + _CHECKSUM_BYTES + signature_bytes


def _message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little") if frame[0] == _MARKER_2 else frame[5]


def _has_valid_checksum(frame: bytes) -> bool:
    end = _HEADER_BYTES[frame[0]] + frame[1]
    expected = mcrf4xx(frame[1:end] + bytes((_LAYOUTS[_message_id(frame)].crc_extra,)))
    return expected == int.from_bytes(frame[end : end + _CHECKSUM_BYTES], "little")


def decode_frame(frame: bytes) -> Frame:
    """Return the content of a frame of `create_framer`."""
    start = _HEADER_BYTES[frame[0]]
    message = Message(_message_id(frame))
    _, base, extension = _LAYOUTS[message]
    size = base.size + extension.size
    payload = frame[start : start + frame[1]][:size].ljust(size, b"\0")
    return Frame(
        message, frame[start - (5 if start == 10 else 3)], frame[start - (4 if start == 10 else 2)],
        base.unpack_from(payload) + extension.unpack_from(payload, base.size),
    )  # fmt: skip


class Encoder:
    """Encodes the messages of one component to the flight controller, always as MAVLink 2 without a signature."""

    def __init__(self, component: int) -> None:
        """Store the id of the component; its system id is that of the flight controller."""
        self._component = component
        self._sequence = 0

    def heartbeat(self, system: int) -> bytes:
        """Return the heartbeat of an onboard controller."""
        kind = (_MAV_TYPE_ONBOARD_CONTROLLER, MAV_AUTOPILOT_INVALID)
        return self._encode(_Outgoing.HEARTBEAT, system, (0, *kind, 0, _MAV_STATE_ACTIVE, _MAVLINK_VERSION))

    def message_interval(self, system: int, component: int, message: Message, rate_hz: float) -> bytes:
        """Return the request to send a message at a rate on this line (MAV_CMD_SET_MESSAGE_INTERVAL)."""
        parameters = (float(message), math.floor(1e6 / rate_hz), 0.0, 0.0, 0.0, 0.0, 0.0)
        address = (MAV_CMD_SET_MESSAGE_INTERVAL, system, component, 0)
        return self._encode(_Outgoing.COMMAND_LONG, system, (*parameters, *address))

    def data_stream(self, system: int, component: int, stream: Stream, rate_hz: float) -> bytes:
        """Return the request of older flight controllers to send a group of messages at a rate."""
        values = (max(1, round(rate_hz)), system, component, stream, 1)
        return self._encode(_Outgoing.REQUEST_DATA_STREAM, system, values)

    def _encode(self, message: _Outgoing, system: int, values: tuple[float, ...]) -> bytes:
        crc_extra, base, _ = _OUTGOING_LAYOUTS[message]
        payload = base.pack(*values).rstrip(b"\0") or b"\0"
        address = bytes((self._sequence, system, self._component)) + message.to_bytes(3, "little")
        self._sequence = self._sequence + 1 & 0xFF
        covered = bytes((len(payload), 0, 0)) + address + payload
        return bytes((_MARKER_2,)) + covered + mcrf4xx(covered + bytes((crc_extra,))).to_bytes(2, "little")
