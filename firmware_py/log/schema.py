"""What is logged: one row a message, one column a field.

A tick is a run of records from TICK to END. Between them stand, at a checkpoint, the
state before the tick (CHK) and the ticks lost so far (DROP); all inputs (HDG, FIX, RFB,
DEV, REQ); the decision (CTL); and, for reading along only, NAV and the messages of
ardupilot.py. END has the number of the tick, which shows missing ones, and a checksum over
all since TICK, which shows damage.

Inputs and decisions are doubles, in SI units and radians; T is the exact time that
TimeUS, the column of the tools, is rounded from.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from typing import Any, Final

from firmware_py.common.intents import Request
from firmware_py.common.json_codec import Codec
from firmware_py.common.plan import HOOK as PLAN_HOOK
from firmware_py.common.record_history import Change
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderCommand,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import Output
from firmware_py.log.dataflash import MessageType
from firmware_py.log.rows import Row, choice, flag, maybe, maybe_flag, microseconds, real, whole

# How requests differ from version to version; plain_history.py says what a change is.
CHANGES: Final[tuple[Change, ...]] = ()
_REQUESTS: Final = Codec((Request,), (PLAN_HOOK,), changes=CHANGES)


def _text(text: str) -> str:
    return text


def _request(text: str) -> tuple[Any, tuple[str, ...]]:
    return _REQUESTS.read(text)


def _not_read() -> None:
    return None


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
NAVIGATION: Final = Row(
    148,
    "NAV",
    (
        maybe("Hdg", "r", "heading_rad"),
        flag("HdgOk", "heading_ok"),
        maybe("YawR", "E", "yaw_rate_rad_s"),
        maybe("Roll", "r", "roll_rad"),
        maybe("Pitch", "r", "pitch_rad"),
        maybe("Goal", "r", "goal_heading_rad"),
        maybe("Err", "r", "heading_error_rad"),
        maybe("Brg", "r", "bearing_rad"),
        maybe("Dist", "m", "distance_m"),
        flag("PosOk", "position_ok"),
        real("Soft", "-", "helm_softness"),
    ),
    _not_read,
)
GUIDANCE: Final = Row(
    153,
    "GDN",
    (
        whole("Do", "B", "navigation.activity"),
        maybe("Lat", "r", "navigation.target_latitude_rad"),
        maybe("Lng", "r", "navigation.target_longitude_rad"),
        maybe("Rad", "m", "navigation.radius_m"),
        maybe("XTrk", "m", "navigation.cross_track_m"),
        flag("Arr", "navigation.arrived"),
        maybe("Fnc", "m", "navigation.fence_margin_m"),
        whole("MSt", "B", "mission.state"),
        maybe("MItm", "-", "mission.index"),
    ),
    _not_read,
)
WATER: Final = Row(
    154,
    "WTR",
    (
        real("U", "n", "speed_m_s"),
        real("USd", "n", "speed_sd_m_s"),
        real("CN", "n", "current_north_m_s"),
        real("CE", "n", "current_east_m_s"),
        real("CSd", "n", "current_sd_m_s"),
        real("Lee", "r", "leeway_rad"),
        real("LSd", "r", "leeway_sd_rad"),
        real("Fol", "E", "follow_rad_s"),
        real("CLag", "s", "course_lag_s"),
        real("Orb", "n", "orbit_m_s"),
        flag("Strg", "too_strong"),
    ),
    _not_read,
)
ESTIMATE: Final = Row(
    151,
    "EST",
    (
        real("Hdg", "r", "heading_rad"),
        real("HSd", "r", "heading_sd_rad"),
        real("YawR", "E", "yaw_rate_rad_s"),
        whole("Src", "B", "source"),
        real("Bias", "r", "bias_rad"),
        real("BSd", "r", "bias_sd_rad"),
        real("WT", "s", "wave_period_s"),
        real("WSd", "r", "wave_sd_rad"),
        real("U", "n", "speed_m_s"),
        real("CN", "n", "current_north_m_s"),
        real("CE", "n", "current_east_m_s"),
        real("Fac", "-", "turning_factor"),
        real("In", "r", "innovation_rad"),
        real("ISd", "r", "innovation_sd_rad"),
        real("I2", "-", "innovation_square"),
    ),
    _not_read,
)
ENERGY: Final = Row(
    155,
    "ENRG",
    (
        real("Trav", "r", "travel_rad"),
        whole("Rev", "Q", "reversals"),
        real("Enrg", "J", "energy_j"),
        real("TrvH", "r", "travel_rad_per_h"),
        real("RevH", "-", "reversals_per_h"),
        maybe("Pow", "W", "power_w"),
        flag("Rest", "resting"),
    ),
    _not_read,
)
DROP: Final = MessageType(149, "DROP", "TimeUS,Lost", "QQ", "s-", "F-")
END: Final = MessageType(150, "END", "TimeUS,Seq,Crc", "QQI", "s--", "F--")
CRC_BYTES: Final = 4
# Where she goes and what the water does changes slowly: it is told once in so many ticks.
GUIDANCE_TICKS: Final = 10

# The rows that a reader makes records of, by message name.
READ: Final[Mapping[str, Row]] = {
    row.type.name: row for row in (TICK, CHECKPOINT, HEADING, POSITION, FEEDBACK, DEVICE, REQUEST, CONTROL)
}
TYPES: Final = (
    *(row.type for row in READ.values()),
    NAVIGATION.type,
    ESTIMATE.type,
    GUIDANCE.type,
    WATER.type,
    ENERGY.type,
    DROP,
    END,
)


def inputs_bytes(inputs: Inputs) -> bytes:
    """Return the messages of all inputs but the tick; struct.error or ValueError for what does not fit."""
    parts = [HEADING.pack(sample.t_s, sample) for sample in inputs.headings]
    parts += [POSITION.pack(sample.t_s, sample) for sample in inputs.positions]
    parts += [FEEDBACK.pack(sample.t_s, sample) for sample in inputs.rudder]
    parts += [DEVICE.pack_text(health.t_s, health, health.text) for health in inputs.devices]
    parts += [REQUEST.pack_text(one.t_s, one, _REQUESTS.to_text(one)) for one in inputs.requests]
    return b"".join(parts)


def output_bytes(output: Output) -> bytes:
    """Return the messages of a decision."""
    t_s, boat = output.snapshot.t_s, output.snapshot
    decided = CONTROL.pack(t_s, output) + NAVIGATION.pack(t_s, boat)
    if boat.estimate is not None:
        decided += ESTIMATE.pack(t_s, boat.estimate)
    if boat.tick % GUIDANCE_TICKS:
        return decided
    decided += GUIDANCE.pack(t_s, boat)
    if boat.energy is not None:
        decided += ENERGY.pack(t_s, boat.energy)
    return decided if boat.water is None else decided + WATER.pack(t_s, boat.water)


def end_bytes(batch: bytes, t_s: float, sequence: int) -> bytes:
    """Return the records of a tick, closed by its number and the checksum over all before it."""
    data = batch + END.pack(microseconds(t_s), sequence, 0)[:-CRC_BYTES]
    return data + zlib.crc32(data).to_bytes(CRC_BYTES, "little")
