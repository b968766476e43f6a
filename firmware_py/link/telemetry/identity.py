"""Identity of the autopilot: HEARTBEAT, modes, version, capabilities."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import msgspec

from firmware_py.common import mode_table
from firmware_py.common.mode_table import BaseMode, Mode, ModeProperties, StandardMode
from firmware_py.common.records import Severity
from firmware_py.common.reports import Snapshot
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.wire.dialect import Message, encode_text, mavlink

COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1
INITIALISING = 16  # custom_mode of ArduRover before the first tick

_CUSTOM_MODE_FLAG = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_ARMED_FLAG = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_MAVLINK_VERSION = 3  # of HEARTBEAT: MAVLink 1 and 2
_NOT_SELECTABLE, _AUTO_MODE = 2, 4  # MAV_MODE_PROPERTY, which the dialect of pymavlink lacks

_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
)

_CRITICAL_FAULTS = sum(1 << fault for fault, row in FAULTS.items() if row.severity <= Severity.CRITICAL)


class Version(msgspec.Struct, frozen=True):
    """Version of the program, and unique id of the boat (0: unknown)."""

    major: int = 0
    minor: int = 0
    patch: int = 0
    commit: str = ""
    uid: int = 0


class ModeRow(msgspec.Struct, frozen=True):
    """Mode with its MAVLink numbers."""

    mode: int  # custom_mode
    name: str
    base_mode: int
    properties: int  # MAV_MODE_PROPERTY
    standard: int = int(StandardMode.NONE)  # MAV_STANDARD_MODE


def _make_row(mode: Mode, row: ModeProperties) -> ModeRow:
    # A mode without manual input is an automatic mode.
    properties = 0 if row.base_mode & BaseMode.MANUAL_INPUT else _AUTO_MODE
    return ModeRow(mode, row.title, int(row.base_mode), properties, int(row.standard))


MODES = (
    *(_make_row(mode, row) for mode, row in mode_table.MODES.items()),
    ModeRow(INITIALISING, "INITIALISING", 0, _NOT_SELECTABLE),
)
# Sequence number of AVAILABLE_MODES_MONITOR. It changes with the table of modes, so that a station with a stored table
# requests it again.
MODES_SEQUENCE = zlib.crc32(repr(MODES).encode()) & 0xFF
_STANDARD_MODES: Mapping[int, int] = {row.mode: row.standard for row in MODES}
_BASE_MODES: Mapping[int, int] = {row.mode: row.base_mode for row in MODES}


def heartbeat(context: TelemetryContext) -> Message:
    """Build HEARTBEAT."""
    snapshot = context.snapshot
    base_mode = _CUSTOM_MODE_FLAG | _BASE_MODES[snapshot.mode] | (_ARMED_FLAG if snapshot.armed else 0)
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SURFACE_BOAT,
        context.autopilot,
        base_mode,
        int(snapshot.mode),
        _system_status(snapshot),
        _MAVLINK_VERSION,
    )


def first_heartbeat(autopilot: int) -> Message:
    """Build HEARTBEAT before the first tick."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SURFACE_BOAT,
        autopilot,
        _CUSTOM_MODE_FLAG,
        INITIALISING,
        mavlink.MAV_STATE_BOOT,
        _MAVLINK_VERSION,
    )


def _system_status(snapshot: Snapshot) -> int:
    """Return the MAV_STATE."""
    if snapshot.faults & _CRITICAL_FAULTS:
        return int(mavlink.MAV_STATE_CRITICAL)
    return int(mavlink.MAV_STATE_ACTIVE if snapshot.armed else mavlink.MAV_STATE_STANDBY)


def current_mode(context: TelemetryContext) -> Message:
    """Build CURRENT_MODE; the intended mode is the latest accepted request."""
    mode = int(context.snapshot.mode)
    intended = mode if context.intended_mode is None else context.intended_mode
    return mavlink.mavlink_map[436](_STANDARD_MODES[mode], mode, intended)


def mode_of_standard(standard: int) -> int | None:
    """Return the custom_mode of a MAV_STANDARD_MODE; None if the boat lacks the mode."""
    if standard == StandardMode.NONE:
        return None
    return next((row.mode for row in MODES if row.standard == standard), None)


def available_modes_monitor(_context: TelemetryContext) -> Message:
    """Build AVAILABLE_MODES_MONITOR."""
    return mavlink.mavlink_map[437](MODES_SEQUENCE)


def available_modes(index: int) -> list[Message]:
    """Build AVAILABLE_MODES of the mode with an index from 1, or of all modes (index 0); empty for an invalid index."""
    return [
        mavlink.mavlink_map[435](
            len(MODES), number, row.standard, int(row.mode), row.properties, encode_text(row.name, 34)
        )
        for number, row in enumerate(MODES, 1)
        if index in (0, number)
    ]


def autopilot_version(version: Version) -> Message:
    """Build AUTOPILOT_VERSION; the type is DEV, so that no ground station proposes a firmware update."""
    number = version.major << 24 | version.minor << 16 | version.patch << 8 | mavlink.FIRMWARE_VERSION_TYPE_DEV
    return mavlink.MAVLink_autopilot_version_message(
        capabilities=_CAPABILITIES,
        flight_sw_version=number,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=encode_text(version.commit, 8).ljust(8, b"\0"),
        middleware_custom_version=bytes(8),
        os_custom_version=bytes(8),
        vendor_id=0,
        product_id=0,
        uid=version.uid & 0xFFFFFFFFFFFFFFFF,
    )


def protocol_version() -> Message:
    """Build PROTOCOL_VERSION: MAVLink 1 and 2 are received, MAVLink 2 is sent."""
    return mavlink.mavlink_map[300](200, 100, 200, bytes(8), bytes(8))
