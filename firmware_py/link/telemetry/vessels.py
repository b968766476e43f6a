"""Telemetry of other vessels: one AIS_VESSEL at a time, so that the data rate does not depend on their number."""

from __future__ import annotations

import math

from firmware_py.common.angles import degrees
from firmware_py.common.vessels import MAX_CALL_SIGN_CHARACTERS, MAX_NAME_CHARACTERS, Vessel, VesselIdentity
from firmware_py.link.telemetry.fields import INT32_MAX, UINT8_MAX, UINT16_MAX, TelemetryContext, scaled_degrees, whole
from firmware_py.link.telemetry.motion import heading_centidegrees
from firmware_py.link.wire.dialect import Message, mavlink, text_of

_INT8_MAX = 0x7F
_LONGEST_M, _WIDEST_M = 511, 63  # the largest numbers of AIS, which mean this or more
_UNKNOWN_VESSEL = VesselIdentity(0.0, 0)
# The turn follows from the time alone, by irrational steps, so that every interval reaches every vessel.
_ROUND, _NEAR_ROUND, _NEAR_SHARE = 0.5 * (math.sqrt(5.0) - 1.0), math.sqrt(2.0), 0.4
_TURNS_HZ = 10.0


def ais_vessel(context: TelemetryContext) -> Message | None:
    """Return AIS_VESSEL of the next vessel; approaching vessels and distress beacons have more turns."""
    boat = context.snapshot
    if boat.traffic is None or not boat.traffic.vessels:
        return None
    turn, vessels = math.floor(boat.t_s * _TURNS_HZ), boat.traffic.vessels
    if turn * _NEAR_ROUND % 1.0 < _NEAR_SHARE:
        vessels = (
            tuple(vessel for vessel in vessels if vessel.near_s is not None or vessel.is_distress_beacon) or vessels
        )
    return _message(vessels[int(turn * _ROUND % 1.0 * len(vessels))], boat.t_s)


def _message(vessel: Vessel, now_s: float) -> Message:
    position, identity = vessel.position, vessel.identity or _UNKNOWN_VESSEL
    to_bow, to_stern, to_port, to_starboard = identity.dimensions_m or (UINT16_MAX, UINT16_MAX, UINT8_MAX, UINT8_MAX)
    flags = (
        (mavlink.AIS_FLAGS_POSITION_ACCURACY, position.accurate),
        (mavlink.AIS_FLAGS_VALID_COG, position.course_rad is not None),
        (mavlink.AIS_FLAGS_VALID_VELOCITY, position.speed_m_s is not None),
        (mavlink.AIS_FLAGS_VALID_TURN_RATE, position.turn_rad_s is not None),
        (mavlink.AIS_FLAGS_VALID_DIMENSIONS, identity.dimensions_m is not None),
        (mavlink.AIS_FLAGS_LARGE_BOW_DIMENSION, to_bow == _LONGEST_M),
        (mavlink.AIS_FLAGS_LARGE_STERN_DIMENSION, to_stern == _LONGEST_M),
        (mavlink.AIS_FLAGS_LARGE_PORT_DIMENSION, to_port == _WIDEST_M),
        (mavlink.AIS_FLAGS_LARGE_STARBOARD_DIMENSION, to_starboard == _WIDEST_M),
        (mavlink.AIS_FLAGS_VALID_CALLSIGN, bool(identity.call_sign)),
        (mavlink.AIS_FLAGS_VALID_NAME, bool(identity.name)),
    )
    turn_deg_s = None if position.turn_rad_s is None else degrees(position.turn_rad_s)
    return mavlink.MAVLink_ais_vessel_message(
        position.mmsi,
        scaled_degrees(position.latitude_rad, INT32_MAX),
        scaled_degrees(position.longitude_rad, INT32_MAX),
        heading_centidegrees(position.course_rad),
        heading_centidegrees(position.heading_rad),
        whole(None if position.speed_m_s is None else 100.0 * position.speed_m_s, 0, UINT16_MAX - 1, UINT16_MAX),
        whole(None if turn_deg_s is None else 10.0 * turn_deg_s, -_INT8_MAX, _INT8_MAX - 1, _INT8_MAX),
        position.status,
        identity.ship_type,
        to_bow,
        to_stern,
        to_port,
        to_starboard,
        text_of(identity.call_sign, MAX_CALL_SIGN_CHARACTERS),
        text_of(identity.name, MAX_NAME_CHARACTERS),
        whole(now_s - position.t_s, 0, UINT16_MAX, UINT16_MAX),
        sum(flag for flag, is_so in flags if is_so),
    )
