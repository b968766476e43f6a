"""Driver of a flight controller (ArduPilot, PX4) as position sensor, over MAVLink.

Source: the definitions of GPS_RAW_INT, GLOBAL_POSITION_INT and SYSTEM_TIME in common.xml.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from msgspec.structs import replace

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.calendar import LAST_UTC_S
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.geodesy import is_possible_position
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import option
from firmware_py.common.records import DeviceRole, FixType, PositionSample
from firmware_py.sensors.mavlink_board import (
    POSITION_COMPONENT,
    MavlinkDevice,
    MavlinkOptions,
    Wanted,
)
from firmware_py.sensors.mavlink_frames import Frame, Message, Stream
from firmware_py.sensors.message_error import check_range

TIME_RATE_HZ = 1.0
MAX_TIME_AGE_S = 3.0  # of SYSTEM_TIME
MAX_FIX_AGE_S = 3.0  # of GPS_RAW_INT, for positions of the estimator
MAX_POSITION_ERROR_M = 50.0  # assumed by estimate.position; exceeded after a cold start or under jamming

_UNKNOWN_U16, _UNKNOWN_U8 = 0xFFFF, 0xFF
_MIN_UTC_S = 946_684_800.0  # 2000; a clock that is not set starts in 1970
# GPS_FIX_TYPE; 7 (static) is that of a base station, 8 a precise point position.
_FIX_TYPES: Mapping[int, FixType] = {
    2: FixType.FIX_2D,
    3: FixType.FIX_3D,
    4: FixType.DGPS,
    5: FixType.RTK_FLOAT,
    6: FixType.RTK_FIXED,
    8: FixType.FIX_3D,
}


@dataclass(frozen=True, slots=True)
class MavlinkPositionOptions(MavlinkOptions):
    """Options of the vehicle file for a flight controller as position sensor; raises ValueError."""

    rate_hz: int = option("fixes per second, an integer", default=1, minimum=1, maximum=10)
    solution: str = option(
        "position and velocity of the GNSS receiver, or of the estimator while the receiver has a fix",
        default="receiver",
        choices=("receiver", "estimator"),
    )


class MavlinkPosition(MavlinkDevice[PositionSample]):
    """Returns one sample for each new GPS_RAW_INT, or for each GLOBAL_POSITION_INT (`solution` estimator).

    The estimator of a flight controller continues without a receiver for some time, and does not say so in
    GLOBAL_POSITION_INT. So its position counts as a fix only while GPS_RAW_INT reports one. A GPS_RAW_INT with the
    time stamp of the previous one is an old measurement and gives no sample. The time is that of SYSTEM_TIME. Every
    message that gives a sample counts as accepted, also one without a fix.
    """

    def __init__(self, line: ByteLine, options: MavlinkPositionOptions) -> None:
        """Store line and options."""
        self._uses_estimator = options.solution == "estimator"
        wanted = [
            Wanted(Message.GPS_RAW_INT, options.rate_hz, Stream.EXTENDED_STATUS),
            Wanted(Message.SYSTEM_TIME, TIME_RATE_HZ, Stream.EXTRA3),
        ]
        if self._uses_estimator:
            wanted.append(Wanted(Message.GLOBAL_POSITION_INT, options.rate_hz, Stream.POSITION))
        super().__init__(line, options, DeviceRole.POSITION, POSITION_COMPONENT, wanted)
        self._forget()

    def _forget(self) -> None:
        self._fix: PositionSample | None = None  # of the last GPS_RAW_INT
        self._fix_time_us = 0
        self._utc: tuple[float, float] | None = None  # UTC, and time of its arrival

    def _handle(self, frame: Frame, now_s: float) -> None:
        self._monitor.note_unused("connected, no position yet")
        if frame.message is Message.SYSTEM_TIME:
            utc_s = frame.fields[0] * 1e-6
            self._utc = (utc_s, now_s) if _MIN_UTC_S <= utc_s <= LAST_UTC_S else None
        elif frame.message is Message.GPS_RAW_INT:
            time_us = frame.fields[0]
            if time_us != 0 and time_us == self._fix_time_us:
                return
            self._fix_time_us = time_us
            self._fix = read_fix(frame.fields, now_s)
            if not self._uses_estimator:
                self._add(self._fix, now_s)
        elif frame.message is Message.GLOBAL_POSITION_INT and self._uses_estimator:
            self._add(self._combine(frame.fields, now_s), now_s)

    def _combine(self, fields: tuple[int, ...], now_s: float) -> PositionSample:
        """Return the position of the estimator with the quality of the last fix."""
        fix = self._fix
        if fix is None or now_s - fix.t_s > MAX_FIX_AGE_S or fix.fix is FixType.NONE:
            return PositionSample(now_s, FixType.NONE)
        position = read_estimate(fields, now_s)
        return replace(position, fix=fix.fix, satellites=fix.satellites, hdop=fix.hdop)

    def _add(self, sample: PositionSample, now_s: float) -> None:
        self._monitor.accept(now_s)
        text = "no fix"
        if sample.latitude_rad is not None and sample.longitude_rad is not None:
            text = ""
            if not is_possible_position(sample.latitude_rad, sample.longitude_rad):
                text = "position invalid: no fix"
                sample = PositionSample(now_s, FixType.NONE, satellites=sample.satellites)
        self._monitor.note(text or self._board.other_text)
        if self._utc is not None and sample.fix is not FixType.NONE and now_s - self._utc[1] <= MAX_TIME_AGE_S:
            sample = replace(sample, utc_s=self._utc[0] + now_s - self._utc[1])
        self._samples.append(sample)


def read_fix(fields: tuple[int, ...], now_s: float) -> PositionSample:
    """Return the sample of a GPS_RAW_INT; raises MessageError for a value that is out of range.

    A fix whose stated accuracy (h_acc, 0: unknown) is worse than MAX_POSITION_ERROR_M is none.
    """
    # In 1e-7 deg, mm, 0.01 (eph: HDOP), cm/s, 0.01 deg, mm (h_acc).
    _, lat, lon, alt, eph, _, vel, cog, fix_type, visible, _, h_acc, *_ = fields
    fix = _FIX_TYPES.get(fix_type, FixType.NONE)
    satellites = None if visible == _UNKNOWN_U8 else visible
    if fix is FixType.NONE or h_acc * 1e-3 > MAX_POSITION_ERROR_M:
        return PositionSample(now_s, FixType.NONE, satellites=satellites)
    return PositionSample(
        t_s=now_s,
        fix=fix,
        latitude_rad=_read_latitude_rad(lat),
        longitude_rad=_read_longitude_rad(lon),
        altitude_m=alt * 1e-3,
        speed_over_ground_m_s=None if vel == _UNKNOWN_U16 else check_range(vel * 1e-2, 0.0, 200.0, "speed"),
        course_over_ground_rad=None
        if cog == _UNKNOWN_U16
        else wrap_two_pi(radians(check_range(cog * 1e-2, 0.0, 360.0, "course"))),
        satellites=satellites,
        hdop=None if eph in (0, _UNKNOWN_U16) else eph * 1e-2,
    )


def read_estimate(fields: tuple[int, ...], now_s: float) -> PositionSample:
    """Return the position and velocity of a GLOBAL_POSITION_INT, whose fix is not known; raises MessageError."""
    _, lat, lon, alt, _, north_cm_s, east_cm_s, *_ = fields
    return PositionSample(
        t_s=now_s,
        fix=FixType.NONE,
        latitude_rad=_read_latitude_rad(lat),
        longitude_rad=_read_longitude_rad(lon),
        altitude_m=alt * 1e-3,
        speed_over_ground_m_s=check_range(math.hypot(north_cm_s, east_cm_s) * 1e-2, 0.0, 200.0, "speed"),
        course_over_ground_rad=wrap_two_pi(math.atan2(east_cm_s, north_cm_s)),
    )


def _read_latitude_rad(value: int) -> float:
    return radians(check_range(value * 1e-7, -90.0, 90.0, "latitude"))


def _read_longitude_rad(value: int) -> float:
    return radians(check_range(value * 1e-7, -180.0, 180.0, "longitude"))


DRIVER = Driver(
    interface=INTERFACE,
    device="flight controllers (ArduPilot, PX4) over MAVLink",
    options=MavlinkPositionOptions,
    make=MavlinkPosition,
    writes=True,
)
