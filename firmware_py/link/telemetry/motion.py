"""Telemetry of attitude, position, home, goal and rudder, of the quality of the estimates, and of other vessels."""

from __future__ import annotations

import math

from firmware_py.common.angles import compass_degrees, degrees, wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.records import FixType
from firmware_py.common.reports import Estimate
from firmware_py.common.vessels import MAX_CALL_SIGN_CHARACTERS, MAX_NAME_CHARACTERS, Vessel, VesselIdentity
from firmware_py.link.telemetry.fields import (
    INT8_MAX,
    INT16_MAX,
    INT32_MAX,
    UINT8_MAX,
    UINT16_MAX,
    UINT32_MAX,
    TelemetryContext,
    best_position,
    boot_ms,
    boot_us,
    fresh_fix,
    scaled_degrees,
    to_float32,
    to_integer,
)
from firmware_py.link.wire.dialect import Message, encode_text, mavlink

_ATTITUDE_ONLY = 0b0100_0111  # type_mask of ATTITUDE_TARGET: rates and thrust are not used
_UINT16_MAX_VALID = UINT16_MAX - 1

_NO_ROTATION = (0.0, 0.0, 0.0, 0.0)  # repr_offset_q without a value
_HORIZONTAL_POSITION_ONLY = 0b0000_1101_1111_1100  # POSITION_TARGET_TYPEMASK
_UNKNOWN = math.nan
_OUTLIER_SDS = 5.0  # an innovation of more standard deviations is an outlier

_ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
_VELOCITY = mavlink.ESTIMATOR_VELOCITY_HORIZ
_POSITION = (
    mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)

_VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
_DEAD_RECKONING = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL

_MAX_LENGTH_M, _MAX_WIDTH_M = 511, 63  # maxima of the dimensions in AIS, which also stand for larger values
_UNKNOWN_VESSEL = VesselIdentity(0.0, 0)
# The vessel of a message follows from the time only, with irrational steps, so that a peer with any interval receives
# all vessels in turn. 40 % of the turns are for approaching vessels and distress beacons.
_VESSEL_STEP, _PRIORITY_STEP, _PRIORITY_SHARE = 0.5 * (math.sqrt(5.0) - 1.0), math.sqrt(2.0), 0.4
_TURNS_HZ = 10.0


def heading_centidegrees(heading_rad: float | None) -> int:
    """Convert a heading to centidegrees in [0, 35999]; UINT16_MAX if it is unknown."""
    if heading_rad is None or not math.isfinite(heading_rad):
        return UINT16_MAX
    return round(compass_degrees(heading_rad) * 100.0) % 36000


def _integer_degrees(heading_rad: float | None) -> int:
    centidegrees = heading_centidegrees(heading_rad)
    return 0 if centidegrees == UINT16_MAX else round(centidegrees / 100.0) % 360


def attitude(context: TelemetryContext) -> Message | None:
    """Build ATTITUDE; None while the heading is old. Roll and pitch are 0 if the compass does not measure them."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok:
        return None
    return mavlink.MAVLink_attitude_message(
        boot_ms(boat.t_s),
        to_float32(boat.roll_rad),
        to_float32(boat.pitch_rad),
        to_float32(wrap_pi(boat.heading_rad)),
        0.0,
        0.0,
        to_float32(boat.yaw_rate_rad_s),
    )


def vfr_hud(context: TelemetryContext) -> Message | None:
    """Build VFR_HUD; None while the heading is old. `airspeed` is the speed through the water."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok:
        return None
    fix = fresh_fix(context)
    speed_m_s = None if fix is None else fix.speed_over_ground_m_s
    altitude_m = None if fix is None else fix.altitude_m
    through_water_m_s = None if boat.water is None else boat.water.speed_m_s
    return mavlink.MAVLink_vfr_hud_message(
        to_float32(through_water_m_s),
        to_float32(speed_m_s),
        _integer_degrees(boat.heading_rad),
        0,
        to_float32(altitude_m),
        0.0,
    )


