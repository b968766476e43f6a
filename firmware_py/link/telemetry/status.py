"""Telemetry of the state of autopilot, devices, mission and compass swing; HIGH_LATENCY2 summarises all of it."""

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
    whole,
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
# Healthy while not breached, also without a fence: MAVProxy reports "fence breach" if this bit is not set.
_FENCE = mavlink.MAV_SYS_STATUS_GEOFENCE
_MISSING_CELL = UINT16_MAX
_RUDDER_FAULTS = 1 << Fault.RUDDER_SILENT | 1 << Fault.RUDDER_ERROR

_CURRENT = mavlink.mavlink_map[42]
_IN_MISSION_MODE, _SUSPENDED = 1, 2

_COMPASS_ID, _MASK = 0, 1
_MASK_BYTES = 10
_ATTEMPT = 1
_NO_DIRECTION = (0.0, 0.0, 0.0)

_COMPASS_FAILURE = mavlink.HL_FAILURE_FLAG_3D_MAG | mavlink.HL_FAILURE_FLAG_ESTIMATOR
_FAILURES = (
    (Fault.COMPASS_LOST, _COMPASS_FAILURE),
    (Fault.POSITION_LOST, mavlink.HL_FAILURE_FLAG_GPS),
    # There is no flag for a rudder; that of the engine is the closest.
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
_ARMED_BIT, _HEADING_OK_BIT = 1, 2  # in custom2


def sys_status(context: TelemetryContext) -> Message:
    """Return SYS_STATUS.

    Ground stations look for gyro, accelerometer and magnetometer; here all three are
    the compass. errors_count1 counts skipped ticks.
    """
    boat = context.snapshot
    fence = _FENCE if boat.mission.identities[1] else 0
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
    breached = boat.faults >> Fault.FENCE_BREACHED & 1
    healthy = (0 if breached else _FENCE) | present & sum(bits for bits, good in states if good)
    enabled = fence if boat.navigation.fence_enabled else 0
    errors = whole(context.refused_frames, 0, UINT16_MAX, 0)
    skipped = whole(boat.skipped_total, 0, UINT16_MAX, 0)
    millivolts, centiamperes, percent = _supply(context)
    load = whole(context.load * 1e3, 0, 1000, 0)
    return mavlink.MAVLink_sys_status_message(
        present | fence,
        present | enabled,
        healthy,
        load,
        millivolts,
        centiamperes,
        percent,
        0,
        errors,
        skipped,
        0,
        0,
        0,
    )


def _supply(context: TelemetryContext) -> tuple[int, int, int]:
    """Return voltage (mV), current (cA, out of the battery) and charge (%) of the battery.

    Without a measurement at the battery, voltage and current are those at the rudder servo.
    """
    power, servo = context.snapshot.power, context.snapshot.servo
    voltage_v, current_a, charge = None, None, None
    if power is not None and power.voltage_v is not None:
        voltage_v, charge = power.voltage_v, power.charge
        current_a = None if power.current_a is None else -power.current_a
    elif servo is not None:
        voltage_v = servo.voltage_v
        current_a = None if servo.current_a is None else abs(servo.current_a)
    centiamperes = whole(None if current_a is None else current_a * 100.0, -INT16_MAX, INT16_MAX, UINT16_MAX)
    return (
        whole(None if voltage_v is None else voltage_v * 1e3, 0, UINT16_MAX - 1, UINT16_MAX),
        # -1 means unknown; a current of 0.01 A is rounded to 0.
        {UINT16_MAX: -1, -1: 0}.get(centiamperes, centiamperes),
        whole(None if charge is None else charge * 100.0, 0, 100, -1),
    )


def battery_status(context: TelemetryContext) -> Message | None:
    """Return BATTERY_STATUS while a battery is measured; the voltage at the servo is in SYS_STATUS only.

    The consumed energy is that of the loads since start; if that is not measured, the discharged energy.
    """
    power = context.snapshot.power
    if power is None or power.voltage_v is None:
        return None
    millivolts, centiamperes, percent = _supply(context)
    temperature_c = power.temperature_c
    flow = power.load if power.load.measured_s else power.discharged
    consumed_j = flow.energy_j if flow.measured_s else None
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_UNKNOWN,
        whole(None if temperature_c is None else temperature_c * 100.0, -INT16_MAX, INT16_MAX - 1, INT16_MAX),
        (millivolts, *(_MISSING_CELL,) * 9),
        centiamperes,
        -1,
        whole(None if consumed_j is None else consumed_j / 100.0, 0, INT32_MAX, -1),
        percent,
    )


