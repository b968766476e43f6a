"""Input of the telemetry builders, and conversion of values to MAVLink fields."""

from __future__ import annotations

import math

import msgspec

from firmware_py.common.angles import TWO_PI, degrees
from firmware_py.common.records import FixType, PositionSample
from firmware_py.common.reports import Snapshot, SwingReport

INT8_MAX = 0x7F
UINT8_MAX = 0xFF
UINT16_MAX = 0xFFFF
UINT32_MAX = 0xFFFFFFFF
INT16_MAX = 0x7FFF
INT32_MAX = 0x7FFFFFFF
_SINGLE_MAX = 3.4028234663852886e38


class TelemetryContext(msgspec.Struct, frozen=True):
    """Snapshot after a tick, and further values for telemetry."""

    snapshot: Snapshot
    utc_s: float
    rudder_limit_rad: float
    autopilot: int  # MAV_AUTOPILOT
    load: float  # of one processor core, 0 to 1
    refused_frames: int  # damaged or rejected frames on all links
    written: tuple[int, int] | None = None  # number and bytes of the stored versions of the state since start
    fence_breaches: tuple[int, float] = (0, 0.0)  # number since start, and time of the latest
    override_us: int | None = None  # pulse width with which a station overrides channel 1
    swing: SwingReport = msgspec.field(default_factory=SwingReport)  # of the compass
    intended_mode: int | None = None  # custom_mode of the latest accepted request


def fresh_fix(context: TelemetryContext) -> PositionSample | None:
    """Return the GNSS position; None if it is old or incomplete."""
    fix = context.snapshot.position
    is_usable = context.snapshot.position_ok and fix is not None and None not in (fix.latitude_rad, fix.longitude_rad)
    return fix if is_usable else None


def best_position(context: TelemetryContext) -> PositionSample | None:
    """Return the GNSS position, otherwise the dead-reckoned position with fix type NONE; None without both."""
    fix, boat = fresh_fix(context), context.snapshot
    if fix is not None or boat.dead_reckoning is None:
        return fix
    return PositionSample(
        boat.t_s,
        FixType.NONE,
        boat.dead_reckoning.latitude_rad,
        boat.dead_reckoning.longitude_rad,
        None if boat.position is None else boat.position.altitude_m,
        math.hypot(boat.dead_reckoning.north_m_s, boat.dead_reckoning.east_m_s),
        math.atan2(boat.dead_reckoning.east_m_s, boat.dead_reckoning.north_m_s) % TWO_PI,
    )


def to_integer(value: float | None, low: int, high: int, unknown: int) -> int:
    """Round and limit a value to [low, high]; return `unknown` for None and values that are not finite."""
    if value is None or not math.isfinite(value):
        return unknown
    return round(min(max(value, low), high))


def to_float32(value: float | None, unknown: float = 0.0) -> float:
    """Return the value; return `unknown` for None and values outside the range of single precision."""
    if value is None or not math.isfinite(value) or abs(value) > _SINGLE_MAX:
        return unknown
    return value


def scaled_degrees(angle_rad: float | None, unknown: int = 0) -> int:
    """Convert a latitude or longitude to 1e-7 degrees."""
    return to_integer(None if angle_rad is None else degrees(angle_rad) * 1e7, -1_800_000_000, 1_800_000_000, unknown)


def boot_us(t_s: float) -> int:
    """Convert the time since start to microseconds."""
    return to_integer(t_s * 1e6, 0, 1 << 62, 0)


def boot_ms(t_s: float) -> int:
    """Convert the time since start to milliseconds, which wrap after 49 days."""
    return to_integer(t_s * 1e3, 0, 1 << 62, 0) & UINT32_MAX
