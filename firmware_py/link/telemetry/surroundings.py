"""Telemetry of wind and water depth."""

from __future__ import annotations

import math

from firmware_py.link.telemetry.fields import (
    TelemetryContext,
    best_position,
    boot_ms,
    boot_us,
    scaled_degrees,
    to_float32,
)
from firmware_py.link.wire.dialect import Message, mavlink

_UNKNOWN = math.nan
_SENSOR = 0  # number of the echo sounder


def wind_cov(context: TelemetryContext) -> Message | None:
    """Build WIND_COV: mean velocity of the air over 10 s, and variability of the speed; None without a recent wind."""
    boat = context.snapshot
    wind = boat.wind
    if wind is None or not boat.wind_ok or wind.north_m_s is None or wind.east_m_s is None:
        return None
    return mavlink.MAVLink_wind_cov_message(
        boot_us(wind.t_s),
        to_float32(wind.north_m_s),
        to_float32(wind.east_m_s),
        _UNKNOWN,
        to_float32(wind.sd_m_s, _UNKNOWN),
        _UNKNOWN,
        _UNKNOWN,
        _UNKNOWN,
        _UNKNOWN,
    )


def water_depth(context: TelemetryContext) -> Message | None:
    """Build WATER_DEPTH with the depth below the transducer, not healthy if it is old; None before the first depth."""
    boat = context.snapshot
    depth = boat.depth
    if depth is None:
        return None
    position = best_position(context)
    return mavlink.mavlink_map[11038](
        boot_ms(depth.t_s),
        _SENSOR,
        int(boat.depth_ok),
        scaled_degrees(position.latitude_rad if position else None),
        scaled_degrees(position.longitude_rad if position else None),
        0.0,
        to_float32(boat.roll_rad),
        to_float32(boat.pitch_rad),
        to_float32(boat.heading_rad if boat.heading_ok else None),
        to_float32(max(0.0, depth.depth_m - depth.transducer_m)),
        _UNKNOWN,
    )
