"""Strict readers of single fields of an NMEA sentence: a field is empty (None), a value in range, or an error.

Unlike `float()`, they reject "nan", "1e999", "1_0" and " 7".
"""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable, Mapping, Sequence

from firmware_py.common.angles import METRES_PER_SECOND_PER_KNOT
from firmware_py.common.calendar import full_year
from firmware_py.sensors.message_error import MALFORMED, RANGE, MessageError, check_range

Fields = Sequence[str]
Reader = Callable[[Fields], float | None]

SECONDS_PER_DAY = 86400
MAX_SPEED_M_S = 200.0
MIN_YEAR = 1980  # start of GPS time: a receiver without a date reports it
_EPOCH_ORDINAL = dt.date(1970, 1, 1).toordinal()
_METRES_PER_SECOND = {"N": METRES_PER_SECOND_PER_KNOT, "K": 1.0 / 3.6, "M": 1.0, "S": 0.44704}

_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,9}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})")
# Some plotters print the integer and the fraction of a negative number separately: "0.-6" is -0.6, "-1.-2" is -1.2.
_SPLIT_NEGATIVE = re.compile(r"(?:0|-([0-9]{1,9}))\.-([0-9]{1,12})")
_LATITUDE = re.compile(r"([0-9]{2})([0-9]{2}(?:\.[0-9]{0,10})?)")
# Some receivers print two digits of degrees below 100; minutes always have two, so this is not ambiguous.
_LONGITUDE = re.compile(r"([0-9]{2,3})([0-9]{2}(?:\.[0-9]{0,10})?)")
_TIME = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2}(?:\.[0-9]{0,9})?)")
_DATE = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})")


def to_number(text: str) -> float | None:
    """Read a decimal number; None if empty; raises MessageError."""
    if not text:
        return None
    if _NUMBER.fullmatch(text):
        return float(text)
    negative = _SPLIT_NEGATIVE.fullmatch(text)
    if negative:
        return -float(f"{negative[1] or 0}.{negative[2]}")
    raise MessageError(MALFORMED, "not a number")


def number_field(index: int, low: float, high: float, *, unit: str = "", scale: float = 1.0) -> Reader:
    """Return a reader of a number in [low, high]; it returns the number times `scale`.

    With `unit`, the next field must be that letter.
    """

    def read(fields: Fields) -> float | None:
        value = to_number(fields[index])
        if value is None:
            return None
        if unit and fields[index + 1] != unit:
            raise MessageError(MALFORMED, f"unit is not {unit}")
        return check_range(value, low, high) * scale

    return read


def speed_field(index: int, unit: str = "") -> Reader:
    """Return a reader of a speed in m/s; the unit letter (N, K, M or S) is `unit` or the next field."""

    def read(fields: Fields) -> float | None:
        value = to_number(fields[index])
        if value is None:
            return None
        factor = _METRES_PER_SECOND.get(unit or fields[index + 1])
        if factor is None:
            raise MessageError(MALFORMED, "not a unit of speed")
        return check_range(value * factor, 0.0, MAX_SPEED_M_S)

    return read


def signed_field(index: int, limit: float, signs: Mapping[str, float]) -> Reader:
    """Return a reader of a magnitude up to `limit` with its sign letter in the next field; zero needs none."""

    def read(fields: Fields) -> float | None:
        value = to_number(fields[index])
        if value is None:
            return None
        sign = signs.get(fields[index + 1])
        if sign is None:
            if value == 0.0 and not fields[index + 1]:
                return 0.0
            raise MessageError(MALFORMED, f"direction is not {' or '.join(signs)}")
        return sign * check_range(value, 0.0, limit)

    return read


def _coordinate_field(index: int, pattern: re.Pattern[str], limit_deg: float, signs: Mapping[str, float]) -> Reader:
    def read(fields: Fields) -> float | None:
        if not fields[index]:
            return None
        match = pattern.fullmatch(fields[index])
        sign = signs.get(fields[index + 1])
        if match is None or sign is None:
            raise MessageError(MALFORMED, "not degrees and minutes")
        minutes = float(match[2])
        if minutes >= 60.0:
            raise MessageError(RANGE, "minutes out of range")
        return sign * check_range(float(match[1]) + minutes / 60.0, 0.0, limit_deg)

    return read


def latitude_field(index: int) -> Reader:
    """Return a reader of ddmm.mmm and N or S in the next field as degrees, north positive."""
    return _coordinate_field(index, _LATITUDE, 90.0, {"N": 1.0, "S": -1.0})


def longitude_field(index: int) -> Reader:
    """Return a reader of dddmm.mmm or ddmm.mmm and E or W in the next field as degrees, east positive."""
    return _coordinate_field(index, _LONGITUDE, 180.0, {"E": 1.0, "W": -1.0})


def time_of_day_field(index: int) -> Reader:
    """Return a reader of hhmmss.sss as seconds since midnight UTC; a leap second is allowed."""

    def read(fields: Fields) -> float | None:
        if not fields[index]:
            return None
        match = _TIME.fullmatch(fields[index])
        if match is None:
            raise MessageError(MALFORMED, "not a time")
        hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3])
        if hours > 23 or minutes > 59 or seconds >= 61.0:
            raise MessageError(RANGE, "time out of range")
        return hours * 3600 + minutes * 60 + seconds

    return read


def short_date_field(time_index: int, date_index: int) -> Reader:
    """Return a reader of a time and ddmmyy as seconds since 1970-01-01 UTC; the century is that of `full_year`.

    An invalid date gives None, because the position in the same sentence is still valid.
    """
    read_time = time_of_day_field(time_index)

    def read(fields: Fields) -> float | None:
        seconds = read_time(fields)
        match = _DATE.fullmatch(fields[date_index])
        if match is None:
            return None
        try:
            return _compute_utc_s(full_year(int(match[3])), int(match[2]), int(match[1]), seconds)
        except MessageError:
            return None

    return read


def long_date_field(time_index: int, day_index: int) -> Reader:
    """Return a reader of a time and the fields day, month, year (1980 to 2099) as seconds since 1970-01-01 UTC.

    An empty field or a date of zeros gives None; another invalid date raises MessageError.
    """
    read_time = time_of_day_field(time_index)

    def read(fields: Fields) -> float | None:
        seconds = read_time(fields)
        parts = fields[day_index : day_index + 3]
        if not all(parts) or not any(part.strip("0") for part in parts):
            return None
        day, month, year = (int(check_range(to_number(part) or 0.0, 1, 9999)) for part in parts)
        return _compute_utc_s(year, month, day, seconds)

    return read


def _compute_utc_s(year: int, month: int, day: int, seconds: float | None) -> float | None:
    try:
        days = dt.date(year, month, day).toordinal() - _EPOCH_ORDINAL
    except ValueError:
        raise MessageError(RANGE, "date out of range") from None
    check_range(year, MIN_YEAR, 2099)
    return None if seconds is None else days * SECONDS_PER_DAY + seconds
