"""Frames and values of the Xbus protocol on the side of the device (MT Low Level Communication Protocol, MT0101P).

Written from the document and from captures of a real device, independent of the driver's codec.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from enum import IntEnum

from hil.devices.timing import ReceiveBuffer

_MAX_COMMAND_BYTES = 5 + 32 * 4  # a list of 32 outputs
Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]


class Mid(IntEnum):
    """Message ids."""

    REQ_DID = 0x00
    DEVICE_ID = 0x01
    CONFIGURATION = 0x0D
    GOTO_MEASUREMENT = 0x10
    GOTO_CONFIG = 0x30
    MTDATA2 = 0x36
    WAKEUP = 0x3E
    WAKEUP_ACK = 0x3F
    ERROR = 0x42
    OUTPUT_CONFIG = 0xC0


class Xdi(IntEnum):
    """Data types, without the format bits."""

    TEMPERATURE = 0x0810
    PACKET_COUNTER = 0x1020
    SAMPLE_TIME_FINE = 0x1060
    EULER = 0x2030
    RATE_OF_TURN = 0x8020
    STATUS = 0xE020


def pack_message(mid: int, data: bytes = b"") -> bytes:
    """Return a complete message, with the long form of the length if necessary."""
    length = bytes([len(data)]) if len(data) < 0xFF else b"\xff" + len(data).to_bytes(2, "big")
    summed_bytes = bytes([0xFF, mid]) + length + data
    return b"\xfa" + summed_bytes + bytes([(0x100 - sum(summed_bytes) % 0x100) % 0x100])


def pack_values(values: Sequence[float], precision: int) -> bytes:
    """Encode numbers; `precision` is 0 float, 1 fixed 12.20, 2 fixed 16.32 (fraction first) or 3 double."""
    if precision == 0:
        return struct.pack(f">{len(values)}f", *values)
    if precision == 3:
        return struct.pack(f">{len(values)}d", *values)
    if precision == 1:
        return struct.pack(f">{len(values)}i", *(round(value * 2.0**20) for value in values))
    packed = b""
    for value in values:
        integer = math.floor(value)
        fraction = min(int((value - integer) * 2.0**32), 0xFFFF_FFFF)
        packed += struct.pack(">Ih", fraction, integer)
    return packed


class MessageReader:
    """Finds messages in the bytes from the host and skips damaged messages."""

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._buffer = ReceiveBuffer(max_bytes=2 * _MAX_COMMAND_BYTES)

    def feed(self, now_s: float, data: bytes) -> list[tuple[int, bytes]]:
        """Add bytes and return (message id, data) of the messages that they complete."""
        self._buffer.append(now_s, data)
        buffer = self._buffer.data
        messages: list[tuple[int, bytes]] = []
        start = 0
        while len(buffer) - start >= 5:
            length = buffer[start + 3]
            if buffer[start] != 0xFA or buffer[start + 1] != 0xFF or 5 + length > _MAX_COMMAND_BYTES:
                start += 1
                continue
            end = start + 5 + length
            if len(buffer) < end:
                break
            if sum(buffer[start + 1 : end]) % 0x100 == 0:
                messages.append((buffer[start + 2], bytes(buffer[start + 4 : end - 1])))
                start = end
            else:
                start += 1
        del buffer[:start]
        return messages

    def clear(self) -> None:
        """Discard an incomplete message."""
        self._buffer.clear()


# Rotations from ENU to the configured frame (RotLocal of the user manual MT0605P); the keys are the frame bits.
LOCAL_FRAMES: dict[int, Matrix] = {
    0x0: ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    0x4: ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),  # NED
    0x8: ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),  # NWU
}


def sensor_in_enu(heading_rad: float, pitch_rad: float, roll_rad: float) -> Matrix:
    """Return the matrix whose columns are the sensor's forward, port and up axes in east, north and up.

    Heading is positive clockwise from north, pitch with the bow up, roll with the starboard side down.
    """
    sh, ch = math.sin(heading_rad), math.cos(heading_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    forward = (sh * cp, ch * cp, sp)
    port_level = (-ch, sh, 0.0)
    up_pitched = (-sh * sp, -ch * sp, cp)
    port = tuple(cr * a + sr * b for a, b in zip(port_level, up_pitched, strict=True))
    up = tuple(cr * b - sr * a for a, b in zip(port_level, up_pitched, strict=True))
    return ((forward[0], port[0], up[0]), (forward[1], port[1], up[1]), (forward[2], port[2], up[2]))


def euler_deg(local: Matrix, sensor: Matrix) -> tuple[float, float, float]:
    """Return roll, pitch and yaw in degrees of the sensor's axes in a local frame (sequence Z, Y', X'')."""
    sensor_in_local = [[sum(local[i][k] * sensor[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    return (
        math.degrees(math.atan2(sensor_in_local[2][1], sensor_in_local[2][2])),
        math.degrees(-math.asin(max(-1.0, min(1.0, sensor_in_local[2][0])))),
        math.degrees(math.atan2(sensor_in_local[1][0], sensor_in_local[0][0])),
    )
