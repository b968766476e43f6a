"""How far the mission is, for ground stations."""

from __future__ import annotations

from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import PlanKind, homes
from firmware_py.link.telemetry.context_fields import UINT16_MAX, TelemetryContext, whole
from firmware_py.link.wire.dialect import Message, mavlink

_CURRENT = mavlink.mavlink_map[42]
_IN_MISSION_MODE, _SUSPENDED = 1, 2


def mission_current(context: TelemetryContext) -> Message:
    """Return MISSION_CURRENT: item, total without home, state, and the opaque ids of the three plans."""
    boat = context.snapshot
    report = boat.mission
    sequence = 0 if report.index is None else report.index + homes(context.autopilot, PlanKind.MISSION)
    mode = _IN_MISSION_MODE if boat.mode is Mode.AUTO else _SUSPENDED
    total = whole(report.count or None, 0, UINT16_MAX - 1, UINT16_MAX)
    return _CURRENT(whole(sequence, 0, UINT16_MAX, 0), total, int(report.state), mode, *report.identities)
