"""Reads the values of a data message of an Xsens MTi and checks their ranges.

Sources: MT0101P (formats of the values, units); MT0605P, section 4.13 (status word) and the table of yaw for each
reference frame.

Yaw is "the angle from a horizontal navigation axis to the projection of the longitudinal axis, right-handed about the
vertical axis". In NED the first axis is north and the vertical one points down, so yaw is the heading, clockwise from
north. Only NED is used. In ENU, the device's default, yaw is counterclockwise from east.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping

import msgspec

from firmware_py.common.angles import degrees, radians
from firmware_py.common.driver import CaptureFormat
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range
from firmware_py.sensors.mti_protocol import (
    FORMAT_BITS,
    DataId,
    Frame,
    Message,
    create_framer,
    error_text,
    message_id,
    parse_items,
    payload,
)

_PRECISION_BITS, _FRAME_BITS = 0x3, 0xC
_MAX_PITCH_DEG = 80.0  # near 90 degrees, heading and roll turn about the same axis
_MAX_RATE_OF_TURN_RAD_S = 40.0  # the largest range of a gyroscope is 2000 deg/s, 35 rad/s

# Bits of the status word.
_SELF_TEST_PASSED, _FILTER_VALID = 1 << 0, 1 << 1
_GYROSCOPE_CLIPPING_BITS = 0b111 << 11
_CLIPPING_BITS: Mapping[str, int] = {
    "accelerometer": 0b111 << 8,
    "gyroscope": _GYROSCOPE_CLIPPING_BITS,
    "magnetometer": 0b111 << 14,
}


class Reading(msgspec.Struct, frozen=True):
    """The values of a data message; None for a value that it does not contain.

    `frame` is None without Euler angles. Angles and yaw rate are None unless the message contains Euler angles in NED.
    The yaw rate is also None if a gyroscope is clipped or the device is nearly vertical.
    """

    frame: Frame | None
    heading_magnetic_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    yaw_rate_deg_s: float | None
    temperature_c: float | None
    status: int | None

    @property
    def is_valid(self) -> bool:
        """Whether the device marks its orientation as valid."""
        return self.status is not None and bool(self.status & _FILTER_VALID)

    @property
    def fault(self) -> str:
        """The fault that the device reports, empty for none."""
        return "" if self.status is None else status_fault_text(self.status)


def status_fault_text(status: int) -> str:
    """Return the faults in a status word, the most severe first; empty for none."""
    faults = []
    if not status & _FILTER_VALID:
        faults.append("orientation not valid")
    if not status & _SELF_TEST_PASSED:
        faults.append("self-test failed")
    clipped = [name for name, bits in _CLIPPING_BITS.items() if status & bits]
    if clipped:
        faults.append(f"out of range: {', '.join(clipped)}")
    return "; ".join(faults)


def read_data(data: bytes) -> Reading:
    """Return the values of an MT_DATA2, or raise MessageError."""
    frame: Frame | None = None
    euler_deg: tuple[float, ...] | None = None
    rates_rad_s: tuple[float, ...] | None = None
    temperature_c: float | None = None
    status: int | None = None
    for identifier, value in parse_items(data).items():
        kind, precision = identifier & ~FORMAT_BITS, identifier & _PRECISION_BITS
        if kind == DataId.EULER_ANGLES:
            frame, euler_deg = _read_frame(identifier), _read_euler_deg(value, precision)
        elif kind == DataId.RATE_OF_TURN:
            rates_rad_s = _unpack_numbers(value, precision, 3, "rate of turn")
            for number in rates_rad_s:
                check_range(number, -_MAX_RATE_OF_TURN_RAD_S, _MAX_RATE_OF_TURN_RAD_S, "rate of turn")
        elif kind == DataId.TEMPERATURE:
            temperature_c = check_range(
                _unpack_numbers(value, precision, 1, "temperature")[0], -100.0, 150.0, "temperature"
            )
        elif kind == DataId.STATUS_WORD:
            if len(value) != 4:
                raise MessageError(MALFORMED, "status word malformed")
            status = int.from_bytes(value, "big")
    if euler_deg is None or frame is not Frame.NED:
        return Reading(frame, None, None, None, None, temperature_c, status)
    roll_deg, pitch_deg, yaw_deg = euler_deg
    is_gyroscope_clipped = status is not None and bool(status & _GYROSCOPE_CLIPPING_BITS)
    yaw_rate_deg_s = None
    if rates_rad_s is not None and not is_gyroscope_clipped:
        yaw_rate_deg_s = _compute_yaw_rate_deg_s(roll_deg, pitch_deg, rates_rad_s)
    return Reading(
        frame, yaw_deg % 360.0, pitch_deg, _compute_boat_roll_deg(roll_deg), yaw_rate_deg_s, temperature_c, status
    )


def _read_euler_deg(value: bytes, precision: int) -> tuple[float, ...]:
    roll_deg, pitch_deg, yaw_deg = _unpack_numbers(value, precision, 3, "Euler angles")
    check_range(roll_deg, -180.0, 180.0, "roll")
    check_range(pitch_deg, -90.0, 90.0, "pitch")
    check_range(yaw_deg, -180.0, 180.0, "yaw")
    return roll_deg, pitch_deg, yaw_deg


def _read_frame(identifier: int) -> Frame:
    try:
        return Frame(identifier & _FRAME_BITS)
    except ValueError:
        raise MessageError(MALFORMED, "frame of the Euler angles is unknown") from None


def _compute_yaw_rate_deg_s(roll_deg: float, pitch_deg: float, rates_rad_s: tuple[float, ...]) -> float | None:
    """Return the rate of the heading of a tilted device from its gyroscopes, None for a nearly vertical device.

    The gyroscope axes are those of the device; the frame bits do not apply to them. If the label is up, the z axis
    points up and its rate is positive to port. The device then has a roll near 180 degrees, and the cosine of the roll
    changes the sign.
    """
    if abs(pitch_deg) > _MAX_PITCH_DEG:
        return None
    roll_rad, pitch_rad = radians(roll_deg), radians(pitch_deg)
    _, y_rad_s, z_rad_s = rates_rad_s
    return degrees((y_rad_s * math.sin(roll_rad) + z_rad_s * math.cos(roll_rad)) / math.cos(pitch_rad))


def _compute_boat_roll_deg(roll_deg: float) -> float:
    """Return the roll of the boat, whether the label of the device is up or down.

    If the label is up, the roll in NED differs by 180 degrees. Heading and pitch do not differ, because roll is the
    last of the three rotations. A capsized boat cannot be distinguished from a device that is mounted upside down.
    """
    if roll_deg > 90.0:
        return roll_deg - 180.0
    return roll_deg + 180.0 if roll_deg < -90.0 else roll_deg


def _unpack_numbers(value: bytes, precision: int, count: int, name: str) -> tuple[float, ...]:
    """Unpack `count` numbers of one of the four precisions, or raise MessageError."""
    size, unpack = _PRECISIONS[precision]
    if len(value) != size * count:
        raise MessageError(MALFORMED, f"{name} malformed")
    return tuple(unpack(value[index : index + size]) for index in range(0, len(value), size))


def _read_float32(raw: bytes) -> float:
    return float(struct.unpack(">f", raw)[0])


def _read_fixed_12_20(raw: bytes) -> float:
    return int.from_bytes(raw, "big", signed=True) / float(1 << 20)


def _read_fixed_16_32(raw: bytes) -> float:
    """Convert six bytes: four bytes of the fraction, then two of the integer part."""
    return int.from_bytes(raw[4:] + raw[:4], "big", signed=True) / float(1 << 32)


def _read_float64(raw: bytes) -> float:
    return float(struct.unpack(">d", raw)[0])


_PRECISIONS: Mapping[int, tuple[int, Callable[[bytes], float]]] = {
    0: (4, _read_float32),
    1: (4, _read_fixed_12_20),
    2: (6, _read_fixed_16_32),
    3: (8, _read_float64),
}


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_message)


def _decode_message(packet: bytes) -> Result:
    message, data = message_id(packet), payload(packet)
    message_field = {"message": Message(message).name}
    if message == Message.ERROR:
        return {"type": "other", **message_field, "text": error_text(data)}
    if message != Message.MT_DATA2:
        return {"type": "other", **message_field}
    reading = read_data(data)
    values = msgspec.structs.asdict(reading)
    values["frame"] = None if reading.frame is None else reading.frame.name
    values["status"] = None if reading.status is None else f"{reading.status:08X}"
    if reading.heading_magnetic_deg is None:  # another frame or no Euler angles
        present_values = {name: value for name, value in values.items() if value is not None}
        return {"type": "other", **message_field, **present_values}
    fault = {"fault": reading.fault} if reading.fault else {}
    return {"type": "heading", **message_field, **round_values("heading", values), **fault}


CAPTURE_FORMAT = CaptureFormat("mti", _decode_capture)
