"""Driver of a GNSS receiver on an NMEA 2000 bus."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.calendar import LAST_UTC_S
from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.geodesy import is_possible_position
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceRole, FixType, PositionSample
from firmware_py.sensors.nmea2000_device import Nmea2000Device, numbers_of
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_layout import Values
from firmware_py.sensors.nmea2000_reader import Nmea2000Options

SYSTEM_TIME, POSITION, COURSE, GNSS_POSITION = 126992, 129025, 129026, 129029
SOURCE_TIMEOUT_S = 5.0  # then another device may become the source
GNSS_TIMEOUT_S = 3.0  # without PGN 129029, whose interval is 1 s, each PGN 129025 is a fix
COURSE_HOLD_S = 1.0  # the standard interval is 0.25 s
TIME_HOLD_S = 2.5  # the standard interval of PGN 126992 is 1 s
MAX_REPEATED_TIME_S = 3.0  # a hanging receiver repeats a time for longer
MAX_SPEED_M_S = 200.0
MIN_ALTITUDE_M, MAX_ALTITUDE_M = -1e3, 1e5
MIN_UTC_S = 315_532_800.0  # 1980-01-01
_SECONDS_PER_DAY = 86_400
_TRUE = 0  # reference of the course
_UNSAFE = 3  # integrity

# Field `method`; estimated (6), manual (7) and simulated (8) positions are not used.
_FIXES: Mapping[float | int | None, FixType] = {
    1: FixType.FIX_3D,
    2: FixType.DGPS,
    3: FixType.FIX_3D,
    4: FixType.RTK_FIXED,
    5: FixType.RTK_FLOAT,
}


class Nmea2000Position(Nmea2000Device[PositionSample]):
    """Returns one sample per PGN 129029 of one device, with the latest course and speed (129026) of the device.

    PGN 129029 states how the position was measured. A receiver that does not send it gives one sample per PGN 129025
    instead, as a fix without altitude, with the time of PGN 126992. Every position message of the device that is used
    counts as accepted, also one without a fix. A device without a fix for SOURCE_TIMEOUT_S is
    replaced by another one that has a fix.
    """

    def __init__(self, line: ByteLine, options: Nmea2000Options) -> None:
        """Store line and options."""
        pgns = (SYSTEM_TIME, POSITION, COURSE, GNSS_POSITION)
        super().__init__(line, options, DeviceRole.POSITION, "position", pgns, SOURCE_TIMEOUT_S)
        self._forget(0.0)

    def _forget(self, now_s: float) -> None:
        """Discard the values of the previous device."""
        self._gnss_s = now_s  # time of the last PGN 129029; before the first one, of the start of the wait for it
        self._course: tuple[float, float | None, float | None] = (now_s, None, None)  # time, course [rad], speed [m/s]
        self._utc: tuple[float, float] | None = None  # time, UTC of PGN 126992
        self._last_utc: tuple[float, float] | None = None  # the last UTC of a fix, and when it first arrived

    def _handle_message(self, message: Message, now_s: float) -> None:
        pgn, values = message.pgn, numbers_of(message)
        if pgn in (SYSTEM_TIME, COURSE):
            if message.source == self._selection.address:
                self._note_values(pgn, values, now_s)
            return
        is_gnss, is_selected = pgn == GNSS_POSITION, message.source == self._selection.address
        if is_selected and is_gnss:
            self._gnss_s = now_s
        elif is_selected and now_s - self._gnss_s <= GNSS_TIMEOUT_S:
            return
        fix = _FIXES.get(values["method"], FixType.NONE) if is_gnss else FixType.FIX_2D
        utc_s = utc_of(values) if is_gnss else None
        reason = _find_fault(values, fix)
        if not reason and is_selected and self._is_time_frozen(utc_s, now_s):
            reason = "time not advancing: no fix"
        if not (self._is_reported(message) if reason else self._is_used(message, now_s)):
            return
        self._monitor.accept(now_s)
        self._monitor.note(reason)
        if reason:
            satellites = _to_int(values.get("number_of_svs"))
            self._samples.append(PositionSample(now_s, FixType.NONE, satellites=satellites))
        elif is_gnss or is_selected:
            if not is_selected:
                self._is_time_frozen(utc_s, now_s)  # stores the first UTC of the device
            self._append(values, fix, utc_s, now_s)

    def _note_values(self, pgn: int, values: Values, now_s: float) -> None:
        """Store course and speed, or the time."""
        if pgn == SYSTEM_TIME:
            utc_s = utc_of(values)
            self._utc = None if utc_s is None else (now_s, utc_s)
        else:
            speed_m_s, course_rad = values["sog_m_s"], values["cog_rad"]
            is_true = values["cog_reference"] == _TRUE
            self._course = (
                now_s,
                wrap_two_pi(course_rad) if is_true and course_rad is not None else None,
                speed_m_s if speed_m_s is not None and speed_m_s <= MAX_SPEED_M_S else None,
            )

    def _append(self, values: Values, fix: FixType, utc_s: float | None, now_s: float) -> None:
        """Append the sample of a valid position."""
        latitude_deg, longitude_deg = values["latitude_deg"] or 0.0, values["longitude_deg"] or 0.0
        altitude_m, hdop = values.get("altitude_m"), values.get("hdop")
        if altitude_m is not None and not MIN_ALTITUDE_M <= altitude_m <= MAX_ALTITUDE_M:
            altitude_m = None
        course_s, course_rad, speed_m_s = self._course
        has_course = now_s - course_s <= COURSE_HOLD_S
        self._samples.append(
            PositionSample(
                t_s=now_s,
                fix=FixType.FIX_2D if fix is FixType.FIX_3D and altitude_m is None else fix,
                latitude_rad=radians(latitude_deg),
                longitude_rad=radians(longitude_deg),
                altitude_m=altitude_m,
                speed_over_ground_m_s=speed_m_s if has_course else None,
                course_over_ground_rad=course_rad if has_course else None,
                satellites=_to_int(values.get("number_of_svs")),
                hdop=hdop if hdop is not None and hdop >= 0.0 else None,
                utc_s=self._system_utc_s(now_s) if utc_s is None else utc_s,
            )
        )

    def _system_utc_s(self, now_s: float) -> float | None:
        """Return the UTC of now by the last PGN 126992, None if that is too old."""
        if self._utc is None or now_s - self._utc[0] > TIME_HOLD_S:
            return None
        return self._utc[1] + now_s - self._utc[0]

    def _is_time_frozen(self, utc_s: float | None, now_s: float) -> bool:
        """Store the time of a PGN 129029; return whether it has not advanced for MAX_REPEATED_TIME_S."""
        if utc_s is None:
            return False
        if self._last_utc is None or self._last_utc[0] != utc_s:
            self._last_utc = (utc_s, now_s)
        return now_s - self._last_utc[1] > MAX_REPEATED_TIME_S


def _find_fault(values: Values, fix: FixType) -> str:
    """Return why a message has no valid position, empty if it has one."""
    latitude_deg, longitude_deg = values["latitude_deg"], values["longitude_deg"]
    if fix is FixType.NONE or latitude_deg is None or longitude_deg is None:
        return "no fix"
    if not is_possible_position(radians(latitude_deg), radians(longitude_deg)):
        return "position invalid: no fix"
    return "integrity unsafe: no fix" if values.get("integrity") == _UNSAFE else ""


def utc_of(values: Values) -> float | None:
    """Return the UTC of the date (days since 1970-01-01) and time (since midnight); None before 1980, after 2099."""
    days, time_s = values["date_days"], values["time_s"]
    if days is None or time_s is None:
        return None
    utc_s = days * _SECONDS_PER_DAY + time_s
    return utc_s if MIN_UTC_S <= utc_s <= LAST_UTC_S else None


def _to_int(value: float | None) -> int | None:
    return None if value is None else int(value)


DRIVER = Driver(
    interface=INTERFACE,
    device="GNSS receivers on an NMEA 2000 bus (PGN 129029, 129025, 129026, 126992), by a gateway or SocketCAN",
    options=Nmea2000Options,
    make=Nmea2000Position,
    reads_can=True,
)
