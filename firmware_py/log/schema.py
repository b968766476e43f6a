"""Tables of the log messages: one row per message type, one column per field.

A tick is a sequence of records from TICK to END. Between them are the state before the tick (CHK, at checkpoints only),
the number of lost ticks (DROP, after a loss only), all inputs (HDG, FIX, RFB, DEV, REQ, PWR, AIS, SHIP, RANG, WIN,
DEP), the command (CTL) and the messages of derived_records.py and ardupilot.py, which a replay ignores. END contains
the sequence number of the tick, so that missing ticks are detected, and a checksum over all records since TICK.

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
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    Tick,
    WindReference,
    WindSample,
)
from firmware_py.common.reports import Output
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
from firmware_py.log import derived_records
from firmware_py.log.dataflash import MessageType
from firmware_py.log.message_rows import (
    Row,
    enum_column,
    flag_column,
    float_column,
    integer_column,
    microseconds,
    optional_column,
    optional_flag_column,
)

VERSION: Final = 2  # of requests and identities, which are stored as texts; early development versions had 1
_HOOKS: Final = Hooks(plan.as_plain, lambda _kind, data: plan.from_plain(data), {plan.Plan: plan.note_unknown})


def _keep_text(text: str) -> str:
    return text


def encode_request(request: Request) -> str:
    """Return the text of a request in the log."""
    return record_codec.to_text(request, VERSION, _HOOKS)


def _decode_request(text: str) -> tuple[Any, tuple[str, ...]]:
    return record_codec.from_text(Request, text, VERSION, _HOOKS)


def _decode_identity(text: str) -> tuple[Any, tuple[str, ...]]:
    return record_codec.from_text(VesselIdentity, text, VERSION)


TICK: Final = Row(
    140,
    "TICK",
    (
        integer_column("Tick", "Q", "index"),
        float_column("T", "s", "t_s"),
        float_column("Late", "s", "late_s"),
        integer_column("Skip", "Q", "skipped"),
        float_column("Rate", "z", "rate_hz"),
    ),
    Tick,
)
CHECKPOINT: Final = Row(
    141, "CHK", (integer_column("Tick", "Q", "index"), float_column("T", "s", "t_s")), _keep_text, text=True
)
HEADING: Final = Row(
    142,
    "HDG",
    (
        integer_column("I", "B", "source", "#"),
        float_column("T", "s", "t_s"),
        float_column("Hdg", "r", "heading_rad"),
        enum_column("Ref", "reference", NorthReference),
        optional_column("Var", "r", "variation_rad"),
        optional_column("YawR", "E", "yaw_rate_rad_s"),
        optional_column("Roll", "r", "roll_rad"),
        optional_column("Pitch", "r", "pitch_rad"),
        optional_column("Temp", "O", "temperature_c"),
    ),
    HeadingSample,
)
POSITION: Final = Row(
    143,
    "FIX",
    (
        float_column("T", "s", "t_s"),
        enum_column("Fix", "fix", FixType),
        optional_column("LatR", "r", "latitude_rad"),
        optional_column("LngR", "r", "longitude_rad"),
        optional_column("Alt", "m", "altitude_m"),
        optional_column("Sog", "n", "speed_over_ground_m_s"),
        optional_column("Cog", "r", "course_over_ground_rad"),
        optional_column("NSat", "S", "satellites", int),
        optional_column("HDop", "-", "hdop"),
        optional_column("Utc", "s", "utc_s"),
    ),
    PositionSample,
)
FEEDBACK: Final = Row(
    144,
    "RFB",
    (
        float_column("T", "s", "t_s"),
        optional_column("Shaft", "r", "shaft_rad"),
        optional_column("Temp", "O", "temperature_c"),
        optional_column("Volt", "v", "voltage_v"),
        optional_column("Curr", "A", "current_a"),
        integer_column("Err", "I", "hardware_error"),
        optional_flag_column("Torq", "torque_on"),
        integer_column("Rst", "I", "restarts"),
    ),
    RudderFeedback,
)
DEVICE: Final = Row(
    145,
    "DEV",
    (
        enum_column("I", "role", DeviceRole, "#"),
        float_column("T", "s", "t_s"),
        enum_column("State", "state", DeviceState),
        integer_column("Good", "Q", "accepted"),
        integer_column("Bad", "Q", "rejected"),
    ),
    DeviceHealth,
    text=True,
)
REQUEST: Final = Row(
    146,
    "REQ",
    (integer_column("Sys", "B", "system"), integer_column("Comp", "B", "component")),
    _decode_request,
    text=True,
    has_notes=True,
)
CONTROL: Final = Row(
    147,
    "CTL",
    (
        float_column("Shaft", "r", "command.shaft_rad"),
        flag_column("Torq", "command.torque_on"),
        integer_column("Mode", "B", "snapshot.mode"),
        flag_column("Arm", "snapshot.armed"),
        integer_column("Flt", "Q", "snapshot.faults"),
        float_column("RudC", "r", "snapshot.rudder_command_rad"),
        optional_column("Rud", "r", "snapshot.rudder_rad"),
        flag_column("RudOk", "snapshot.rudder_ok"),
        integer_column("Skips", "Q", "snapshot.skipped_total"),
    ),
    RudderCommand,
)
POWER: Final = Row(
    157,  # 156 differs from TICK in one bit only
    "PWR",
    (
        integer_column("I", "B", "source", "#"),
        float_column("T", "s", "t_s"),
        optional_column("Volt", "v", "voltage_v"),
        optional_column("Curr", "A", "current_a"),
        optional_column("SoC", "-", "charge"),
        optional_column("Sun", "W", "solar_w"),
        optional_column("Load", "A", "load_a"),
        optional_column("Temp", "O", "temperature_c"),
    ),
    PowerSample,
)
VESSEL: Final = Row(
    164,
    "AIS",
    (
        float_column("T", "s", "t_s"),
        integer_column("Mmsi", "I", "mmsi", "#"),
        enum_column("Kind", "kind", VesselKind),
        float_column("LatR", "r", "latitude_rad"),
        float_column("LngR", "r", "longitude_rad"),
        optional_column("Sog", "n", "speed_m_s"),
        optional_column("Cog", "r", "course_rad"),
        optional_column("Hdg", "r", "heading_rad"),
        optional_column("Turn", "E", "turn_rad_s"),
        integer_column("Stat", "B", "status"),
        flag_column("Acc", "accurate"),
    ),
    VesselPosition,
)
IDENTITY: Final = Row(
    165,
    "SHIP",
    (float_column("T", "s", "t_s"), integer_column("Mmsi", "I", "mmsi", "#")),
    _decode_identity,
    text=True,
    has_notes=True,
)
RUDDER_ANGLE: Final = Row(
    195,
    "RANG",
    (float_column("T", "s", "t_s"), float_column("Rud", "r", "rudder_rad")),
    RudderAngleSample,
)
WIND: Final = Row(
    196,
    "WIN",
    (
        float_column("T", "s", "t_s"),
        float_column("Spd", "n", "wind_m_s"),
        float_column("Ang", "r", "angle_rad"),
        enum_column("Ref", "reference", WindReference),
    ),
    WindSample,
)
DEPTH: Final = Row(
    197,
    "DEP",
    (float_column("T", "s", "t_s"), float_column("Depth", "m", "depth_m"), float_column("Trd", "m", "transducer_m")),
    DepthSample,
)
DROP: Final = MessageType(149, "DROP", "TimeUS,Lost", "QQ", "s-", "F-")
END: Final = MessageType(150, "END", "TimeUS,Seq,Crc", "QQI", "s--", "F--")
CRC_BYTES: Final = 4

# The rows that a reader converts to records, by message name.
READ_ROWS: Final[Mapping[str, Row]] = {
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
        RUDDER_ANGLE,
        WIND,
        DEPTH,
    )
}
TYPES: Final = (
    *(row.type for row in READ_ROWS.values()),
    *derived_records.TYPES,
    DROP,
    END,
)


def encode_inputs(inputs: Inputs) -> bytes:
    """Return the messages of all inputs but the tick; raises struct.error or ValueError for values out of range."""
    parts = [HEADING.pack(sample.t_s, sample) for sample in inputs.headings]
    parts += [POSITION.pack(sample.t_s, sample) for sample in inputs.positions]
    parts += [FEEDBACK.pack(sample.t_s, sample) for sample in inputs.rudder]
    parts += [DEVICE.pack_text(health.t_s, health, health.text) for health in inputs.devices]
    parts += [REQUEST.pack_text(request.t_s, request, encode_request(request)) for request in inputs.requests]
    parts += [POWER.pack(sample.t_s, sample) for sample in inputs.power]
    for report in inputs.vessels:
        if isinstance(report, VesselPosition):
            parts.append(VESSEL.pack(report.t_s, report))
        else:
            parts.append(IDENTITY.pack_text(report.t_s, report, record_codec.to_text(report, VERSION)))
    parts += [RUDDER_ANGLE.pack(sample.t_s, sample) for sample in inputs.rudder_angles]
    parts += [WIND.pack(sample.t_s, sample) for sample in inputs.wind]
    parts += [DEPTH.pack(sample.t_s, sample) for sample in inputs.depth]
    return b"".join(parts)


def encode_output(output: Output) -> bytes:
    """Return the messages of a command and its snapshot."""
    return CONTROL.pack(output.snapshot.t_s, output) + derived_records.encode_snapshot(output.snapshot)


def append_end(batch: bytes, t_s: float, sequence: int) -> bytes:
    """Append END to the records of a tick: sequence number and checksum over all records."""
    data = batch + END.pack(microseconds(t_s), sequence, 0)[:-CRC_BYTES]
    return data + zlib.crc32(data).to_bytes(CRC_BYTES, "little")
