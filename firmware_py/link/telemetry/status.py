"""Telemetry of the state of autopilot, devices, mission and compass swing; HIGH_LATENCY2 is a summary."""

from __future__ import annotations

import math

from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.calendar import LAST_UTC_S
from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import PlanKind, first_item_number
from firmware_py.common.records import CalibrationState
from firmware_py.common.reports import SwingReport
from firmware_py.faults.table import Fault
from firmware_py.link.telemetry.fields import (
    INT8_MAX,
    INT16_MAX,
    INT32_MAX,
    UINT8_MAX,
    UINT16_MAX,
    TelemetryContext,
    best_position,
    boot_ms,
    fresh_fix,
    scaled_degrees,
    to_integer,
)
from firmware_py.link.wire.dialect import Message, mavlink

_COMPASS_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
)
_POSITION = mavlink.MAV_SYS_STATUS_SENSOR_GPS
_RUDDER = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
_STORAGE = mavlink.MAV_SYS_STATUS_LOGGING
_BATTERY = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
# Healthy without a breach, even without a fence: MAVProxy reports "fence breach" if the bit is not set.
_FENCE = mavlink.MAV_SYS_STATUS_GEOFENCE
_MISSING_CELL = UINT16_MAX
_RUDDER_FAULTS = 1 << Fault.RUDDER_SILENT | 1 << Fault.RUDDER_ERROR

_MissionCurrent = mavlink.mavlink_map[42]
_MISSION_MODE_ACTIVE, _MISSION_MODE_SUSPENDED = 1, 2

_COMPASS_ID, _CAL_MASK = 0, 1
_COMPLETION_MASK_BYTES = 10
_ATTEMPT = 1
_NO_DIRECTION = (0.0, 0.0, 0.0)  # of the body

_COMPASS_FAILURE = mavlink.HL_FAILURE_FLAG_3D_MAG | mavlink.HL_FAILURE_FLAG_ESTIMATOR
_FAILURES = (
    (Fault.COMPASS_LOST, _COMPASS_FAILURE),
    (Fault.POSITION_LOST, mavlink.HL_FAILURE_FLAG_GPS),
    # HIGH_LATENCY2 has no flag for a rudder; the flag of the engine is used instead.
    (Fault.RUDDER_SILENT, mavlink.HL_FAILURE_FLAG_ENGINE),
    (Fault.RUDDER_ERROR, mavlink.HL_FAILURE_FLAG_ENGINE),
    (Fault.RUDDER_ASTRAY, mavlink.HL_FAILURE_FLAG_ENGINE),
    (Fault.RUDDER_JAMMED, mavlink.HL_FAILURE_FLAG_ENGINE),
    (Fault.STEERING_LOST, mavlink.HL_FAILURE_FLAG_ENGINE),
    (Fault.SUPPLY_LOW, mavlink.HL_FAILURE_FLAG_BATTERY),
    (Fault.BATTERY_LOW, mavlink.HL_FAILURE_FLAG_BATTERY),
    (Fault.BATTERY_CRITICAL, mavlink.HL_FAILURE_FLAG_BATTERY),
    (Fault.FENCE_BREACHED, mavlink.HL_FAILURE_FLAG_GEOFENCE),
    (Fault.MISSION_UNUSABLE, mavlink.HL_FAILURE_FLAG_MISSION),
)
_NO_BATTERY = -1
_ARMED_BIT, _HEADING_OK_BIT, _RUDDER_ESTIMATED_BIT = 1, 2, 4  # of custom2 in HIGH_LATENCY2


def sys_status(context: TelemetryContext) -> Message:
    """Build SYS_STATUS.

    The flags of gyro, accelerometer and magnetometer, which ground stations expect, all stand for the compass.
    errors_count1 counts skipped ticks.
    """
    boat = context.snapshot
    fence = _FENCE if boat.mission.identities[PlanKind.FENCE] else 0
    present = _COMPASS_SENSORS | _RUDDER | _STORAGE | _PREARM | (0 if boat.position is None else _POSITION)
    present |= 0 if boat.power is None else _BATTERY
    states = (
        (_COMPASS_SENSORS, boat.heading_ok),
        (_POSITION, boat.position_ok),
        (_RUDDER, boat.rudder_ok and not boat.faults & _RUDDER_FAULTS),
        (_STORAGE, not boat.faults >> Fault.STORAGE_FAILING & 1),
        (_BATTERY, boat.power is not None and boat.power.voltage_v is not None),
        (_PREARM, boat.prearm_refusal == ""),
    )
    is_breached = boat.faults >> Fault.FENCE_BREACHED & 1
    healthy = (0 if is_breached else _FENCE) | present & sum(bits for bits, is_good in states if is_good)
    enabled_fence = fence if boat.navigation.fence_enabled else 0
    refused_frames = to_integer(context.refused_frames, 0, UINT16_MAX, 0)
    skipped_ticks = to_integer(boat.skipped_total, 0, UINT16_MAX, 0)
    load = to_integer(context.load * 1e3, 0, 1000, 0)
    return mavlink.MAVLink_sys_status_message(
        present | fence,
        present | enabled_fence,
        healthy,
        load,
        *_battery_values(context),
        0,
        refused_frames,
        skipped_ticks,
        0,
        0,
        0,
    )


