"""Converts readings of devices to values for JSON and operators: degrees; None if unknown or not finite."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    HeadingSample,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderFeedback,
    WindReference,
    WindSample,
)
from firmware_py.common.vessels import VesselIdentity, VesselPosition

Values = dict[str, Any]


def rounded(value: float | None, digits: int, convert: Callable[[float], float] = float) -> float | None:
    """Convert and round a value; return None if it is None or not finite."""
    return None if value is None or not math.isfinite(value) else round(convert(value), digits)


def heading_values(sample: HeadingSample) -> Values:
    """Return the values of a compass, or those of a gyroscope without north."""
    if sample.reference is NorthReference.RELATIVE:
        return {
            "yaw_rate_deg_s": rounded(sample.yaw_rate_rad_s, 2, degrees),
            "turned_deg": rounded(sample.heading_rad, 2, compass_degrees),
            "north": "none, gyro only",
        }
    return {
        f"heading_{sample.reference.name.lower()}_deg": rounded(sample.heading_rad, 2, compass_degrees),
        "roll_deg": rounded(sample.roll_rad, 1, degrees),
        "pitch_deg": rounded(sample.pitch_rad, 1, degrees),
        "temperature_c": sample.temperature_c,
    }


def position_values(sample: PositionSample) -> Values:
    """Return the values of a GNSS receiver."""
    return {
        "fix": sample.fix.name,
        "lat_deg": rounded(sample.latitude_rad, 7, degrees),
        "lon_deg": rounded(sample.longitude_rad, 7, degrees),
        "sog_m_s": rounded(sample.speed_over_ground_m_s, 2),
        "cog_deg": rounded(sample.course_over_ground_rad, 1, compass_degrees),
        "satellites": sample.satellites,
    }


def rudder_values(sample: RudderFeedback) -> Values:
    """Return the values of a servo."""
    return {
        "shaft_deg": rounded(sample.shaft_rad, 2, degrees),
        "temperature_c": sample.temperature_c,
        "voltage_v": rounded(sample.voltage_v, 2),
        "current_a": rounded(sample.current_a, 3),
        "hardware_error": sample.hardware_error,
    }


def rudder_angle_values(sample: RudderAngleSample) -> Values:
    """Return the values of a rudder angle sensor."""
    return {"rudder_deg": rounded(sample.rudder_rad, 2, degrees)}


def power_values(sample: PowerSample) -> Values:
    """Return the values of a battery monitor or charger; a current into the battery is positive."""
    return {
        "voltage_v": rounded(sample.voltage_v, 3),
        "current_a": rounded(sample.current_a, 3),
        "charge_percent": rounded(sample.charge, 1, lambda charge: 100.0 * charge),
        "solar_w": rounded(sample.solar_w, 0),
        "load_a": rounded(sample.load_a, 3),
        "temperature_c": sample.temperature_c,
    }


_WIND_ANGLES = {
    WindReference.NORTH: "wind_from_true_deg",
    WindReference.MAGNETIC: "wind_from_magnetic_deg",
    WindReference.APPARENT: "apparent_wind_angle_deg",
    WindReference.BOW: "true_wind_angle_deg",
    WindReference.BOW_WATER: "true_wind_angle_deg",
}


def wind_values(sample: WindSample) -> Values:
    """Return the values of a wind sensor; the name of the angle is that of its reference."""
    return {
        "wind_m_s": rounded(sample.wind_m_s, 2),
        _WIND_ANGLES[sample.reference]: rounded(sample.angle_rad, 1, compass_degrees),
    }


def depth_values(sample: DepthSample) -> Values:
    """Return the values of an echo sounder: depths below the surface, of the water and of the transducer."""
    return {"depth_m": rounded(sample.depth_m, 2), "transducer_m": rounded(sample.transducer_m, 2)}


def vessel_values(report: VesselPosition) -> Values:
    """Return the values of a position report of another vessel."""
    return {
        "mmsi": report.mmsi,
        "kind": report.kind.name.lower(),
        "lat_deg": rounded(report.latitude_rad, 6, degrees),
        "lon_deg": rounded(report.longitude_rad, 6, degrees),
        "sog_m_s": rounded(report.speed_m_s, 2),
        "cog_deg": rounded(report.course_rad, 1, compass_degrees),
        "heading_deg": rounded(report.heading_rad, 0, compass_degrees),
    }


def identity_values(report: VesselIdentity) -> Values:
    """Return the values of an identity report of another vessel."""
    return {"mmsi": report.mmsi, "name": report.name, "call_sign": report.call_sign, "ship_type": report.ship_type}


def device_values(
    name: str, driver: str, port: str, health: DeviceHealth | None, rate_hz: float | None, error: str = ""
) -> Values:
    """Return state, rate and errors of a device; `error` is the reason why it could not be opened, empty otherwise."""
    return {
        "device": name,
        "driver": driver,
        "port": port,
        "state": health.state.name.lower() if health else "absent",
        "rate_hz": rounded(rate_hz, 2),
        "accepted": health.accepted if health else 0,
        "rejected": health.rejected if health else 0,
        "error": error or (health.text if health else ""),
    }


def format_device(record: Values) -> str:
    """Format a dictionary from `device_values`, with further values of the device, as a line."""
    head = ("device", "driver", "port", "state", "rate_hz", "accepted", "rejected", "error")
    rate = "      -" if record["rate_hz"] is None else f"{record['rate_hz']:7.2f}"
    values = {name: value for name, value in record.items() if name not in head}
    text = (
        f"{record['device']:<10} {record['driver']:<9} {record['state']:<9}{rate} Hz  "
        f"{record['accepted']} good, {record['rejected']} bad  {format_values(values)}"
    ).rstrip()
    return f"{text}  [{record['error']}]" if record["error"] else text


def format_values(values: Values) -> str:
    """Format names and values as one line, with a dash for None."""
    return "  ".join(f"{name} {'-' if value is None else value}" for name, value in values.items())