def gps_raw_int(context: TelemetryContext) -> Message:
    """Build GPS_RAW_INT. The fix type is NO_GPS without a receiver, and NO_FIX if the fix is old."""
    sample = context.snapshot.position
    fix = fresh_fix(context)
    type_without_fix = mavlink.GPS_FIX_TYPE_NO_GPS if sample is None else FixType.NONE
    speed_m_s = fix.speed_over_ground_m_s if fix else None
    altitude_m = fix.altitude_m if fix else None
    return mavlink.MAVLink_gps_raw_int_message(
        boot_us(sample.t_s if sample else context.snapshot.t_s),
        int(fix.fix if fix else type_without_fix),
        scaled_degrees(fix.latitude_rad if fix else None),
        scaled_degrees(fix.longitude_rad if fix else None),
        to_integer(None if altitude_m is None else altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        to_integer(None if fix is None or fix.hdop is None else fix.hdop * 100.0, 0, _UINT16_MAX_VALID, UINT16_MAX),
        UINT16_MAX,
        to_integer(None if speed_m_s is None else speed_m_s * 100.0, 0, _UINT16_MAX_VALID, UINT16_MAX),
        heading_centidegrees(fix.course_over_ground_rad if fix else None),
        to_integer(sample.satellites if sample else None, 0, UINT8_MAX - 1, UINT8_MAX),
    )


def global_position_int(context: TelemetryContext) -> Message | None:
    """Build GLOBAL_POSITION_INT with the GNSS or dead-reckoned position; None without both.

    The fix type of GPS_RAW_INT shows which of the two it is.
    """
    fix = best_position(context)
    if fix is None:
        return None
    speed_m_s = fix.speed_over_ground_m_s or 0.0
    course_rad = fix.course_over_ground_rad or 0.0
    altitude_m = fix.altitude_m or 0.0
    above_home_m = altitude_m - context.snapshot.home.altitude_m if context.snapshot.home is not None else 0.0
    boat = context.snapshot
    return mavlink.MAVLink_global_position_int_message(
        boot_ms(boat.t_s),
        scaled_degrees(fix.latitude_rad),
        scaled_degrees(fix.longitude_rad),
        to_integer(altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        to_integer(above_home_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        to_integer(100.0 * speed_m_s * _cosine(course_rad), -INT16_MAX, INT16_MAX, 0),
        to_integer(100.0 * speed_m_s * _cosine(course_rad - math.pi / 2.0), -INT16_MAX, INT16_MAX, 0),
        0,
        heading_centidegrees(boat.heading_rad if boat.heading_ok else None),
    )


def _cosine(angle_rad: float) -> float:
    return math.cos(angle_rad) if math.isfinite(angle_rad) else 0.0


def nav_controller_output(context: TelemetryContext) -> Message | None:
    """Build NAV_CONTROLLER_OUTPUT; None without a heading goal. `xtrack_error` is positive to starboard of the line."""
    boat = context.snapshot
    if boat.goal_heading_rad is None:
        return None
    bearing_rad = boat.goal_heading_rad if boat.bearing_rad is None else boat.bearing_rad
    return mavlink.MAVLink_nav_controller_output_message(
        0.0,
        0.0,
        _integer_degrees(boat.goal_heading_rad),
        _integer_degrees(bearing_rad),
        to_integer(boat.distance_m, 0, UINT16_MAX, 0),
        0.0,
        0.0,
        to_float32(boat.navigation.cross_track_m),
    )


def attitude_target(context: TelemetryContext) -> Message | None:
    """Build ATTITUDE_TARGET; None without a heading goal."""
    goal_rad = context.snapshot.goal_heading_rad
    if goal_rad is None or not math.isfinite(goal_rad):
        return None
    half_rad = wrap_pi(goal_rad) / 2.0
    quaternion = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
    time_ms = boot_ms(context.snapshot.t_s)
    return mavlink.MAVLink_attitude_target_message(time_ms, _ATTITUDE_ONLY, quaternion, 0.0, 0.0, 0.0, 0.0)


def servo_output_raw(context: TelemetryContext) -> Message:
    """Build SERVO_OUTPUT_RAW: servo 1 is the rudder command, 2000 us at the rudder limit to starboard.

    The measured angle is NAMED_VALUE_FLOAT `RUDDER`, an estimated one `RUD_EST`.
    """
    deflection = context.snapshot.rudder_command_rad / context.rudder_limit_rad
    pulse_us = to_integer(1500.0 + 500.0 * deflection, 1000, 2000, 0)
    time_us = boot_us(context.snapshot.t_s) & UINT32_MAX
    return mavlink.MAVLink_servo_output_raw_message(time_us, 0, pulse_us, 0, 0, 0, 0, 0, 0, 0)


def home_position(context: TelemetryContext) -> Message | None:
    """Build HOME_POSITION; None before the first fix."""
    home = context.snapshot.home
    if home is None:
        return None
    return mavlink.MAVLink_home_position_message(
        scaled_degrees(home.latitude_rad),
        scaled_degrees(home.longitude_rad),
        to_integer(home.altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        0.0,
        0.0,
        0.0,
        (1.0, 0.0, 0.0, 0.0),
        0.0,
        0.0,
        0.0,
        boot_us(context.snapshot.t_s),
    )


def attitude_quaternion(context: TelemetryContext) -> Message | None:
    """Build ATTITUDE_QUATERNION with the angles of ATTITUDE; None while the heading is old."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok or not math.isfinite(boat.heading_rad):
        return None
    w, x, y, z = quaternion(to_float32(boat.roll_rad), to_float32(boat.pitch_rad), boat.heading_rad)
    yaw_rate_rad_s = to_float32(boat.yaw_rate_rad_s)
    return mavlink.MAVLink_attitude_quaternion_message(
        boot_ms(boat.t_s), w, x, y, z, 0.0, 0.0, yaw_rate_rad_s, _NO_ROTATION
    )


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of a rotation by yaw, then pitch, then roll."""
    half_roll, half_pitch, half_yaw = (wrap_pi(angle_rad) / 2.0 for angle_rad in (roll_rad, pitch_rad, yaw_rad))
    cr, sr = math.cos(half_roll), math.sin(half_roll)
    cp, sp = math.cos(half_pitch), math.sin(half_pitch)
    cy, sy = math.cos(half_yaw), math.sin(half_yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def local_position_ned(context: TelemetryContext) -> Message | None:
    """Build LOCAL_POSITION_NED relative to home; None without home or without a GNSS or dead-reckoned position."""
    fix, home = best_position(context), context.snapshot.home
    if fix is None or home is None or fix.latitude_rad is None or fix.longitude_rad is None:
        return None
    if not all(map(math.isfinite, (home.latitude_rad, home.longitude_rad, fix.latitude_rad, fix.longitude_rad))):
        return None
    origin = Place(home.latitude_rad, home.longitude_rad)
    north_m, east_m = origin.local_offset_m(Place(fix.latitude_rad, fix.longitude_rad))
    above_m = 0.0 if fix.altitude_m is None else fix.altitude_m - home.altitude_m
    speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
    north_m_s = east_m_s = 0.0
    if speed_m_s is not None and course_rad is not None and math.isfinite(course_rad):
        north_m_s, east_m_s = speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad)
    return mavlink.MAVLink_local_position_ned_message(
        boot_ms(context.snapshot.t_s),
        to_float32(north_m),
        to_float32(east_m),
        to_float32(-above_m),
        to_float32(north_m_s),
        to_float32(east_m_s),
        0.0,
    )


def gps_global_origin(context: TelemetryContext) -> Message | None:
    """Build GPS_GLOBAL_ORIGIN: home is the origin of the local coordinates. None without home."""
    home = context.snapshot.home
    if home is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(
        scaled_degrees(home.latitude_rad),
        scaled_degrees(home.longitude_rad),
        to_integer(home.altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        boot_us(context.snapshot.t_s),
    )


def position_target(context: TelemetryContext) -> Message | None:
    """Build POSITION_TARGET_GLOBAL_INT; None without a position goal and loiter point."""
    boat = context.snapshot
    latitude_rad, longitude_rad = boat.navigation.target_latitude_rad, boat.navigation.target_longitude_rad
    if latitude_rad is None or longitude_rad is None or not math.isfinite(latitude_rad + longitude_rad):
        return None
    masked_values = (0.0,) * 9  # altitude, velocity, acceleration, yaw, yaw rate
    return mavlink.MAVLink_position_target_global_int_message(
        boot_ms(boat.t_s),
        mavlink.MAV_FRAME_GLOBAL,
        _HORIZONTAL_POSITION_ONLY,
        scaled_degrees(latitude_rad),
        scaled_degrees(longitude_rad),
        *masked_values,
    )


def estimator_status(context: TelemetryContext) -> Message:
    """Build ESTIMATOR_STATUS with the validity of heading, velocity and position; NaN for values not estimated.

    A dead-reckoned position has the flags of a relative position, and its accuracy. `mag_ratio` is the innovation of
    the latest heading divided by five of its standard deviations; from 1 on it is an outlier.
    """
    boat = context.snapshot
    return mavlink.MAVLink_estimator_status_message(
        boot_us(boat.t_s),
        _estimator_flags(context),
        vel_ratio=_UNKNOWN,
        pos_horiz_ratio=_UNKNOWN,
        pos_vert_ratio=_UNKNOWN,
        mag_ratio=_heading_ratio(boat.estimate),
        hagl_ratio=_UNKNOWN,
        tas_ratio=_UNKNOWN,
        pos_horiz_accuracy=_UNKNOWN if boat.dead_reckoning is None else to_float32(boat.dead_reckoning.sd_m, _UNKNOWN),
        pos_vert_accuracy=_UNKNOWN,
    )


def _estimator_flags(context: TelemetryContext) -> int:
    boat, fix = context.snapshot, fresh_fix(context)
    has_velocity = fix is not None and fix.speed_over_ground_m_s is not None and fix.course_over_ground_rad is not None
    flags = (_ATTITUDE if boat.heading_ok else 0) | (_POSITION if fix else 0) | (_VELOCITY if has_velocity else 0)
    return flags | (0 if boat.dead_reckoning is None else _DEAD_RECKONING)


def ekf_status_report(context: TelemetryContext) -> Message:
    """Build EKF_STATUS_REPORT of ArduPilot, which DroneKit requires before it arms.

    Its flags are those of ESTIMATOR_STATUS and, with a fix, the vertical ones, since the boat floats. A ratio that is
    not estimated is 0, since stations compare the highest ratio with 1.
    """
    flags, ratio = _estimator_flags(context), _heading_ratio(context.snapshot.estimate)
    if fresh_fix(context) is not None:
        flags |= _VERTICAL
    compass_ratio = ratio if math.isfinite(ratio) else 0.0
    return mavlink.mavlink_map[193](flags, 0.0, 0.0, 0.0, compass_ratio, 0.0, 0.0)


def _heading_ratio(estimate: Estimate | None) -> float:
    if estimate is None or not estimate.innovation_sd_rad > 0.0:
        return _UNKNOWN
    return to_float32(abs(estimate.innovation_rad) / (_OUTLIER_SDS * estimate.innovation_sd_rad), _UNKNOWN)


def ais_vessel(context: TelemetryContext) -> Message | None:
    """Build AIS_VESSEL of the next vessel, with more turns for approaching vessels and distress beacons.

    There is one vessel per message, so that the data rate does not depend on the number of vessels. None without one.
    """
    boat = context.snapshot
    if boat.traffic is None or not boat.traffic.vessels:
        return None
    turn, vessels = math.floor(boat.t_s * _TURNS_HZ), boat.traffic.vessels
    if turn * _PRIORITY_STEP % 1.0 < _PRIORITY_SHARE:
        priority = tuple(vessel for vessel in vessels if vessel.near_s is not None or vessel.is_distress_beacon)
        vessels = priority or vessels
    return _vessel_message(vessels[int(turn * _VESSEL_STEP % 1.0 * len(vessels))], boat.t_s)


def _vessel_message(vessel: Vessel, now_s: float) -> Message:
    position, identity = vessel.position, vessel.identity or _UNKNOWN_VESSEL
    to_bow, to_stern, to_port, to_starboard = identity.dimensions_m or (UINT16_MAX, UINT16_MAX, UINT8_MAX, UINT8_MAX)
    flags = (
        (mavlink.AIS_FLAGS_POSITION_ACCURACY, position.accurate),
        (mavlink.AIS_FLAGS_VALID_COG, position.course_rad is not None),
        (mavlink.AIS_FLAGS_VALID_VELOCITY, position.speed_m_s is not None),
        (mavlink.AIS_FLAGS_VALID_TURN_RATE, position.turn_rad_s is not None),
        (mavlink.AIS_FLAGS_VALID_DIMENSIONS, identity.dimensions_m is not None),
        (mavlink.AIS_FLAGS_LARGE_BOW_DIMENSION, to_bow == _MAX_LENGTH_M),
        (mavlink.AIS_FLAGS_LARGE_STERN_DIMENSION, to_stern == _MAX_LENGTH_M),
        (mavlink.AIS_FLAGS_LARGE_PORT_DIMENSION, to_port == _MAX_WIDTH_M),
        (mavlink.AIS_FLAGS_LARGE_STARBOARD_DIMENSION, to_starboard == _MAX_WIDTH_M),
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
        to_integer(
            None if position.speed_m_s is None else 100.0 * position.speed_m_s, 0, _UINT16_MAX_VALID, UINT16_MAX
        ),
        to_integer(None if turn_deg_s is None else 10.0 * turn_deg_s, -INT8_MAX, INT8_MAX - 1, INT8_MAX),
        position.status,
        identity.ship_type,
        to_bow,
        to_stern,
        to_port,
        to_starboard,
        encode_text(identity.call_sign, MAX_CALL_SIGN_CHARACTERS),
        encode_text(identity.name, MAX_NAME_CHARACTERS),
        to_integer(now_s - position.t_s, 0, UINT16_MAX, UINT16_MAX),
        sum(flag for flag, is_set in flags if is_set),
    )
