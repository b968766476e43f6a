"""ArduPilot messages for log viewers: track, modes, parameters and texts. They are not read back.

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
from firmware_py.log.dataflash import TEXT_BYTES, MessageType
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


def position_bytes(sample: PositionSample) -> bytes:
    """Return a fix as a GPS message, empty without a position."""
    if sample.fix is FixType.NONE or sample.latitude_rad is None or sample.longitude_rad is None:
        return b""
    week, week_ms = _gps_time(sample.utc_s)
    return GPS.pack(
        microseconds(sample.t_s),
        0,
        sample.fix,
        week_ms,
        week,
        _bounded(sample.satellites, 1.0, 0xFF),
        _bounded(sample.hdop, 100.0, 0xFFFF),
        round(degrees(wrap_pi(sample.latitude_rad)) * 1e7),
        round(degrees(wrap_pi(sample.longitude_rad)) * 1e7),
        *(math.nan if value is None else value for value in (sample.altitude_m, sample.speed_over_ground_m_s)),
        math.nan if sample.course_over_ground_rad is None else compass_degrees(sample.course_over_ground_rad),
    )


def mode_bytes(t_s: float, mode: int) -> bytes:
    """Return the message of a mode change."""
    return MODE.pack(microseconds(t_s), mode, mode, 0)


def parameter_bytes(t_s: float, name: str, value: float) -> bytes:
    """Return the message of one parameter with its default."""
    return PARM.pack(microseconds(t_s), name.encode(), value, _DEFAULTS[name])


def parameters_bytes(t_s: float, values: ParameterSet) -> bytes:
    """Return the messages of all parameters."""
    return b"".join(parameter_bytes(t_s, name, value) for name, value in values.items())


def message_bytes(t_s: float, events: Iterable[Event]) -> bytes:
    """Return the messages of texts to the operator, each cut to TEXT_BYTES."""
    return b"".join(
        MSG.pack(microseconds(t_s), event.text.encode("utf-8", "replace")[:TEXT_BYTES], event.severity)
        for event in events
    )


def opening(software: str, utc_s: float) -> tuple[Event, ...]:
    """Return the texts at the start of a file, the software version first.

    The word ArduRover makes pymavlink use that vehicle's mode names.
    """
    started = "unknown"
    if 0.0 <= utc_s < MAX_UTC_S:
        started = dt.datetime.fromtimestamp(utc_s, tz=dt.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    texts = (software, "Modes are numbered as ArduRover's", f"Process started {started}")
    return tuple(Event(Severity.INFO, text) for text in texts)


def _gps_time(utc_s: float | None) -> tuple[int, int]:
    """Return GPS week and milliseconds of the week, zeros if unknown."""
    if utc_s is None or not GPS_EPOCH_S <= utc_s < MAX_UTC_S:
        return 0, 0
    week, rest_s = divmod(utc_s - GPS_EPOCH_S + LEAP_SECONDS, WEEK_S)
    return int(week), int(rest_s * 1e3)


def _bounded(value: float | None, factor: float, largest: int) -> int:
    """Scale to an integer within 0 to largest, 0 if absent."""
    if value is None or not value > 0.0:
        return 0
    return int(min(value * factor, float(largest)))
