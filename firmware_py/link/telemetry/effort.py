"""Telemetry of what steering costs: rudder travel, reversals, and the servo's energy."""

from __future__ import annotations

from firmware_py.common.angles import degrees
from firmware_py.link.telemetry.context_fields import TelemetryContext

_JOULES_PER_WATT_HOUR = 3600.0


def travel_deg_per_h(context: TelemetryContext) -> float | None:
    """Return the rudder travel of about the last hour, in degrees."""
    return None if context.snapshot.energy is None else degrees(context.snapshot.energy.travel_rad_per_h)


def reversals_per_h(context: TelemetryContext) -> float | None:
    """Return the reversals of the rudder in about the last hour."""
    return None if context.snapshot.energy is None else context.snapshot.energy.reversals_per_h


def servo_watt_hours(context: TelemetryContext) -> float | None:
    """Return the energy that the servo has taken since start; None when it tells no power."""
    energy = context.snapshot.energy
    return None if energy is None or energy.power_w is None else energy.energy_j / _JOULES_PER_WATT_HOUR


def servo_watts(context: TelemetryContext) -> float | None:
    """Return the power that the servo takes."""
    return None if context.snapshot.energy is None else context.snapshot.energy.power_w
