"""Telemetry of how the autopilot and its devices are. A builder returns None when there is nothing to say."""

from __future__ import annotations

from firmware_py.common.calendar import LAST_UTC_S
from firmware_py.faults.table import Fault
from firmware_py.link.telemetry.context_fields import (
    INT16_MAX,
    INT32_MAX,
    UINT8_MAX,
    UINT16_MAX,
    TelemetryContext,
    boot_ms,
    whole,
)
from firmware_py.link.wire.dialect import Message, mavlink

_COMPASS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
)
_POSITION = mavlink.MAV_SYS_STATUS_SENSOR_GPS
_RUDDER = mavlink.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
_STORAGE = mavlink.MAV_SYS_STATUS_LOGGING
_BATTERY = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
# Healthy while not breached, also without a fence: MAVProxy cries "fence breach" when this bit is not.
_FENCE = mavlink.MAV_SYS_STATUS_GEOFENCE
_MISSING_CELL = UINT16_MAX
_RUDDER_FAULTS = 1 << Fault.RUDDER_SILENT | 1 << Fault.RUDDER_ERROR


def sys_status(context: TelemetryContext) -> Message:
    """Return SYS_STATUS.

    Ground stations look for gyro, accelerometer and magnetometer; here all three are
    the compass. errors_count1 counts skipped ticks.
    """
    boat = context.snapshot
    fence = _FENCE if boat.mission.identities[1] else 0
    present = _COMPASS | _RUDDER | _STORAGE | _PREARM | (0 if boat.position is None else _POSITION)
    present |= 0 if boat.power is None else _BATTERY
    states = (
        (_COMPASS, boat.heading_ok),
        (_POSITION, boat.position_ok),
        (_RUDDER, boat.rudder_ok and not boat.faults & _RUDDER_FAULTS),
        (_STORAGE, not boat.faults >> Fault.STORAGE_FAILING & 1),
        (_BATTERY, boat.power is not None and boat.power.voltage_v is not None),
        (_PREARM, boat.prearm_refusal == ""),
    )
    breached = boat.faults >> Fault.FENCE_BREACHED & 1
    healthy = (0 if breached else _FENCE) | present & sum(bits for bits, good in states if good)
    heeded = fence if boat.navigation.fence_enabled else 0
    errors = whole(context.refused_frames, 0, UINT16_MAX, 0)
    skipped = whole(boat.skipped_total, 0, UINT16_MAX, 0)
    millivolts, centiamperes, percent = _supply(context)
    load = whole(context.load * 1e3, 0, 1000, 0)
    return mavlink.MAVLink_sys_status_message(
        present | fence, present | heeded, healthy, load, millivolts, centiamperes, percent, 0, errors, skipped, 0, 0, 0
    )


def _supply(context: TelemetryContext) -> tuple[int, int, int]:
    """Return voltage (mV), current (cA, out of the battery) and charge (%) of the battery.

    Where nobody measures it, voltage and current are those at the rudder servo.
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
        # -1 is the number for unknown: so small a current is none.
        {UINT16_MAX: -1, -1: 0}.get(centiamperes, centiamperes),
        whole(None if charge is None else charge * 100.0, 0, 100, -1),
    )


def battery_status(context: TelemetryContext) -> Message | None:
    """Return BATTERY_STATUS while somebody measures a battery; the voltage at the servo alone is that of SYS_STATUS.

    What was consumed is what the loads have taken since start; where that is not measured, what left the battery.
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
    """Return SYSTEM_TIME; the calendar is 0, unknown, where the clock shows what it cannot reach."""
    unix_us = whole(context.utc_s * 1e6, 0, 1 << 62, 0) if context.utc_s <= LAST_UTC_S else 0
    return mavlink.MAVLink_system_time_message(unix_us, boot_ms(context.snapshot.t_s))


def extended_sys_state(context: TelemetryContext) -> Message:  # noqa: ARG001 - a builder like the others
    """Return EXTENDED_SYS_STATE: a boat neither flies nor stands on the ground."""
    return mavlink.MAVLink_extended_sys_state_message(
        mavlink.MAV_VTOL_STATE_UNDEFINED, mavlink.MAV_LANDED_STATE_UNDEFINED
    )


def fence_status(context: TelemetryContext) -> Message | None:
    """Return FENCE_STATUS while there is a fence, and after a breach when there is none any more: it is over."""
    boat, (count, since_s) = context.snapshot, context.fence_breaches
    if not (boat.mission.identities[1] or count):
        return None
    breached = bool(boat.faults >> Fault.FENCE_BREACHED & 1)
    kind = mavlink.FENCE_BREACH_BOUNDARY if breached else mavlink.FENCE_BREACH_NONE
    return mavlink.MAVLink_fence_status_message(
        int(breached), whole(count, 0, UINT16_MAX, 0), kind, boot_ms(since_s) if count else 0
    )


def rc_channels(context: TelemetryContext) -> Message | None:
    """Return RC_CHANNELS while a station overrides channel 1, the only one that does something."""
    if context.override_us is None:
        return None
    others = (UINT16_MAX,) * 17
    return mavlink.MAVLink_rc_channels_message(
        boot_ms(context.snapshot.t_s), 1, context.override_us, *others, UINT8_MAX
    )