def _battery_values(context: TelemetryContext) -> tuple[int, int, int]:
    """Return voltage (mV), discharge current (cA) and charge (%) of the battery.

    If the battery is not measured, voltage and current are those of the rudder servo.
    """
    power, servo = context.snapshot.power, context.snapshot.servo
    voltage_v, current_a, charge = None, None, None
    if power is not None and power.voltage_v is not None:
        voltage_v, charge = power.voltage_v, power.charge
        current_a = None if power.current_a is None else -power.current_a
    elif servo is not None:
        voltage_v = servo.voltage_v
        current_a = None if servo.current_a is None else abs(servo.current_a)
    centiamperes = to_integer(None if current_a is None else current_a * 100.0, -INT16_MAX, INT16_MAX, UINT16_MAX)
    return (
        to_integer(None if voltage_v is None else voltage_v * 1e3, 0, UINT16_MAX - 1, UINT16_MAX),
        # -1 means unknown, so a current of -0.01 A becomes 0.
        {UINT16_MAX: -1, -1: 0}.get(centiamperes, centiamperes),
        to_integer(None if charge is None else charge * 100.0, 0, 100, -1),
    )


def battery_status(context: TelemetryContext) -> Message | None:
    """Build BATTERY_STATUS; None if the battery is not measured.

    The consumed energy is that of the loads since start; if the loads are not measured, the discharged energy.
    """
    power = context.snapshot.power
    if power is None or power.voltage_v is None:
        return None
    millivolts, centiamperes, percent = _battery_values(context)
    temperature_c = power.temperature_c
    flow = power.load if power.load.measured_s else power.discharged
    consumed_j = flow.energy_j if flow.measured_s else None
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_UNKNOWN,
        to_integer(None if temperature_c is None else temperature_c * 100.0, -INT16_MAX, INT16_MAX - 1, INT16_MAX),
        (millivolts, *(_MISSING_CELL,) * 9),
        centiamperes,
        -1,
        to_integer(None if consumed_j is None else consumed_j / 100.0, 0, INT32_MAX, -1),
        percent,
    )


def system_time(context: TelemetryContext) -> Message:
    """Build SYSTEM_TIME; the UTC is 0 (unknown) if the clock is implausible."""
    unix_us = to_integer(context.utc_s * 1e6, 0, 1 << 62, 0) if context.utc_s <= LAST_UTC_S else 0
    return mavlink.MAVLink_system_time_message(unix_us, boot_ms(context.snapshot.t_s))


