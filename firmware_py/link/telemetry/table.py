"""Table of the telemetry messages with their default rates and streams, and the values of NAMED_VALUE_FLOAT.

`fast_hz` applies on UDP and TCP, `radio_hz` on slow serial lines; 0: on request. On a satellite link all messages are
on request. `stream` is the MAV_DATA_STREAM of REQUEST_DATA_STREAM.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

from firmware_py.common.angles import degrees
from firmware_py.common.reports import Estimate, Water
from firmware_py.link.telemetry import identity, motion, status, surroundings
from firmware_py.link.telemetry.fields import TelemetryContext, boot_ms, to_float32
from firmware_py.link.wire.dialect import Message, encode_text, mavlink
from firmware_py.link.wire.outbox import Priority

Report = TypeVar("Report")
Builder = Callable[[TelemetryContext], Message | None]

_JOULES_PER_WATT_HOUR = 3600.0

_STATUS = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
_RC = mavlink.MAV_DATA_STREAM_RC_CHANNELS
_POSITION = mavlink.MAV_DATA_STREAM_POSITION
_EXTRA1 = mavlink.MAV_DATA_STREAM_EXTRA1  # ATTITUDE in ArduPilot
_EXTRA2 = mavlink.MAV_DATA_STREAM_EXTRA2  # VFR_HUD
_EXTRA3 = mavlink.MAV_DATA_STREAM_EXTRA3  # BATTERY_STATUS, SYSTEM_TIME


class TelemetryRow(NamedTuple):
    """Telemetry message."""

    number: int  # message id
    name: str
    build: Builder
    fast_hz: float
    radio_hz: float
    stream: int | None
    priority: Priority = Priority.TELEMETRY


class NamedValue(NamedTuple):
    """Value of NAMED_VALUE_FLOAT; `read` returns None while it is unknown."""

    name: str
    read: Callable[[TelemetryContext], float | None]
    fast_hz: float
    radio_hz: float


def _get(report: Report | None, read: Callable[[Report], float | None]) -> float | None:
    return None if report is None else read(report)


def _estimate(name: str, read: Callable[[Estimate], float], fast_hz: float = 0.2, radio_hz: float = 0.02) -> NamedValue:
    return NamedValue(name, lambda context: _get(context.snapshot.estimate, read), fast_hz, radio_hz)


def _water(
    name: str, read: Callable[[Water], float | None], fast_hz: float = 0.2, radio_hz: float = 0.02
) -> NamedValue:
    return NamedValue(name, lambda context: _get(context.snapshot.water, read), fast_hz, radio_hz)


def _servo_watt_hours(context: TelemetryContext) -> float | None:
    energy = context.snapshot.energy
    return None if energy is None or energy.power_w is None else energy.energy_j / _JOULES_PER_WATT_HOUR


NAMED_VALUES: tuple[NamedValue, ...] = (
    # Measured and commanded rudder angle in degrees, starboard positive; temperature of the servo in degrees Celsius.
    # RUD_EST is sent instead of RUDDER while the angle is estimated because nothing measures it.
    NamedValue("RUDDER", lambda context: _get(context.snapshot.rudder_rad, degrees), 4.0, 1.0),
    NamedValue("RUD_EST", lambda context: _get(context.snapshot.rudder_estimate_rad, degrees), 4.0, 1.0),
    NamedValue("RUD_CMD", lambda context: degrees(context.snapshot.rudder_command_rad), 4.0, 1.0),
    NamedValue("RUD_TEMP", lambda context: _get(context.snapshot.servo, lambda servo: servo.temperature_c), 0.5, 0.1),
    # Lateness of the tick; skipped ticks since start.
    NamedValue("LATE_MS", lambda context: context.snapshot.late_s * 1e3, 1.0, 0.2),
    NamedValue("SKIPPED", lambda context: float(context.snapshot.skipped_total), 1.0, 0.2),
    # Number of stored versions of parameters, plans, record and key since start, and their size in MB.
    NamedValue("STO_WRITES", lambda context: _get(context.written, lambda written: float(written[0])), 0.1, 0.01),
    NamedValue("STO_MB", lambda context: _get(context.written, lambda written: written[1] * 1e-6), 0.1, 0.01),
    # Rudder travel in degrees per hour, and reversals per hour, over about the last hour.
    NamedValue(
        "RUD_TRAVEL",
        lambda context: _get(context.snapshot.energy, lambda energy: degrees(energy.travel_rad_per_h)),
        0.2,
        0.02,
    ),
    NamedValue(
        "RUD_REVERS", lambda context: _get(context.snapshot.energy, lambda energy: energy.reversals_per_h), 0.2, 0.02
    ),
    # Factor by which the proportional gain is reduced after a detected limit cycle (1: not reduced).
    NamedValue("HELM_SOFT", lambda context: context.snapshot.gain_reduction, 0.2, 0.02),
    # Energy of the servo since start in Wh, and its power in W; power in W of the solar panels at the output of the
    # charger, and of all loads.
    NamedValue("RUD_WH", _servo_watt_hours, 0.2, 0.02),
    NamedValue("RUD_WATT", lambda context: _get(context.snapshot.energy, lambda energy: energy.power_w), 0.2, 0.02),
    NamedValue("SOLAR_W", lambda context: _get(context.snapshot.power, lambda power: power.solar_w), 0.2, 0.02),
    NamedValue("LOAD_W", lambda context: _get(context.snapshot.power, lambda power: power.load_w), 0.2, 0.02),
    # Source of the heading: compass A 0, compass B 1, course over ground 2, none 3.
    _estimate("HDG_SRC", lambda estimate: float(estimate.source), 0.5),
    # Heading without waves: standard deviation and innovation in degrees, average normalised innovation squared (1:
    # consistent).
    _estimate("HDG_SD", lambda estimate: degrees(estimate.heading_sd_rad), 0.5),
    _estimate("HDG_INNOV", lambda estimate: degrees(estimate.innovation_rad), 1.0, 0.0),
    _estimate("HDG_NIS", lambda estimate: estimate.innovation_square),
    # Rudder bias in degrees; diffusion of the heading by disturbances in deg^2/s.
    _estimate("TRIM", lambda estimate: degrees(estimate.bias_rad)),
    _estimate("YAW_DIFF", lambda estimate: degrees(degrees(estimate.yaw_diffusion_rad2_s))),
    # Mean square error of predictions over half a minute divided by their variance (1: consistent).
    _estimate("PRED_SQ", lambda estimate: estimate.prediction_square),
    # Wave-frequency yaw: standard deviation in degrees, period in seconds.
    _estimate("WAVE_SD", lambda estimate: degrees(estimate.wave_sd_rad)),
    _estimate("WAVE_T", lambda estimate: estimate.wave_period_s),
    # Speed through the water, and the current with its larger standard deviation, in m/s.
    _water("WATER_SPD", lambda water: water.speed_m_s, 0.5, 0.05),
    _water("CURR_N", lambda water: water.current_north_m_s),
    _water("CURR_E", lambda water: water.current_east_m_s),
    _water("CURR_SD", lambda water: water.current_sd_m_s),
    # Direction of the velocity through water relative to the heading, in degrees, positive to starboard.
    _water("LEEWAY", lambda water: degrees(water.leeway_rad)),
)


def _named_row(value: NamedValue) -> TelemetryRow:
    label = encode_text(value.name, 10)

    def build(context: TelemetryContext) -> Message | None:
        number = to_float32(value.read(context), math.nan)
        if math.isnan(number):
            return None
        return mavlink.MAVLink_named_value_float_message(boot_ms(context.snapshot.t_s), label, number)

    return TelemetryRow(251, f"NAMED_VALUE_FLOAT {value.name}", build, value.fast_hz, value.radio_hz, _EXTRA3)


TABLE: tuple[TelemetryRow, ...] = (
    TelemetryRow(0, "HEARTBEAT", identity.heartbeat, 1.0, 1.0, None, Priority.URGENT),
    TelemetryRow(1, "SYS_STATUS", status.sys_status, 1.0, 0.5, _STATUS),
    TelemetryRow(2, "SYSTEM_TIME", status.system_time, 1.0, 0.1, _EXTRA3),
    TelemetryRow(24, "GPS_RAW_INT", motion.gps_raw_int, 2.0, 0.5, _STATUS),
    TelemetryRow(30, "ATTITUDE", motion.attitude, 10.0, 2.0, _EXTRA1),
    TelemetryRow(31, "ATTITUDE_QUATERNION", motion.attitude_quaternion, 0.0, 0.0, None),
    TelemetryRow(32, "LOCAL_POSITION_NED", motion.local_position_ned, 2.0, 0.0, _POSITION),
    TelemetryRow(33, "GLOBAL_POSITION_INT", motion.global_position_int, 4.0, 1.0, _POSITION),
    TelemetryRow(36, "SERVO_OUTPUT_RAW", motion.servo_output_raw, 4.0, 1.0, _RC),
    TelemetryRow(42, "MISSION_CURRENT", status.mission_current, 1.0, 0.5, _STATUS),
    TelemetryRow(49, "GPS_GLOBAL_ORIGIN", motion.gps_global_origin, 0.0, 0.0, None),
    TelemetryRow(62, "NAV_CONTROLLER_OUTPUT", motion.nav_controller_output, 2.0, 1.0, _STATUS),
    TelemetryRow(65, "RC_CHANNELS", status.rc_channels, 2.0, 0.5, _RC),
    TelemetryRow(74, "VFR_HUD", motion.vfr_hud, 4.0, 1.0, _EXTRA2),
    TelemetryRow(83, "ATTITUDE_TARGET", motion.attitude_target, 2.0, 0.5, _EXTRA1),
    TelemetryRow(87, "POSITION_TARGET_GLOBAL_INT", motion.position_target, 2.0, 0.2, _POSITION),
    TelemetryRow(147, "BATTERY_STATUS", status.battery_status, 1.0, 0.2, _EXTRA3),
    TelemetryRow(162, "FENCE_STATUS", status.fence_status, 0.5, 0.1, _STATUS),
    TelemetryRow(191, "MAG_CAL_PROGRESS", status.mag_cal_progress, 0.2, 0.05, None),
    TelemetryRow(192, "MAG_CAL_REPORT", status.mag_cal_report, 0.2, 0.05, None),
    TelemetryRow(193, "EKF_STATUS_REPORT", motion.ekf_status_report, 1.0, 0.2, _EXTRA3),
    TelemetryRow(230, "ESTIMATOR_STATUS", motion.estimator_status, 1.0, 0.2, _EXTRA3),
    TelemetryRow(231, "WIND_COV", surroundings.wind_cov, 1.0, 0.2, _EXTRA3),
    TelemetryRow(235, "HIGH_LATENCY2", status.high_latency2, 0.0, 0.0, None),
    TelemetryRow(242, "HOME_POSITION", motion.home_position, 0.2, 0.02, None),
    TelemetryRow(245, "EXTENDED_SYS_STATE", status.extended_sys_state, 0.2, 0.02, None),
    TelemetryRow(301, "AIS_VESSEL", motion.ais_vessel, 4.0, 0.2, _EXTRA3),
    TelemetryRow(436, "CURRENT_MODE", identity.current_mode, 0.5, 0.5, None),
    TelemetryRow(437, "AVAILABLE_MODES_MONITOR", identity.available_modes_monitor, 0.3, 0.05, None),
    TelemetryRow(11038, "WATER_DEPTH", surroundings.water_depth, 1.0, 0.2, _EXTRA3),
    *map(_named_row, NAMED_VALUES),
)


def _index_by_number() -> Mapping[int, tuple[int, ...]]:
    indexes: dict[int, tuple[int, ...]] = {}
    for index, row in enumerate(TABLE):
        indexes[row.number] = (*indexes.get(row.number, ()), index)
    return indexes


ROWS_OF: Mapping[int, tuple[int, ...]] = _index_by_number()  # message id: indexes of TABLE