def system_time(context: TelemetryContext) -> Message:
    """Return SYSTEM_TIME; the UTC is 0, unknown, if the clock is implausible."""
    unix_us = whole(context.utc_s * 1e6, 0, 1 << 62, 0) if context.utc_s <= LAST_UTC_S else 0
    return mavlink.MAVLink_system_time_message(unix_us, boot_ms(context.snapshot.t_s))


def extended_sys_state(context: TelemetryContext) -> Message:  # noqa: ARG001 - a builder like the others
    """Return EXTENDED_SYS_STATE: a boat neither flies nor stands on the ground."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, mavlink.MAV_LANDED_STATE_UNDEFINED
    )


def fence_status(context: TelemetryContext) -> Message | None:
    """Return FENCE_STATUS while there is a fence, and after a breach also without one, to clear it."""
    boat, (count, since_s) = context.snapshot, context.fence_breaches
    if not (boat.mission.identities[1] or count):
        return None
    breached = bool(boat.faults >> Fault.FENCE_BREACHED & 1)
    kind = mavlink.FENCE_BREACH_BOUNDARY if breached else mavlink.FENCE_BREACH_NONE
    return mavlink.MAVLink_fence_status_message(
        int(breached), whole(count, 0, UINT16_MAX, 0), kind, boot_ms(since_s) if count else 0
    )


def rc_channels(context: TelemetryContext) -> Message | None:
    """Return RC_CHANNELS while a station overrides channel 1, the only one in use."""
    if context.override_us is None:
        return None
    others = (UINT16_MAX,) * 17
    return mavlink.MAVLink_rc_channels_message(
        boot_ms(context.snapshot.t_s), 1, context.override_us, *others, UINT8_MAX
    )


def mission_current(context: TelemetryContext) -> Message:
    """Return MISSION_CURRENT: item, total without home, state, and the opaque ids of the three plans."""
    boat = context.snapshot
    report = boat.mission
    sequence = 0 if report.index is None else report.index + first_item_number(context.autopilot, PlanKind.MISSION)
    mode = _IN_MISSION_MODE if boat.mode is Mode.AUTO else _SUSPENDED
    total = whole(report.count or None, 0, UINT16_MAX - 1, UINT16_MAX)
    return _CURRENT(whole(sequence, 0, UINT16_MAX, 0), total, int(report.state), mode, *report.identities)


def mag_cal_progress(context: TelemetryContext) -> Message | None:
    """Return MAG_CAL_PROGRESS; bit n of completion_mask is the nth twelfth of the circle."""
    swing = context.swing
    if swing.state is not CalibrationState.RUNNING:
        return None
    mask = swing.sectors.to_bytes(_MASK_BYTES, "little")
    status = mavlink.MAG_CAL_RUNNING_STEP_ONE
    return mavlink.mavlink_map[191](_COMPASS_ID, _MASK, status, _ATTEMPT, swing.percent, mask, *_NO_DIRECTION)


def mag_cal_report(context: TelemetryContext) -> Message | None:
    """Return MAG_CAL_REPORT of a proposal that is not accepted yet."""
    swing = context.swing
    return None if swing.state is not CalibrationState.DONE else report_of(swing, saved=False)


def report_of(swing: SwingReport, *, saved: bool) -> Message:
    """Return MAG_CAL_REPORT: its fitness is the residual in degrees; a swing has no field offsets."""
    fitness = degrees(swing.residual_after_rad or swing.sd_rad or 0.0)
    nothing = (0.0,) * 9
    return mavlink.MAVLink_mag_cal_report_message(
        _COMPASS_ID, _MASK, mavlink.MAG_CAL_SUCCESS, int(saved), fitness, *nothing
    )


def high_latency2(context: TelemetryContext) -> Message:
    """Return HIGH_LATENCY2; an unknown value is 0, since the message has no number for it.

    With the failure flag of GPS the position is dead-reckoned.

    custom0 is the measured rudder angle in degrees, -128 without one; custom1 the voltage of
    the battery in fifths of a volt, at the servo if the battery is not measured, -1 without one; custom2
    says by bits whether the boat is armed (1) and has a valid heading (2).
    """
    boat, fix, place = context.snapshot, fresh_fix(context), best_position(context)
    failures = 0
    for fault, flags in _FAILURES:
        failures |= flags if boat.faults >> fault & 1 else 0
    voltage_v, charge = boat.servo.voltage_v if boat.servo else None, None
    if boat.power is not None and boat.power.voltage_v is not None:
        voltage_v, charge = boat.power.voltage_v, boat.power.charge
    rudder_deg = None if boat.rudder_rad is None else math.degrees(boat.rudder_rad)
    return mavlink.MAVLink_high_latency2_message(
        timestamp=boot_ms(boat.t_s),
        type=mavlink.MAV_TYPE_SURFACE_BOAT,
        autopilot=context.autopilot,
        custom_mode=whole(float(boat.mode), 0, UINT16_MAX, 0),
        latitude=scaled_degrees(place.latitude_rad if place else None),
        longitude=scaled_degrees(place.longitude_rad if place else None),
        altitude=whole(fix.altitude_m if fix else None, -INT16_MAX, INT16_MAX, 0),
        target_altitude=0,
        heading=_half_degrees(boat.heading_rad if boat.heading_ok else None),
        target_heading=_half_degrees(boat.goal_heading_rad),
        target_distance=whole(None if boat.distance_m is None else boat.distance_m / 10.0, 0, UINT16_MAX, 0),
        throttle=0,
        airspeed=_fifths(boat.water.speed_m_s if boat.water else None),
        airspeed_sp=0,
        groundspeed=_fifths(fix.speed_over_ground_m_s if fix else None),
        windspeed=0,
        wind_heading=0,
        eph=UINT8_MAX,
        epv=UINT8_MAX,
        temperature_air=0,
        climb_rate=0,
        battery=whole(None if charge is None else charge * 100.0, 0, 100, _NO_BATTERY),
        wp_num=whole(_item_number(context), 0, UINT16_MAX, 0),
        failure_flags=failures,
        custom0=whole(rudder_deg, -INT8_MAX, INT8_MAX, -INT8_MAX - 1),
        custom1=whole(None if voltage_v is None else voltage_v * 5.0, 0, INT8_MAX, -1),
        custom2=(_ARMED_BIT if boat.armed else 0) | (_HEADING_OK_BIT if boat.heading_ok else 0),
    )


def _item_number(context: TelemetryContext) -> float | None:
    """Return the current item as ground stations number it."""
    index = context.snapshot.mission.index
    return None if index is None else index + first_item_number(context.autopilot, PlanKind.MISSION)


def _half_degrees(angle_rad: float | None) -> int:
    if angle_rad is None or not math.isfinite(angle_rad):
        return 0
    return round(compass_degrees(angle_rad) / 2.0) % 180


def _fifths(speed_m_s: float | None) -> int:
    return whole(None if speed_m_s is None else speed_m_s * 5.0, 0, UINT8_MAX, 0)
