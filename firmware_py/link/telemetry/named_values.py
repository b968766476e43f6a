"""The values of NAMED_VALUE_FLOAT: rudder, servo, loop, energy of steering, and estimates.

Each function returns None while its value is not known.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_py.common.angles import degrees
from firmware_py.common.reports import Estimate, Water
from firmware_py.link.telemetry.fields import TelemetryContext

Value = Callable[[TelemetryContext], float | None]

_JOULES_PER_WATT_HOUR = 3600.0


def rudder_degrees(context: TelemetryContext) -> float | None:
    """Return the measured rudder angle in degrees, starboard positive."""
    rudder_rad = context.snapshot.rudder_rad
    return None if rudder_rad is None else degrees(rudder_rad)


def rudder_command_degrees(context: TelemetryContext) -> float | None:
    """Return the commanded rudder angle in degrees, starboard positive."""
    return degrees(context.snapshot.rudder_command_rad)


def servo_temperature(context: TelemetryContext) -> float | None:
    """Return the temperature of the rudder servo in degrees Celsius."""
    return context.snapshot.servo.temperature_c if context.snapshot.servo else None


def lateness_ms(context: TelemetryContext) -> float | None:
    """Return the lateness of the tick in milliseconds."""
    return context.snapshot.late_s * 1e3


def skipped_ticks(context: TelemetryContext) -> float | None:
    """Return the number of deadlines that passed unserved since start."""
    return float(context.snapshot.skipped_total)


def state_writes(context: TelemetryContext) -> float | None:
    """Return the number of stored versions of parameters, plans, record and key since start."""
    return None if context.written is None else float(context.written[0])


def state_megabytes(context: TelemetryContext) -> float | None:
    """Return their size in MB."""
    return None if context.written is None else context.written[1] * 1e-6


def travel_deg_per_h(context: TelemetryContext) -> float | None:
    """Return the rudder travel of about the last hour, in degrees."""
    return None if context.snapshot.energy is None else degrees(context.snapshot.energy.travel_rad_per_h)


def reversals_per_h(context: TelemetryContext) -> float | None:
    """Return the reversals of the rudder in about the last hour."""
    return None if context.snapshot.energy is None else context.snapshot.energy.reversals_per_h


def gain_reduction(context: TelemetryContext) -> float | None:
    """Return the gain reduction after a detected limit cycle."""
    return context.snapshot.gain_reduction


def servo_watt_hours(context: TelemetryContext) -> float | None:
    """Return the energy of the servo since start; None if it reports no power."""
    energy = context.snapshot.energy
    return None if energy is None or energy.power_w is None else energy.energy_j / _JOULES_PER_WATT_HOUR


def servo_watts(context: TelemetryContext) -> float | None:
    """Return the power of the servo."""
    return None if context.snapshot.energy is None else context.snapshot.energy.power_w


def solar_watts(context: TelemetryContext) -> float | None:
    """Return the power of the solar panels, behind the charger."""
    return None if context.snapshot.power is None else context.snapshot.power.solar_w


def load_watts(context: TelemetryContext) -> float | None:
    """Return the power of all loads."""
    return None if context.snapshot.power is None else context.snapshot.power.load_w


def _estimate_value(read: Callable[[Estimate], float]) -> Value:
    def value(context: TelemetryContext) -> float | None:
        return None if context.snapshot.estimate is None else read(context.snapshot.estimate)

    return value


def _water_value(read: Callable[[Water], float | None]) -> Value:
    def value(context: TelemetryContext) -> float | None:
        return None if context.snapshot.water is None else read(context.snapshot.water)

    return value


# Of the heading without waves: standard deviation, last innovation, and average normalised innovation squared, which is
# 1 for a consistent filter.
heading_sd_deg = _estimate_value(lambda estimate: degrees(estimate.heading_sd_rad))
innovation_deg = _estimate_value(lambda estimate: degrees(estimate.innovation_rad))
innovation_square = _estimate_value(lambda estimate: estimate.innovation_square)
# Compass A 0, compass B 1, course over ground 2, nothing 3.
heading_source = _estimate_value(lambda estimate: float(estimate.source))
# Rudder bias, and the diffusion of the heading by disturbances [deg^2/s].
trim_deg = _estimate_value(lambda estimate: degrees(estimate.bias_rad))
yaw_diffusion_deg2_s = _estimate_value(lambda estimate: degrees(degrees(estimate.yaw_diffusion_rad2_s)))
# Mean square error of predictions over half a minute divided by their variance: 1 for a consistent filter.
prediction_square = _estimate_value(lambda estimate: estimate.prediction_square)
# Of the wave-frequency yaw.
wave_sd_deg = _estimate_value(lambda estimate: degrees(estimate.wave_sd_rad))
wave_period_s = _estimate_value(lambda estimate: estimate.wave_period_s)
# Speed through the water, and the current with its larger standard deviation.
water_speed_m_s = _water_value(lambda water: water.speed_m_s)
current_north_m_s = _water_value(lambda water: water.current_north_m_s)
current_east_m_s = _water_value(lambda water: water.current_east_m_s)
current_sd_m_s = _water_value(lambda water: water.current_sd_m_s)
# Direction of the velocity through water relative to the heading, positive to starboard.
leeway_deg = _water_value(lambda water: degrees(water.leeway_rad))
