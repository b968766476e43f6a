"""Telemetry of attitude, position, home, goal and rudder, and how far the estimates can be relied on."""

from __future__ import annotations

import math

from firmware_py.common.angles import compass_degrees, wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.records import FixType
from firmware_py.common.reports import Estimate
from firmware_py.link.telemetry.fields import (
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
    single,
    whole,
)
from firmware_py.link.wire.dialect import Message, mavlink

_UNUSED_ATTITUDE = 0b0100_0111  # ATTITUDE_TARGET: rates and thrust mean nothing, the quaternion does
_DOP_MAX = UINT16_MAX - 1

_NO_ROTATION = (0.0, 0.0, 0.0, 0.0)  # repr_offset_q: "not set"
# POSITION_TARGET_TYPEMASK: only the horizontal position is valid.
_PLACE_ONLY = 0b0000_1101_1111_1100
_UNKNOWN = math.nan
_OUTLIER_SDS = 5.0

_ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
_VELOCITY = mavlink.ESTIMATOR_VELOCITY_HORIZ
_PLACE = (
    mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)

_VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
_DEAD_RECKONING = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL


def heading_centidegrees(heading_rad: float | None) -> int:
    """Return a heading in [0, 35999], or UINT16_MAX for none."""
    if heading_rad is None or not math.isfinite(heading_rad):
        return UINT16_MAX
    return round(compass_degrees(heading_rad) * 100.0) % 36000


def _whole_degrees(heading_rad: float | None) -> int:
    number = heading_centidegrees(heading_rad)
    return 0 if number == UINT16_MAX else round(number / 100.0) % 360


def attitude(context: TelemetryContext) -> Message | None:
    """Return ATTITUDE while the heading is fresh; roll and pitch are 0 where the compass gives none."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok:
        return None
    return mavlink.MAVLink_attitude_message(
        boot_ms(boat.t_s),
        single(boat.roll_rad),
        single(boat.pitch_rad),
        single(wrap_pi(boat.heading_rad)),
        0.0,
        0.0,
        single(boat.yaw_rate_rad_s),
    )


def vfr_hud(context: TelemetryContext) -> Message | None:
    """Return VFR_HUD while the heading is fresh, since it has no value for unknown; airspeed is speed through water."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok:
        return None
    fix = fresh_fix(context)
    speed_m_s = None if fix is None else fix.speed_over_ground_m_s
    altitude_m = None if fix is None else fix.altitude_m
    through_water_m_s = None if boat.water is None else boat.water.speed_m_s
    return mavlink.MAVLink_vfr_hud_message(
        single(through_water_m_s), single(speed_m_s), _whole_degrees(boat.heading_rad), 0, single(altitude_m), 0.0
    )


