"""Telemetry of a swing of the compass: MAG_CAL_PROGRESS until there is a proposal, MAG_CAL_REPORT while one waits."""

from __future__ import annotations

from firmware_py.common.angles import degrees
from firmware_py.common.records import CalibrationState
from firmware_py.common.reports import SwingReport
from firmware_py.link.telemetry.context_fields import TelemetryContext
from firmware_py.link.wire.dialect import Message, mavlink

_COMPASS, _MASK = 0, 1
_MASK_BYTES = 10
_ATTEMPT = 1
_NO_DIRECTION = (0.0, 0.0, 0.0)


def mag_cal_progress(context: TelemetryContext) -> Message | None:
    """Return MAG_CAL_PROGRESS; bit n of completion_mask is the nth twelfth of the circle."""
    swing = context.swing
    if swing.state is not CalibrationState.RUNNING:
        return None
    mask = swing.sectors.to_bytes(_MASK_BYTES, "little")
    status = mavlink.MAG_CAL_RUNNING_STEP_ONE
    return mavlink.mavlink_map[191](_COMPASS, _MASK, status, _ATTEMPT, swing.percent, mask, *_NO_DIRECTION)


def mag_cal_report(context: TelemetryContext) -> Message | None:
    """Return MAG_CAL_REPORT of a proposal that waits for being accepted."""
    swing = context.swing
    return None if swing.state is not CalibrationState.DONE else report_of(swing, saved=False)


def report_of(swing: SwingReport, *, saved: bool) -> Message:
    """Return MAG_CAL_REPORT: its fitness is what is left over, in degrees; a swing has no offsets of a field."""
    fitness = degrees(swing.residual_after_rad or swing.sd_rad or 0.0)
    nothing = (0.0,) * 9
    return mavlink.MAVLink_mag_cal_report_message(
        _COMPASS, _MASK, mavlink.MAG_CAL_SUCCESS, int(saved), fitness, *nothing
    )
