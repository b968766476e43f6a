"""ArduPilot messages for log viewers: track, modes, parameters and texts. A replay ignores them.

Source: ArduPilot libraries/AP_Logger/LogStructure.h and the structures of its GPS and vehicle folders.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterable
from typing import Final

from firmware_py.common.angles import compass_degrees, degrees, wrap_pi
from firmware_py.common.parameter_table import TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, FixType, PositionSample, Severity
from firmware_py.log import ardupilot_formats
from firmware_py.log.dataflash import MessageType
from firmware_py.log.message_rows import microseconds

GPS: Final = MessageType(
    160,
    "GPS",
    "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs",
    "QBBIHBCLLddd",
    "s#-s-S-DUmnh",
    "F--C-0BGG000",
)
MODE: Final = MessageType(161, "MODE", "TimeUS,Mode,ModeNum,Rsn", "QMBB", "s---", "F---")
PARM: Final = MessageType(162, "PARM", "TimeUS,Name,Value,Default", "QNff", "s---", "F---")
MSG: Final = MessageType(163, "MSG", "TimeUS,Message,Sev", "QZB", "s--", "F--")
TYPES: Final = (GPS, MODE, PARM, MSG, *ardupilot_formats.TYPES)

GPS_EPOCH_S: Final = 315964800.0  # 1980-01-06 in seconds since 1970
LEAP_SECONDS: Final = 18.0  # GPS minus UTC since 2017; pymavlink subtracts the same
WEEK_S: Final = 604800.0
MAX_UTC_S: Final = 4102444800.0  # 2100-01-01

_DEFAULTS: Final = {row.name: row.default for row in TABLE}


def encode_position(sample: PositionSample) -> bytes:
    """Return the GPS message of a fix, empty without a position."""
    if sample.fix is FixType.NONE or sample.latitude_rad is None or sample.longitude_rad is None:
        return b""
    week, week_ms = _to_gps_time(sample.utc_s)
    return GPS.pack(
        microseconds(sample.t_s),
        0,
        sample.fix,
        week_ms,
        week,
        _scale_and_limit(sample.satellites, 1.0, 0xFF),
        _scale_and_limit(sample.hdop, 100.0, 0xFFFF),
        round(degrees(wrap_pi(sample.latitude_rad)) * 1e7),
        round(degrees(wrap_pi(sample.longitude_rad)) * 1e7),
        *(math.nan if value is None else value for value in (sample.altitude_m, sample.speed_over_ground_m_s)),
        math.nan if sample.course_over_ground_rad is None else compass_degrees(sample.course_over_ground_rad),
    )


def encode_mode(t_s: float, mode: int) -> bytes:
    """Return the message of a mode change."""
    return MODE.pack(microseconds(t_s), mode, mode, 0)


def encode_parameter(t_s: float, name: str, value: float) -> bytes:
    """Return the message of one parameter with its default."""
    return PARM.pack(microseconds(t_s), name.encode(), value, _DEFAULTS[name])


def encode_parameters(t_s: float, values: ParameterSet) -> bytes:
    """Return the messages of all parameters."""
    return b"".join(encode_parameter(t_s, name, value) for name, value in values.items())


def encode_texts(t_s: float, events: Iterable[Event]) -> bytes:
    """Return the messages of texts to the operator, each truncated to the 64 bytes of its column."""
    return b"".join(
        MSG.pack(microseconds(t_s), event.text.encode("utf-8", "replace"), event.severity) for event in events
    )


def start_texts(software: str, utc_s: float) -> tuple[Event, ...]:
    """Return the texts at the start of a file: software version, numbering of modes, time of the start.

    pymavlink selects its mode names by the word ArduRover.
    """
    start_text = "unknown"
    if 0.0 <= utc_s < MAX_UTC_S:
        start_text = dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    texts = (software, "Modes are numbered as ArduRover's", f"Process started {start_text}")
    return tuple(Event(Severity.INFO, text) for text in texts)


def _to_gps_time(utc_s: float | None) -> tuple[int, int]:
    """Convert UTC to GPS week and milliseconds of the week; zeros if it is unknown or out of range."""
    if utc_s is None or not GPS_EPOCH_S <= utc_s < MAX_UTC_S:
        return 0, 0
    week, week_s = divmod(utc_s - GPS_EPOCH_S + LEAP_SECONDS, WEEK_S)
    return int(week), int(week_s * 1e3)


def _scale_and_limit(value: float | None, factor: float, max_value: int) -> int:
    """Multiply by a factor and limit to integers from 0 to `max_value`; 0 for None and NaN."""
    if value is None or not value > 0.0:
        return 0
    return int(min(value * factor, float(max_value)))
