"""The log messages: one row per message type, one column per field.

A tick is a sequence of records from TICK to END. Between them are the state before the tick (CHK) and the number of
lost ticks (DROP) at a checkpoint, all inputs (HDG, FIX, RFB, DEV, REQ, PWR, AIS, SHIP), the command (CTL) and, for
readers only, the messages of derived_records.py and ardupilot.py. END has the number of the tick, which reveals missing
ones, and a checksum over all records since TICK.

Inputs and commands are doubles in SI units and radians. T is the exact time, TimeUS the rounded one for log tools.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any, Final

from firmware_py.common import plan, record_codec
from firmware_py.common.intents import Request
from firmware_py.common.record_codec import Hooks
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import Output
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.log import derived_records
from firmware_py.log.dataflash import MessageType
from firmware_py.log.message_rows import Row, choice, flag, maybe, maybe_flag, microseconds, real, whole

VERSION: Final = 2  # of the records stored as texts: requests and identities; early development versions had 1
_HOOKS: Final = Hooks(plan.as_plain, lambda _kind, data: plan.from_plain(data), {plan.Plan: plan.drop_unknown})


def _text(text: str) -> str:
    return text


def request_text(request: Request) -> str:
    """Return a request as it is logged."""
    return record_codec.to_text(request, VERSION, _HOOKS)


def _request(text: str) -> tuple[Any, tuple[str, ...]]:
    return record_codec.from_text(Request, text, VERSION, _HOOKS)


def _identity(text: str) -> tuple[Any, tuple[str, ...]]:
    return record_codec.from_text(VesselIdentity, text, VERSION)


TICK: Final = Row(
    140,
    "TICK",
    (
        whole("Tick", "Q", "index"),
        real("T", "s", "t_s"),
        real("Late", "s", "late_s"),
        whole("Skip", "Q", "skipped"),
        real("Rate", "z", "rate_hz"),
    ),
    Tick,
)
CHECKPOINT: Final = Row(141, "CHK", (whole("Tick", "Q", "index"), real("T", "s", "t_s")), _text, text=True)
HEADING: Final = Row(
    142,
    "HDG",
    (
        whole("I", "B", "source", "#"),
        real("T", "s", "t_s"),
        real("Hdg", "r", "heading_rad"),
        choice("Ref", "reference", NorthReference),
        maybe("Var", "r", "variation_rad"),
        maybe("YawR", "E", "yaw_rate_rad_s"),
        maybe("Roll", "r", "roll_rad"),
        maybe("Pitch", "r", "pitch_rad"),
        maybe("Temp", "O", "temperature_c"),
    ),
    HeadingSample,
)
POSITION: Final = Row(
    143,
    "FIX",
    (
        real("T", "s", "t_s"),
        choice("Fix", "fix", FixType),
        maybe("LatR", "r", "latitude_rad"),
        maybe("LngR", "r", "longitude_rad"),
        maybe("Alt", "m", "altitude_m"),
        maybe("Sog", "n", "speed_over_ground_m_s"),
        maybe("Cog", "r", "course_over_ground_rad"),
        maybe("NSat", "S", "satellites", int),
        maybe("HDop", "-", "hdop"),
        maybe("Utc", "s", "utc_s"),
    ),
    PositionSample,
)
FEEDBACK: Final = Row(
    144,
    "RFB",
    (
        real("T", "s", "t_s"),
        maybe("Shaft", "r", "shaft_rad"),
        maybe("Temp", "O", "temperature_c"),
        maybe("Volt", "v", "voltage_v"),
        maybe("Curr", "A", "current_a"),
        whole("Err", "I", "hardware_error"),
        maybe_flag("Torq", "torque_on"),
        whole("Rst", "I", "restarts"),
    ),
    RudderFeedback,
)
DEVICE: Final = Row(
    145,
    "DEV",
    (
        choice("I", "role", DeviceRole, "#"),
        real("T", "s", "t_s"),
        choice("State", "state", DeviceState),
        whole("Good", "Q", "accepted"),
        whole("Bad", "Q", "rejected"),
    ),
    DeviceHealth,
    text=True,
)
REQUEST: Final = Row(
    146, "REQ", (whole("Sys", "B", "system"), whole("Comp", "B", "component")), _request, text=True, noted=True
)
CONTROL: Final = Row(
    147,
    "CTL",
    (
        real("Shaft", "r", "command.shaft_rad"),
        flag("Torq", "command.torque_on"),
        whole("Mode", "B", "snapshot.mode"),
        flag("Arm", "snapshot.armed"),
        whole("Flt", "I", "snapshot.faults"),
        real("RudC", "r", "snapshot.rudder_command_rad"),
        maybe("Rud", "r", "snapshot.rudder_rad"),
        flag("RudOk", "snapshot.rudder_ok"),
        whole("Skips", "Q", "snapshot.skipped_total"),
    ),
    RudderCommand,
)
POWER: Final = Row(
    157,  # 156 differs from TICK in one bit only
    "PWR",
    (
        whole("I", "B", "source", "#"),
        real("T", "s", "t_s"),
        maybe("Volt", "v", "voltage_v"),
        maybe("Curr", "A", "current_a"),
        maybe("SoC", "-", "charge"),
        maybe("Sun", "W", "solar_w"),
        maybe("Load", "A", "load_a"),
        maybe("Temp", "O", "temperature_c"),
    ),
    PowerSample,
)
VESSEL: Final = Row(
    164,
    "AIS",
    (
        real("T", "s", "t_s"),
        whole("Mmsi", "I", "mmsi", "#"),
        choice("Kind", "kind", VesselKind),
        real("LatR", "r", "latitude_rad"),
        real("LngR", "r", "longitude_rad"),
        maybe("Sog", "n", "speed_m_s"),
        maybe("Cog", "r", "course_rad"),
        maybe("Hdg", "r", "heading_rad"),
        maybe("Turn", "E", "turn_rad_s"),
        whole("Stat", "B", "status"),
        flag("Acc", "accurate"),
    ),
    VesselPosition,
)
IDENTITY: Final = Row(
    165, "SHIP", (real("T", "s", "t_s"), whole("Mmsi", "I", "mmsi", "#")), _identity, text=True, noted=True
)
DROP: Final = MessageType(149, "DROP", "TimeUS,Lost", "QQ", "s-", "F-")
END: Final = MessageType(150, "END", "TimeUS,Seq,Crc", "QQI", "s--", "F--")
CRC_BYTES: Final = 4

# The rows that a reader converts to records, by message name.
READ: Final[Mapping[str, Row]] = {
    row.type.name: row
    for row in (
        TICK,
        CHECKPOINT,
        HEADING,
        POSITION,
        FEEDBACK,
        DEVICE,
        REQUEST,
        CONTROL,
        POWER,
        VESSEL,
        IDENTITY,
    )
}
TYPES: Final = (
    *(row.type for row in READ.values()),
    *derived_records.TYPES,
    DROP,
    END,
)


def inputs_bytes(inputs: Inputs) -> bytes:
    """Return the messages of all inputs but the tick; raises struct.error or ValueError for unfit values."""
    parts = [HEADING.pack(sample.t_s, sample) for sample in inputs.headings]
    parts += [POSITION.pack(sample.t_s, sample) for sample in inputs.positions]
    parts += [FEEDBACK.pack(sample.t_s, sample) for sample in inputs.rudder]
    parts += [DEVICE.pack_text(health.t_s, health, health.text) for health in inputs.devices]
    parts += [REQUEST.pack_text(one.t_s, one, request_text(one)) for one in inputs.requests]
    parts += [POWER.pack(sample.t_s, sample) for sample in inputs.power]
    for report in inputs.vessels:
        if isinstance(report, VesselPosition):
            parts.append(VESSEL.pack(report.t_s, report))
        else:
            parts.append(IDENTITY.pack_text(report.t_s, report, record_codec.to_text(report, VERSION)))
    return b"".join(parts)


def output_bytes(output: Output) -> bytes:
    """Return the messages of a command and its snapshot."""
    return CONTROL.pack(output.snapshot.t_s, output) + derived_records.snapshot_bytes(output.snapshot)


def end_bytes(batch: bytes, t_s: float, sequence: int) -> bytes:
    """Return the records of a tick with END: its number and the checksum over all records."""
    data = batch + END.pack(microseconds(t_s), sequence, 0)[:-CRC_BYTES]
    return data + zlib.crc32(data).to_bytes(CRC_BYTES, "little")
