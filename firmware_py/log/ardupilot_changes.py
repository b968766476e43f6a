"""Arming, home, fence and faults as ArduPilot's events and errors, whenever they change.

Source: ArduPilot libraries/AP_Logger/AP_Logger.h (LogEvent, LogErrorSubsystem).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_py.common.reports import Snapshot
from firmware_py.faults.fault import Fault
from firmware_py.log.ardupilot_formats import ARMING, ERROR, EVENT, STATE
from firmware_py.log.message_rows import microseconds

ARMED, DISARMED, HOME_SET, FENCE_ON, FENCE_OFF = 10, 11, 25, 41, 42
_ALL_CHECKS: Final = 1
_BY_MAVLINK: Final = 2
_MAIN: Final = 1  # all other faults
_SUBSYSTEMS: Final[Mapping[Fault, int]] = {
    Fault.COMPASS_LOST: 3,
    Fault.COMPASS_SILENT: 3,
    Fault.COMPASS_FROZEN: 3,
    Fault.COMPASS_JUMPING: 3,
    Fault.BATTERY_LOW: 6,
    Fault.BATTERY_CRITICAL: 6,
    Fault.STATION_SILENT: 8,
    Fault.FENCE_BREACHED: 9,
    Fault.POSITION_LOST: 11,
    Fault.POSITION_JUMPING: 11,
}


def changes_bytes(before: Snapshot | None, boat: Snapshot) -> bytes:
    """Return the messages of changes since `before`; with None, at the start of a file, the present state."""
    time_us, parts = microseconds(boat.t_s), []
    if before is None or before.armed is not boat.armed:
        armed = int(boat.armed)
        parts.append(ARMING.pack(time_us, armed, _ALL_CHECKS, 0, _BY_MAVLINK))
        parts.append(EVENT.pack(time_us, ARMED if boat.armed else DISARMED))
        parts.append(STATE.pack(time_us, armed, float(armed), armed, 0))
    if boat.home != (None if before is None else before.home):
        parts.append(EVENT.pack(time_us, HOME_SET))
    fence_enabled = boat.navigation.fence_enabled
    if fence_enabled is not (before is not None and before.navigation.fence_enabled):
        parts.append(EVENT.pack(time_us, FENCE_ON if fence_enabled else FENCE_OFF))
    changed = boat.faults ^ (0 if before is None else before.faults)
    if changed:
        parts.extend(
            ERROR.pack(time_us, _SUBSYSTEMS.get(fault, _MAIN), boat.faults >> fault & 1)
            for fault in Fault
            if changed >> fault & 1
        )
    return b"".join(parts)
