"""Converts a DATA frame of a PNI compass and checks its ranges."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from firmware_py.common.driver import CaptureFormat
from firmware_py.sensors.decode import Result, decode_packets, round_values
from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range
from firmware_py.sensors.pni_protocol import Component, Frame, create_framer, frame_id, parse_data, payload

# Component, minimum, maximum in degrees or degrees Celsius.
_RANGES = (
    (Component.HEADING, 0.0, 360.0),
    (Component.PITCH, -90.0, 90.0),
    (Component.ROLL, -180.0, 180.0),
    (Component.TEMPERATURE, -100.0, 150.0),
)


class Reading(msgspec.Struct, frozen=True):
    """The values of a DATA frame; None for a missing component."""

    heading_magnetic_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    temperature_c: float | None
    distortion: bool | None


def read_data(data: bytes) -> Reading:
    """Return the values of a DATA frame, or raise MessageError."""
    values = parse_data(data)
    if values is None:
        raise MessageError(MALFORMED, "data frame malformed")
    for component, low, high in _RANGES:
        value = values.get(component)
        if value is not None:
            check_range(value, low, high, component.name.lower())
    distortion = values.get(Component.DISTORTION)
    return Reading(
        values.get(Component.HEADING),
        values.get(Component.PITCH),
        values.get(Component.ROLL),
        values.get(Component.TEMPERATURE),
        None if distortion is None else bool(distortion),
    )


def _decode_capture(data: bytes) -> Iterator[Result]:
    return decode_packets(data, create_framer(), _decode_frame)


def _decode_frame(packet: bytes) -> Result:
    frame = frame_id(packet)
    if frame == Frame.DATA:
        reading = read_data(payload(packet))
        return {"type": "heading", "frame_id": frame, **round_values("heading", msgspec.structs.asdict(reading))}
    if frame == Frame.MODULE_INFO:
        return {"type": "module_info", "frame_id": frame, "module": _printable_ascii(payload(packet))}
    return {"type": "other", "frame_id": frame}


def _printable_ascii(data: bytes) -> str:
    return "".join(chr(byte) if 0x20 <= byte <= 0x7E else "?" for byte in data)


CAPTURE_FORMAT = CaptureFormat("pni", _decode_capture)