def gps_raw_int(context: TelemetryContext) -> Message:
    """Return GPS_RAW_INT: NO_GPS without a receiver, NO_FIX if its fix is old."""
    sample = context.snapshot.position
    fix = fresh_fix(context)
    silent = mavlink.GPS_FIX_TYPE_NO_GPS if sample is None else FixType.NONE
    speed_m_s = fix.speed_over_ground_m_s if fix else None
    altitude_m = fix.altitude_m if fix else None
    return mavlink.MAVLink_gps_raw_int_message(
        boot_us(sample.t_s if sample else context.snapshot.t_s),
        int(fix.fix if fix else silent),
        scaled_degrees(fix.latitude_rad if fix else None),
        scaled_degrees(fix.longitude_rad if fix else None),
        whole(None if altitude_m is None else altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        whole(None if fix is None or fix.hdop is None else fix.hdop * 100.0, 0, _DOP_MAX, UINT16_MAX),
        UINT16_MAX,
        whole(None if speed_m_s is None else speed_m_s * 100.0, 0, _DOP_MAX, UINT16_MAX),
        heading_centidegrees(fix.course_over_ground_rad if fix else None),
        whole(sample.satellites if sample else None, 0, UINT8_MAX - 1, UINT8_MAX),
    )


def global_position_int(context: TelemetryContext) -> Message | None:
    """Return GLOBAL_POSITION_INT while the position is fresh or dead-reckoned; GPS_RAW_INT shows which."""
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
        whole(altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        whole(above_home_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        whole(100.0 * speed_m_s * _cosine(course_rad), -INT16_MAX, INT16_MAX, 0),
        whole(100.0 * speed_m_s * _cosine(course_rad - math.pi / 2.0), -INT16_MAX, INT16_MAX, 0),
        0,
        heading_centidegrees(boat.heading_rad if boat.heading_ok else None),
    )


def _cosine(angle_rad: float) -> float:
    return math.cos(angle_rad) if math.isfinite(angle_rad) else 0.0


def nav_controller_output(context: TelemetryContext) -> Message | None:
    """Return NAV_CONTROLLER_OUTPUT while there is a heading goal: with a position goal its bearing and distance too.

    `xtrack_error` is positive to starboard of the line.
    """
    boat = context.snapshot
    if boat.goal_heading_rad is None:
        return None
    bearing_rad = boat.goal_heading_rad if boat.bearing_rad is None else boat.bearing_rad
    return mavlink.MAVLink_nav_controller_output_message(
        0.0,
        0.0,
        _whole_degrees(boat.goal_heading_rad),
        _whole_degrees(bearing_rad),
        whole(boat.distance_m, 0, UINT16_MAX, 0),
        0.0,
        0.0,
        single(boat.navigation.cross_track_m),
    )


def attitude_target(context: TelemetryContext) -> Message | None:
    """Return ATTITUDE_TARGET while there is a heading goal."""
    goal_rad = context.snapshot.goal_heading_rad
    if goal_rad is None or not math.isfinite(goal_rad):
        return None
    half_rad = wrap_pi(goal_rad) / 2.0
    quaternion = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
    stamp_ms = boot_ms(context.snapshot.t_s)
    return mavlink.MAVLink_attitude_target_message(stamp_ms, _UNUSED_ATTITUDE, quaternion, 0.0, 0.0, 0.0, 0.0)


def servo_output_raw(context: TelemetryContext) -> Message:
    """Return SERVO_OUTPUT_RAW with the command on servo 1, 1500 us +-500 at the rudder limit.

    It is an output by name, so it shows the command; the measured angle is the
    NAMED_VALUE_FLOAT `RUDDER`.
    """
    deflection = context.snapshot.rudder_command_rad / max(context.rudder_limit_rad, 1e-3)
    pulse_us = whole(1500.0 + 500.0 * deflection, 1000, 2000, 0)
    stamp_us = boot_us(context.snapshot.t_s) & UINT32_MAX
    return mavlink.MAVLink_servo_output_raw_message(stamp_us, 0, pulse_us, 0, 0, 0, 0, 0, 0, 0)


def home_position(context: TelemetryContext) -> Message | None:
    """Return HOME_POSITION once there was a fix."""
    home = context.snapshot.home
    if home is None:
        return None
    return mavlink.MAVLink_home_position_message(
        scaled_degrees(home.latitude_rad),
        scaled_degrees(home.longitude_rad),
        whole(home.altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
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
    """Return ATTITUDE_QUATERNION while the heading is fresh; the angles of ATTITUDE as a rotation."""
    boat = context.snapshot
    if boat.heading_rad is None or not boat.heading_ok or not math.isfinite(boat.heading_rad):
        return None
    w, x, y, z = quaternion(single(boat.roll_rad), single(boat.pitch_rad), boat.heading_rad)
    yaw_rate_rad_s = single(boat.yaw_rate_rad_s)
    return mavlink.MAVLink_attitude_quaternion_message(
        boot_ms(boat.t_s), w, x, y, z, 0.0, 0.0, yaw_rate_rad_s, _NO_ROTATION
    )


def quaternion(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation (w, x, y, z) that turns by yaw, then pitch, then roll."""
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
    """Return LOCAL_POSITION_NED, relative to home, while the position is fresh or dead-reckoned."""
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
        single(north_m),
        single(east_m),
        single(-above_m),
        single(north_m_s),
        single(east_m_s),
        0.0,
    )


def gps_global_origin(context: TelemetryContext) -> Message | None:
    """Return GPS_GLOBAL_ORIGIN: home, where local coordinates begin."""
    home = context.snapshot.home
    if home is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(
        scaled_degrees(home.latitude_rad),
        scaled_degrees(home.longitude_rad),
        whole(home.altitude_m * 1e3, -INT32_MAX, INT32_MAX, 0),
        boot_us(context.snapshot.t_s),
    )


def position_target(context: TelemetryContext) -> Message | None:
    """Return POSITION_TARGET_GLOBAL_INT while there is a position goal or a loiter point."""
    boat = context.snapshot
    latitude_rad, longitude_rad = boat.navigation.target_latitude_rad, boat.navigation.target_longitude_rad
    if latitude_rad is None or longitude_rad is None or not math.isfinite(latitude_rad + longitude_rad):
        return None
    zeros = (0.0,) * 9  # altitude, velocity, acceleration, yaw, yaw rate: masked out
    return mavlink.MAVLink_position_target_global_int_message(
        boot_ms(boat.t_s),
        mavlink.MAV_FRAME_GLOBAL,
        _PLACE_ONLY,
        scaled_degrees(latitude_rad),
        scaled_degrees(longitude_rad),
        *zeros,
    )


def estimator_status(context: TelemetryContext) -> Message:
    """Return ESTIMATOR_STATUS: validity of heading, velocity and position; NaN for values that are not estimated.

    A dead-reckoned position is relative, with its accuracy. `mag_ratio` is the innovation of the last heading divided
    by five of its standard deviations: 1 and more is an outlier.
    """
    boat = context.snapshot
    return mavlink.MAVLink_estimator_status_message(
        boot_us(boat.t_s),
        _flags(context),
        vel_ratio=_UNKNOWN,
        pos_horiz_ratio=_UNKNOWN,
        pos_vert_ratio=_UNKNOWN,
        mag_ratio=_heading_ratio(boat.estimate),
        hagl_ratio=_UNKNOWN,
        tas_ratio=_UNKNOWN,
        pos_horiz_accuracy=_UNKNOWN if boat.dead_reckoning is None else single(boat.dead_reckoning.sd_m, _UNKNOWN),
        pos_vert_accuracy=_UNKNOWN,
    )


def _flags(context: TelemetryContext) -> int:
    boat, fix = context.snapshot, fresh_fix(context)
    moving = fix is not None and fix.speed_over_ground_m_s is not None and fix.course_over_ground_rad is not None
    flags = (_ATTITUDE if boat.heading_ok else 0) | (0 if fix is None else _PLACE) | (_VELOCITY if moving else 0)
    return flags | (0 if boat.dead_reckoning is None else _DEAD_RECKONING)


def ekf_status_report(context: TelemetryContext) -> Message:
    """Return EKF_STATUS_REPORT, which stations expect of ArduPilot: DroneKit waits for it before it arms.

    Its flags are those of ESTIMATOR_STATUS. Vertical flags follow the fix, since the boat floats. A ratio that is not
    estimated is 0, since stations compare the highest one with 1.
    """
    flags, ratio = _flags(context), _heading_ratio(context.snapshot.estimate)
    if fresh_fix(context) is not None:
        flags |= _VERTICAL
    compass = ratio if math.isfinite(ratio) else 0.0
    return mavlink.mavlink_map[193](flags, 0.0, 0.0, 0.0, compass, 0.0, 0.0)


def _heading_ratio(learned: Estimate | None) -> float:
    if learned is None or not learned.innovation_sd_rad > 0.0:
        return _UNKNOWN
    return single(abs(learned.innovation_rad) / (_OUTLIER_SDS * learned.innovation_sd_rad), _UNKNOWN)
