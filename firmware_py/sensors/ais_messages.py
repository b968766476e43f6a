"""Converts AIS messages to records in SI units with range checks.

Numbers that mean "not available" and numbers without a defined meaning become None. A position report without a
position is ignored, except that of a distress beacon, which becomes an empty identity. Source: ITU-R M.1371-5, annex 8,
tables 46 to 88.
"""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.angles import METRES_PER_SECOND_PER_KNOT, radians
from firmware_py.common.vessels import (
    STATUS_UNKNOWN,
    VesselIdentity,
    VesselKind,
    VesselPosition,
    VesselReport,
    is_distress_number,
)
from firmware_py.sensors.ais_payload import Payload
from firmware_py.sensors.message_error import RANGE, MessageError

MAX_MMSI = 999_999_999
_COARSE_UNITS_PER_DEGREE, _UNITS_PER_DEGREE = 600.0, 600_000.0  # type 27; all others
_UNKNOWN_SPEED, _UNKNOWN_COURSE, _UNKNOWN_HEADING = 1023, 3600, 511  # 0.1 knots, 0.1 degrees, degrees
_UNKNOWN_COARSE_SPEED, _UNKNOWN_COARSE_COURSE = 63, 360  # knots, degrees: type 27
_LONG_RANGE = 27
_MAX_TURN_NUMBER = 126  # 127 and -127 contain only the direction of the turn
_TURN_SCALE = 4.733  # the number is this factor times the square root of the turn rate in degrees per minute
_DIMENSION_NAMES = ("to_bow", "to_stern", "to_port", "to_starboard")
# By message type, for those with a position.
_KINDS: Mapping[int, VesselKind] = {
    1: VesselKind.CLASS_A,
    2: VesselKind.CLASS_A,
    3: VesselKind.CLASS_A,
    4: VesselKind.BASE_STATION,
    18: VesselKind.CLASS_B,
    19: VesselKind.CLASS_B,
    21: VesselKind.MARK,
    27: VesselKind.CLASS_A,
}


def decode_reports(payload: Payload, now_s: float) -> tuple[VesselReport, ...]:
    """Return the reports of a message, the position first; raises MessageError for an invalid MMSI or position."""
    if not 0 < payload.mmsi <= MAX_MMSI:
        raise MessageError(RANGE, f"MMSI {payload.mmsi} is invalid")
    position = _decode_position(payload, now_s) if payload.message_type in _KINDS else None
    identity = _decode_identity(payload, now_s)
    if position is None and identity is None and is_distress_number(payload.mmsi):
        identity = VesselIdentity(now_s, payload.mmsi)  # a distress beacon without a position yet
    return tuple(report for report in (position, identity) if report is not None)


def _decode_position(payload: Payload, now_s: float) -> VesselPosition | None:
    numbers, is_coarse = payload.numbers, payload.message_type == _LONG_RANGE
    scale = _COARSE_UNITS_PER_DEGREE if is_coarse else _UNITS_PER_DEGREE
    latitude_deg, longitude_deg = numbers["latitude"] / scale, numbers["longitude"] / scale
    if latitude_deg == 91.0 or longitude_deg == 181.0:
        return None  # not available
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        raise MessageError(RANGE, f"{payload.mmsi:09d}: position {latitude_deg:.1f}, {longitude_deg:.1f} is invalid")
    return VesselPosition(
        t_s=now_s,
        mmsi=payload.mmsi,
        kind=_KINDS[payload.message_type],
        latitude_rad=radians(latitude_deg),
        longitude_rad=radians(longitude_deg),
        speed_m_s=_decode_speed_m_s(numbers.get("speed"), is_coarse=is_coarse),
        course_rad=_decode_course_rad(numbers.get("course"), is_coarse=is_coarse),
        heading_rad=_decode_heading_rad(numbers.get("heading", _UNKNOWN_HEADING)),
        turn_rad_s=_decode_turn_rad_s(numbers.get("turn")),
        status=numbers.get("status", STATUS_UNKNOWN),
        accurate=bool(numbers["accurate"]),
    )


def _decode_speed_m_s(number: int | None, *, is_coarse: bool) -> float | None:
    if number is None or number >= (_UNKNOWN_COARSE_SPEED if is_coarse else _UNKNOWN_SPEED):
        return None
    return (number if is_coarse else number / 10.0) * METRES_PER_SECOND_PER_KNOT


def _decode_course_rad(number: int | None, *, is_coarse: bool) -> float | None:
    if number is None or number >= (_UNKNOWN_COARSE_COURSE if is_coarse else _UNKNOWN_COURSE):
        return None
    return radians(float(number) if is_coarse else number / 10.0)


def _decode_heading_rad(number: int) -> float | None:
    return radians(float(number)) if number < 360 else None


def _decode_turn_rad_s(number: int | None) -> float | None:
    if number is None or abs(number) > _MAX_TURN_NUMBER:
        return None
    turn_deg_min = (number / _TURN_SCALE) ** 2
    return radians(turn_deg_min / 60.0) * (-1.0 if number < 0 else 1.0)


def _decode_identity(payload: Payload, now_s: float) -> VesselIdentity | None:
    """Return the static data of a message, None if it has none."""
    numbers, texts = payload.numbers, payload.texts
    to_bow, to_stern, to_port, to_starboard = dimensions = [numbers.get(name, 0) for name in _DIMENSION_NAMES]
    # An auxiliary craft (MMSI 98...) sends the MMSI of its mother ship in place of its dimensions.
    has_dimensions = any(dimensions) and payload.mmsi // 10**7 != 98
    identity = VesselIdentity(
        t_s=now_s,
        mmsi=payload.mmsi,
        name=texts.get("name", ""),
        call_sign=texts.get("call_sign", ""),
        ship_type=numbers.get("ship_type", 0),
        dimensions_m=(to_bow, to_stern, to_port, to_starboard) if has_dimensions else None,
    )
    has_content = identity.name or identity.call_sign or identity.ship_type or identity.dimensions_m
    return identity if has_content else None
