"""The table of telemetry: messages, rates and streams.

Rates in hertz: `fast` on UDP and TCP, `radio` on slow serial lines; 0: on request. On a satellite link all messages are
on request. `stream` is the MAV_DATA_STREAM of the old REQUEST_DATA_STREAM.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from firmware_py.link.telemetry import (
    identity,
    motion,
    status,
    vessels,
)
from firmware_py.link.telemetry.fields import TelemetryContext, boot_ms, single
from firmware_py.link.telemetry.named_values import NAMED_VALUES, NamedValue
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.outbox import Priority

Builder = Callable[[TelemetryContext], Message | None]

_STATUS = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
_RC = mavlink.MAV_DATA_STREAM_RC_CHANNELS
_POSITION = mavlink.MAV_DATA_STREAM_POSITION
_EXTRA1 = mavlink.MAV_DATA_STREAM_EXTRA1  # ATTITUDE in ArduPilot
_EXTRA2 = mavlink.MAV_DATA_STREAM_EXTRA2  # VFR_HUD
_EXTRA3 = mavlink.MAV_DATA_STREAM_EXTRA3  # BATTERY_STATUS, SYSTEM_TIME


class TelemetryRow(NamedTuple):
    """One message of telemetry."""

    number: int  # message id
    name: str
    build: Builder
    fast_hz: float
    radio_hz: float
    stream: int | None
    priority: Priority = Priority.TELEMETRY


def _named(value: NamedValue) -> TelemetryRow:
    label = text_of(value.name, 10)

    def build(context: TelemetryContext) -> Message | None:
        number = single(value.read(context), math.nan)
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
    TelemetryRow(235, "HIGH_LATENCY2", status.high_latency2, 0.0, 0.0, None),
    TelemetryRow(242, "HOME_POSITION", motion.home_position, 0.2, 0.02, None),
    TelemetryRow(245, "EXTENDED_SYS_STATE", status.extended_sys_state, 0.2, 0.02, None),
    TelemetryRow(301, "AIS_VESSEL", vessels.ais_vessel, 4.0, 0.2, _EXTRA3),
    TelemetryRow(436, "CURRENT_MODE", identity.current_mode, 0.5, 0.5, None),
    TelemetryRow(437, "AVAILABLE_MODES_MONITOR", identity.available_modes_monitor, 0.3, 0.05, None),
    *map(_named, NAMED_VALUES),
)


def _by_number() -> Mapping[int, tuple[int, ...]]:
    indexes: dict[int, tuple[int, ...]] = {}
    for index, row in enumerate(TABLE):
        indexes[row.number] = (*indexes.get(row.number, ()), index)
    return indexes


ROWS_OF: Mapping[int, tuple[int, ...]] = _by_number()  # message id -> indexes of TABLE
