"""Telemetry of attitude and place as estimates, and of the goal; None when there is nothing to say."""

from __future__ import annotations

import math

from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.reports import Estimate
from firmware_py.link.telemetry.context_fields import (
    INT32_MAX,
    TelemetryContext,
    boot_ms,
    boot_us,
    fresh_fix,
    scaled_degrees,
    shown_place,
    single,
    whole,
)
from firmware_py.link.wire.dialect import Message, mavlink

_NO_ROTATION = (0.0, 0.0, 0.0, 0.0)  # repr_offset_q: "not set"
# POSITION_TARGET_TYPEMASK: of everything, only the place in the plane is meant.
_PLACE_ONLY = 0b0000_1101_1111_1100
_UNKNOWN = math.nan
_ODD_SDS = 5.0

_ATTITUDE = mavlink.ESTIMATOR_ATTITUDE
_VELOCITY = mavlink.ESTIMATOR_VELOCITY_HORIZ
_PLACE = (
    mavlink.ESTIMATOR_POS_HORIZ_REL
    | mavlink.ESTIMATOR_POS_HORIZ_ABS
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL
    | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
)

_VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
_DEAD_RECKONED = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_REL


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
    """Return LOCAL_POSITION_NED, counted from home, while the position is fresh or reckoned on."""
    fix, home = shown_place(context), context.snapshot.home
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
    """Return POSITION_TARGET_GLOBAL_INT while the boat goes to a place, or keeps near one."""
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
    """Return ESTIMATOR_STATUS: which of heading, velocity and place can be relied on; NaN for what is not estimated.

    A reckoned place is a relative one, with its accuracy.
    `mag_ratio` is the last heading's innovation by five of its standard deviations: 1 and more is odd.
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
        pos_horiz_accuracy=_UNKNOWN if boat.dead_reckoned is None else single(boat.dead_reckoned.sd_m, _UNKNOWN),
        pos_vert_accuracy=_UNKNOWN,
    )


def _flags(context: TelemetryContext) -> int:
    boat, fix = context.snapshot, fresh_fix(context)
    moving = fix is not None and fix.speed_over_ground_m_s is not None and fix.course_over_ground_rad is not None
    flags = (_ATTITUDE if boat.heading_ok else 0) | (0 if fix is None else _PLACE) | (_VELOCITY if moving else 0)
    return flags | (0 if boat.dead_reckoned is None else _DEAD_RECKONED)


def ekf_status_report(context: TelemetryContext) -> Message:
    """Return EKF_STATUS_REPORT, which ArduPilot's stations look for: DroneKit waits for it before it arms.

    Its flags are those of ESTIMATOR_STATUS. She floats: what is vertical is as sure as the fix. A ratio that nobody
    estimates is 0, since stations compare the highest with 1.
    """
    flags, ratio = _flags(context), _heading_ratio(context.snapshot.estimate)
    if fresh_fix(context) is not None:
        flags |= _VERTICAL
    compass = ratio if math.isfinite(ratio) else 0.0
    return mavlink.mavlink_map[193](flags, 0.0, 0.0, 0.0, compass, 0.0, 0.0)


def _heading_ratio(learned: Estimate | None) -> float:
    if learned is None or not learned.innovation_sd_rad > 0.0:
        return _UNKNOWN
    return single(abs(learned.innovation_rad) / (_ODD_SDS * learned.innovation_sd_rad), _UNKNOWN)
