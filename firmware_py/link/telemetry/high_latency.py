"""HIGH_LATENCY2: all of the boat in 42 bytes, for links that are paid by the byte."""

from __future__ import annotations

import math

from firmware_py.common.angles import compass_degrees
from firmware_py.common.plan import PlanKind, homes
from firmware_py.faults.table import Fault
from firmware_py.link.telemetry.context_fields import (
    INT8_MAX,
    INT16_MAX,
    UINT8_MAX,
    UINT16_MAX,
    TelemetryContext,
    boot_ms,
    fresh_fix,
    scaled_degrees,
    shown_place,
    whole,
)
from firmware_py.link.wire.dialect import Message, mavlink

_COMPASS = mavlink.HL_FAILURE_FLAG_3D_MAG | mavlink.HL_FAILURE_FLAG_ESTIMATOR
_FAILURES = (
    (Fault.COMPASS_LOST, _COMPASS),
    (Fault.POSITION_LOST, mavlink.HL_FAILURE_FLAG_GPS),
    # There is no flag for a rudder; the engine's is the nearest thing that moves the boat.
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
_ARMED, _HEADING_OK = 1, 2  # in custom2


def high_latency2(context: TelemetryContext) -> Message:
    """Return HIGH_LATENCY2; what is not known is 0, as the message has no number for it.

    With the failure flag of GPS the place is reckoned.

    custom0 is the measured rudder angle in degrees, -128 without one; custom1 the voltage of
    the battery in fifths of a volt, at the servo where nobody measures it, -1 without one; custom2
    says by bits whether the boat is armed (1) and has a valid heading (2).
    """
    boat, fix, place = context.snapshot, fresh_fix(context), shown_place(context)
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
        wp_num=whole(_item(context), 0, UINT16_MAX, 0),
        failure_flags=failures,
        custom0=whole(rudder_deg, -INT8_MAX, INT8_MAX, -INT8_MAX - 1),
        custom1=whole(None if voltage_v is None else voltage_v * 5.0, 0, INT8_MAX, -1),
        custom2=(_ARMED if boat.armed else 0) | (_HEADING_OK if boat.heading_ok else 0),
    )


def _item(context: TelemetryContext) -> float | None:
    """Return the current item as ground stations number it."""
    index = context.snapshot.mission.index
    return None if index is None else index + homes(context.autopilot, PlanKind.MISSION)


def _half_degrees(angle_rad: float | None) -> int:
    if angle_rad is None or not math.isfinite(angle_rad):
        return 0
    return round(compass_degrees(angle_rad) / 2.0) % 180


def _fifths(speed_m_s: float | None) -> int:
    return whole(None if speed_m_s is None else speed_m_s * 5.0, 0, UINT8_MAX, 0)