def extended_sys_state(_context: TelemetryContext) -> Message:
    """Build EXTENDED_SYS_STATE with undefined states, since a boat neither flies nor lands."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, mavlink.MAV_LANDED_STATE_UNDEFINED
    )


def fence_status(context: TelemetryContext) -> Message | None:
    """Build FENCE_STATUS; None without a fence, unless there was a breach since start."""
    boat, (count, latest_s) = context.snapshot, context.fence_breaches
    if not (boat.mission.identities[PlanKind.FENCE] or count):
        return None
    is_breached = bool(boat.faults >> Fault.FENCE_BREACHED & 1)
    breach_type = mavlink.FENCE_BREACH_BOUNDARY if is_breached else mavlink.FENCE_BREACH_NONE
    return mavlink.MAVLink_fence_status_message(
        int(is_breached), to_integer(count, 0, UINT16_MAX, 0), breach_type, boot_ms(latest_s) if count else 0
    )


def rc_channels(context: TelemetryContext) -> Message | None:
    """Build RC_CHANNELS; None unless a station overrides channel 1, the only channel in use."""
    if context.override_us is None:
        return None
    unused_channels = (UINT16_MAX,) * 17
    return mavlink.MAVLink_rc_channels_message(
        boot_ms(context.snapshot.t_s), 1, context.override_us, *unused_channels, UINT8_MAX
    )


def mission_current(context: TelemetryContext) -> Message:
    """Build MISSION_CURRENT: item number, number of items without home, state, and opaque ids of the three plans."""
    boat = context.snapshot
    mode = _MISSION_MODE_ACTIVE if boat.mode is Mode.AUTO else _MISSION_MODE_SUSPENDED
    total = to_integer(boat.mission.count or None, 0, UINT16_MAX - 1, UINT16_MAX)
    number = to_integer(_item_number(context) or 0, 0, UINT16_MAX, 0)
    return _MissionCurrent(number, total, int(boat.mission.state), mode, *boat.mission.identities)


def mag_cal_progress(context: TelemetryContext) -> Message | None:
    """Build MAG_CAL_PROGRESS during a swing; bit n of completion_mask is the nth twelfth of the circle."""
    swing = context.swing
    if swing.state is not CalibrationState.RUNNING:
        return None
    sectors = swing.sectors.to_bytes(_COMPLETION_MASK_BYTES, "little")
    status = mavlink.MAG_CAL_RUNNING_STEP_ONE
    return mavlink.mavlink_map[191](_COMPASS_ID, _CAL_MASK, status, _ATTEMPT, swing.percent, sectors, *_NO_DIRECTION)


def mag_cal_report(context: TelemetryContext) -> Message | None:
    """Build MAG_CAL_REPORT of a swing result that is not accepted yet; None without one."""
    swing = context.swing
    return None if swing.state is not CalibrationState.DONE else swing_report_message(swing, is_saved=False)


def swing_report_message(swing: SwingReport, *, is_saved: bool) -> Message:
    """Build MAG_CAL_REPORT without field offsets; its fitness is the residual or standard deviation in degrees."""
    fitness = degrees(swing.residual_after_rad or swing.sd_rad or 0.0)
    no_offsets = (0.0,) * 9
    return mavlink.MAVLink_mag_cal_report_message(
        _COMPASS_ID, _CAL_MASK, mavlink.MAG_CAL_SUCCESS, int(is_saved), fitness, *no_offsets
    )


def high_latency2(context: TelemetryContext) -> Message:
    """Build HIGH_LATENCY2; an unknown value is 0 where the message defines no number for unknown.

    If the failure flag of GPS is set, the position is dead-reckoned.

    custom0 is the measured or estimated rudder angle in degrees, -128 if unknown. custom1 is the voltage of the battery
    in units of 0.2 V (of the servo if the battery is not measured), -1 if unknown. Bits of custom2: 1 armed, 2 valid
    heading, 4 rudder angle estimated, not measured.
    """
    boat, fix, position = context.snapshot, fresh_fix(context), best_position(context)
    failures = 0
    for fault, flags in _FAILURES:
        failures |= flags if boat.faults >> fault & 1 else 0
    voltage_v, charge = boat.servo.voltage_v if boat.servo else None, None
    wind = boat.wind if boat.wind_ok else None
    if boat.power is not None and boat.power.voltage_v is not None:
        voltage_v, charge = boat.power.voltage_v, boat.power.charge
    is_estimated = boat.rudder_estimate_rad is not None
    rudder_rad = boat.rudder_estimate_rad if is_estimated else boat.rudder_rad
    rudder_deg = None if rudder_rad is None else math.degrees(rudder_rad)
    return mavlink.MAVLink_high_latency2_message(
        timestamp=boot_ms(boat.t_s),
        type=mavlink.MAV_TYPE_SURFACE_BOAT,
        autopilot=context.autopilot,
        custom_mode=int(boat.mode),
        latitude=scaled_degrees(position.latitude_rad if position else None),
        longitude=scaled_degrees(position.longitude_rad if position else None),
        altitude=to_integer(fix.altitude_m if fix else None, -INT16_MAX, INT16_MAX, 0),
        target_altitude=0,
        heading=_two_degree_units(boat.heading_rad if boat.heading_ok else None),
        target_heading=_two_degree_units(boat.goal_heading_rad),
        target_distance=to_integer(None if boat.distance_m is None else boat.distance_m / 10.0, 0, UINT16_MAX, 0),
        throttle=0,
        airspeed=_fifths(boat.water.speed_m_s if boat.water else None),
        airspeed_sp=0,
        groundspeed=_fifths(fix.speed_over_ground_m_s if fix else None),
        windspeed=_fifths(wind.mean_m_s if wind else None),
        wind_heading=_two_degree_units(wind.mean_from_rad if wind else None),
        eph=UINT8_MAX,
        epv=UINT8_MAX,
        temperature_air=0,
        climb_rate=0,
        battery=to_integer(None if charge is None else charge * 100.0, 0, 100, _NO_BATTERY),
        wp_num=to_integer(_item_number(context), 0, UINT16_MAX, 0),
        failure_flags=failures,
        custom0=to_integer(rudder_deg, -INT8_MAX, INT8_MAX, -INT8_MAX - 1),
        custom1=to_integer(None if voltage_v is None else voltage_v * 5.0, 0, INT8_MAX, -1),
        custom2=(_ARMED_BIT if boat.armed else 0)
        | (_HEADING_OK_BIT if boat.heading_ok else 0)
        | (_RUDDER_ESTIMATED_BIT if is_estimated else 0),
    )


def _item_number(context: TelemetryContext) -> float | None:
    """Return the number of the current item on the link, which depends on the autopilot type."""
    index = context.snapshot.mission.index
    return None if index is None else index + first_item_number(context.autopilot, PlanKind.MISSION)


def _two_degree_units(angle_rad: float | None) -> int:
    """Convert a heading to units of 2 degrees; 0 if it is unknown."""
    if angle_rad is None or not math.isfinite(angle_rad):
        return 0
    return round(compass_degrees(angle_rad) / 2.0) % 180


def _fifths(speed_m_s: float | None) -> int:
    """Convert a speed to units of 0.2 m/s; 0 if it is unknown."""
    return to_integer(None if speed_m_s is None else speed_m_s * 5.0, 0, UINT8_MAX, 0)
