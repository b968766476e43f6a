"""The values of NAMED_VALUE_FLOAT: rudder, servo, loop, energy of steering, and estimates."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeVar

from firmware_py.common.angles import degrees
from firmware_py.common.reports import Estimate, Water
from firmware_py.link.telemetry.fields import TelemetryContext

Part = TypeVar("Part")

_JOULES_PER_WATT_HOUR = 3600.0


class NamedValue(NamedTuple):
    """One value; `read` returns None while it is unknown."""

    name: str
    read: Callable[[TelemetryContext], float | None]
    fast_hz: float
    radio_hz: float


def _of(part: Part | None, read: Callable[[Part], float | None]) -> float | None:
    return None if part is None else read(part)


def _estimate(name: str, read: Callable[[Estimate], float], fast_hz: float = 0.2, radio_hz: float = 0.02) -> NamedValue:
    return NamedValue(name, lambda context: _of(context.snapshot.estimate, read), fast_hz, radio_hz)


def _water(
    name: str, read: Callable[[Water], float | None], fast_hz: float = 0.2, radio_hz: float = 0.02
) -> NamedValue:
    return NamedValue(name, lambda context: _of(context.snapshot.water, read), fast_hz, radio_hz)


def _servo_watt_hours(context: TelemetryContext) -> float | None:
    energy = context.snapshot.energy
    return None if energy is None or energy.power_w is None else energy.energy_j / _JOULES_PER_WATT_HOUR


NAMED_VALUES: tuple[NamedValue, ...] = (
    # Measured and commanded rudder angle in degrees, starboard positive; temperature of the servo in degrees Celsius.
    NamedValue("RUDDER", lambda context: _of(context.snapshot.rudder_rad, degrees), 4.0, 1.0),
    NamedValue("RUD_CMD", lambda context: degrees(context.snapshot.rudder_command_rad), 4.0, 1.0),
    NamedValue("RUD_TEMP", lambda context: _of(context.snapshot.servo, lambda servo: servo.temperature_c), 0.5, 0.1),
    # Lateness of the tick; deadlines that passed unserved since start.
    NamedValue("LATE_MS", lambda context: context.snapshot.late_s * 1e3, 1.0, 0.2),
    NamedValue("SKIPPED", lambda context: float(context.snapshot.skipped_total), 1.0, 0.2),
    # Stored versions of parameters, plans, record and key since start, and their size in MB.
    NamedValue("STO_WRITES", lambda context: _of(context.written, lambda written: float(written[0])), 0.1, 0.01),
    NamedValue("STO_MB", lambda context: _of(context.written, lambda written: written[1] * 1e-6), 0.1, 0.01),
    # Rudder travel in degrees and reversals of about the last hour.
    NamedValue(
        "RUD_TRAVEL", lambda context: _of(context.snapshot.energy, lambda it: degrees(it.travel_rad_per_h)), 0.2, 0.02
    ),
    NamedValue("RUD_REVERS", lambda context: _of(context.snapshot.energy, lambda it: it.reversals_per_h), 0.2, 0.02),
    # Gain reduction after a detected limit cycle.
    NamedValue("HELM_SOFT", lambda context: context.snapshot.gain_reduction, 0.2, 0.02),
    # Energy of the servo since start, and its power; power of the solar panels behind the charger, and of all loads.
    NamedValue("RUD_WH", _servo_watt_hours, 0.2, 0.02),
    NamedValue("RUD_WATT", lambda context: _of(context.snapshot.energy, lambda energy: energy.power_w), 0.2, 0.02),
    NamedValue("SOLAR_W", lambda context: _of(context.snapshot.power, lambda power: power.solar_w), 0.2, 0.02),
    NamedValue("LOAD_W", lambda context: _of(context.snapshot.power, lambda power: power.load_w), 0.2, 0.02),
    # Source of the heading: compass A 0, compass B 1, course over ground 2, none 3.
    _estimate("HDG_SRC", lambda estimate: float(estimate.source), 0.5),
    # Heading without waves: standard deviation, innovation, average normalised innovation squared (1: consistent).
    _estimate("HDG_SD", lambda estimate: degrees(estimate.heading_sd_rad), 0.5),
    _estimate("HDG_INNOV", lambda estimate: degrees(estimate.innovation_rad), 1.0, 0.0),
    _estimate("HDG_NIS", lambda estimate: estimate.innovation_square),
    # Rudder bias; diffusion of the heading by disturbances [deg^2/s].
    _estimate("TRIM", lambda estimate: degrees(estimate.bias_rad)),
    _estimate("YAW_DIFF", lambda estimate: degrees(degrees(estimate.yaw_diffusion_rad2_s))),
    # Mean square error of predictions over half a minute divided by their variance (1: consistent).
    _estimate("PRED_SQ", lambda estimate: estimate.prediction_square),
    # Wave-frequency yaw.
    _estimate("WAVE_SD", lambda estimate: degrees(estimate.wave_sd_rad)),
    _estimate("WAVE_T", lambda estimate: estimate.wave_period_s),
    # Speed through the water, and the current with its larger standard deviation.
    _water("WATER_SPD", lambda water: water.speed_m_s, 0.5, 0.05),
    _water("CURR_N", lambda water: water.current_north_m_s),
    _water("CURR_E", lambda water: water.current_east_m_s),
    _water("CURR_SD", lambda water: water.current_sd_m_s),
    # Direction of the velocity through water relative to the heading, positive to starboard.
    _water("LEEWAY", lambda water: degrees(water.leeway_rad)),
)
