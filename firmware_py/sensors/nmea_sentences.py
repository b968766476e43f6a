"""The table of NMEA 0183 sentences and their fields.

pynmeagps, which has longer tables, is used by the tests only: it raises errors for real sentences that this table
reads ("0.-6", an XDR of misaligned groups), accepts "1e5" and " 7" as numbers, checks no range, and needs 19 us for an
HDT, 27 us for an HDG and 84 us for an RMC; framing and decoding by this package needs 9, 12 and 21 us.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from firmware_py.sensors.message_error import MALFORMED, MessageError
from firmware_py.sensors.nmea_fields import (
    Fields,
    Reader,
    latitude_field,
    long_date_field,
    longitude_field,
    number_field,
    short_date_field,
    signed_field,
    speed_field,
    time_of_day_field,
)
from firmware_py.sensors.nmea_framing import Sentence
from firmware_py.sensors.nmea_transducers import read_transducers

Numbers = Mapping[str, float | None]


class DecodedSentence(msgspec.Struct, frozen=True):
    """The values of a sentence: numbers (None for an empty field), letters, unknown transducers."""

    topic: str
    numbers: Numbers
    letters: Mapping[str, str]
    unknown: tuple[str, ...] = ()


class Layout(msgspec.Struct, frozen=True):
    """Fields of one kind of sentence: topic, minimum number of fields, name and reader of each number.

    `derived` are names of further numbers and functions that compute them from those that were read.
    """

    topic: str
    min_fields: int
    numbers: tuple[tuple[str, Reader], ...]
    letters: tuple[tuple[str, int], ...] = ()  # name and index of the field; a missing field is read as empty
    derived: tuple[tuple[str, Callable[[Numbers], float | None]], ...] = ()
    applies: Callable[[Fields], bool] | None = None  # False: another sentence with the same address


_EAST_WEST = {"E": 1.0, "W": -1.0}


def _compute_hdg_magnetic(numbers: Numbers) -> float | None:
    """Return the sensor heading plus deviation, east positive; an unknown deviation counts as 0."""
    sensor_deg = numbers["sensor_deg"]
    return None if sensor_deg is None else (sensor_deg + (numbers["deviation_deg"] or 0.0)) % 360.0


def _compute_hdg_true(numbers: Numbers) -> float | None:
    """Return the magnetic heading plus variation, east positive; None without a variation."""
    magnetic_deg, variation_deg = _compute_hdg_magnetic(numbers), numbers["variation_deg"]
    return None if magnetic_deg is None or variation_deg is None else (magnetic_deg + variation_deg) % 360.0


def _first_value_field(*readers: Reader) -> Reader:
    """Return a reader that returns the value of the first reader whose field is not empty."""

    def read(fields: Fields) -> float | None:
        return next((value for reader in readers if (value := reader(fields)) is not None), None)

    return read


def _relative_angle_field(index: int) -> Reader:
    """Return a reader of an angle up to 180 degrees and R or L as 0 to 360, clockwise from the bow."""
    read_side = signed_field(index, 180.0, {"R": 1.0, "L": -1.0})

    def read(fields: Fields) -> float | None:
        angle_deg = read_side(fields)
        return None if angle_deg is None else angle_deg % 360.0

    return read


def _depth_layout(name: str) -> Layout:
    """Return the layout of a depth in feet, metres and fathoms."""
    metres = number_field(2, 0.0, 12e3, unit="M")
    feet, fathoms = number_field(0, 0.0, 4e4, unit="f", scale=0.3048), number_field(4, 0.0, 7e3, unit="F", scale=1.8288)
    return Layout("depth", 6, ((name, _first_value_field(metres, feet, fathoms)),))


def _depth_with_offset(sign: float) -> Callable[[Numbers], float | None]:
    """Return a function that adds an offset with this sign to a depth below the transducer, else returns None.

    A positive offset gives the depth below the surface, a negative one the depth below the keel.
    """

    def derive(numbers: Numbers) -> float | None:
        depth_m, offset_m = numbers["depth_below_transducer_m"], numbers["offset_m"]
        return None if depth_m is None or offset_m is None or sign * offset_m <= 0.0 else depth_m + offset_m

    return derive


def _position_fields(latitude_index: int) -> tuple[tuple[str, Reader], ...]:
    return (("lat_deg", latitude_field(latitude_index)), ("lon_deg", longitude_field(latitude_index + 2)))


_FIX_QUALITY = (
    ("satellites", number_field(6, 0, 255)),
    ("hdop", number_field(7, 0.0, 1e4)),
    ("altitude_m", number_field(8, -1e3, 1e5)),
)
_TRUE_HEADING = ("heading_true_deg", number_field(0, 0.0, 360.0, unit="T"))
_CROSS_TRACK = ("cross_track_m", number_field(2, 0.0, 1e4, scale=1852.0))
_TIME_IN_FIRST_FIELD = ("time_of_day_s", time_of_day_field(0))
_RELATIVE_WIND = Layout(
    "wind",
    8,
    (
        ("wind_angle_deg", _relative_angle_field(0)),
        ("wind_speed_m_s", _first_value_field(speed_field(2), speed_field(4), speed_field(6))),
    ),
)
_PRESSURE = _first_value_field(
    number_field(2, 0.5, 1.5, unit="B", scale=1e5), number_field(0, 14.0, 45.0, unit="I", scale=3386.389)
)

TABLE: Mapping[str, Layout] = {
    "HDG": Layout(
        "heading",
        5,
        (
            ("sensor_deg", number_field(0, 0.0, 360.0)),
            ("deviation_deg", signed_field(1, 180.0, _EAST_WEST)),
            ("variation_deg", signed_field(3, 180.0, _EAST_WEST)),
        ),
        derived=(("heading_magnetic_deg", _compute_hdg_magnetic), ("heading_true_deg", _compute_hdg_true)),
    ),
    "HDT": Layout("heading", 2, (_TRUE_HEADING,)),
    "HDM": Layout("heading", 2, (("heading_magnetic_deg", number_field(0, 0.0, 360.0, unit="M")),)),
    "THS": Layout("heading", 2, (("heading_true_deg", number_field(0, 0.0, 360.0)),), (("mode", 1),)),
    # $PASHR,hhmmss.sss,heading,T,roll,pitch,heave,...; Ashtech has other sentences of that name.
    "PASHR": Layout(
        "heading",
        6,
        (
            ("heading_true_deg", number_field(1, 0.0, 360.0, unit="T")),
            ("roll_deg", number_field(3, -180.0, 180.0)),
            ("pitch_deg", number_field(4, -90.0, 90.0)),
            ("heave_m", number_field(5, -100.0, 100.0)),
        ),
        applies=lambda fields: len(fields) > 2 and fields[2] == "T",
    ),
    # Degrees per minute, positive to starboard; the limit is 60 degrees per second.
    "ROT": Layout("turn_rate", 2, (("turn_rate_deg_min", number_field(0, -3600.0, 3600.0)),), (("status", 1),)),
    "RSA": Layout("rudder", 2, (("rudder_deg", number_field(0, -90.0, 90.0)),), (("status", 1),)),
    "XDR": Layout("transducer", 3, ()),  # nmea_transducers.py
    "RMC": Layout(
        "position",
        9,
        (
            _TIME_IN_FIRST_FIELD,
            ("utc_s", short_date_field(0, 8)),
            *_position_fields(2),
            ("sog_m_s", speed_field(6, "N")),
            ("cog_deg", number_field(7, 0.0, 360.0)),
        ),
        (("status", 1), ("mode", 11)),
    ),
    "GGA": Layout(
        "position",
        9,
        (_TIME_IN_FIRST_FIELD, *_position_fields(1), ("quality", number_field(5, 0, 9)), *_FIX_QUALITY),
    ),
    "GNS": Layout("position", 9, (_TIME_IN_FIRST_FIELD, *_position_fields(1), *_FIX_QUALITY), (("mode", 5),)),
    "GLL": Layout(
        "position", 6, (("time_of_day_s", time_of_day_field(4)), *_position_fields(0)), (("status", 5), ("mode", 6))
    ),
    "VTG": Layout(
        "course",
        8,
        (("cog_deg", number_field(0, 0.0, 360.0, unit="T")), ("sog_m_s", speed_field(4))),
        (("mode", 8),),
    ),
    "ZDA": Layout("time", 4, (_TIME_IN_FIRST_FIELD, ("utc_s", long_date_field(0, 1)))),
    "VHW": Layout(
        "water_speed",
        6,
        (
            _TRUE_HEADING,
            ("heading_magnetic_deg", number_field(2, 0.0, 360.0, unit="M")),
            ("water_speed_m_s", speed_field(4)),
        ),
    ),
    # Steering commands of a plotter; the letter is the side to steer to.
    "XTE": Layout("steering", 5, (_CROSS_TRACK,), (("steer_to", 3), ("status", 0))),
    "APB": Layout(
        "steering",
        14,
        (_CROSS_TRACK, ("heading_to_steer_deg", number_field(12, 0.0, 360.0))),
        (("steer_to", 3), ("reference", 13), ("status", 0)),
    ),
    "MWV": Layout(
        "wind",
        5,
        (("wind_angle_deg", number_field(0, 0.0, 360.0)), ("wind_speed_m_s", speed_field(2))),
        (("reference", 1), ("status", 4)),
    ),
    "MWD": Layout(
        "wind",
        8,
        (
            ("wind_from_true_deg", number_field(0, 0.0, 360.0, unit="T")),
            ("wind_from_magnetic_deg", number_field(2, 0.0, 360.0, unit="M")),
            ("wind_speed_m_s", _first_value_field(speed_field(4), speed_field(6))),
        ),
    ),
    "MDA": Layout(
        "weather",
        20,
        (
            ("air_pressure_pa", _PRESSURE),
            ("air_temperature_c", number_field(4, -100.0, 100.0, unit="C")),
            ("water_temperature_c", number_field(6, -10.0, 100.0, unit="C")),
            ("humidity_percent", number_field(8, 0.0, 100.0)),
            ("dew_point_c", number_field(10, -100.0, 100.0, unit="C")),
            ("wind_from_true_deg", number_field(12, 0.0, 360.0, unit="T")),
            ("wind_from_magnetic_deg", number_field(14, 0.0, 360.0, unit="M")),
            ("wind_speed_m_s", speed_field(18)),
        ),
    ),
    "VWR": _RELATIVE_WIND,
    "VWT": _RELATIVE_WIND,
    "MTW": Layout("weather", 2, (("water_temperature_c", number_field(0, -10.0, 100.0, unit="C")),)),
    "MTA": Layout("weather", 2, (("air_temperature_c", number_field(0, -100.0, 100.0, unit="C")),)),
    "MMB": Layout("weather", 4, (("air_pressure_pa", _PRESSURE),)),
    "MHU": Layout(
        "weather",
        4,
        (("humidity_percent", number_field(0, 0.0, 100.0)), ("dew_point_c", number_field(2, -100.0, 100.0, unit="C"))),
    ),
    "DPT": Layout(
        "depth",
        2,
        (("depth_below_transducer_m", number_field(0, 0.0, 12e3)), ("offset_m", number_field(1, -100.0, 100.0))),
        derived=(("depth_below_surface_m", _depth_with_offset(1.0)), ("depth_below_keel_m", _depth_with_offset(-1.0))),
    ),
    "DBT": _depth_layout("depth_below_transducer_m"),
    "DBS": _depth_layout("depth_below_surface_m"),
    "DBK": _depth_layout("depth_below_keel_m"),
}
# Sentences that the autopilot does not use, and their content.
IGNORED: Mapping[str, str] = {
    kind: text
    for text, kinds in {
        "satellites in use and in view": "GSA GSV",
        "estimated errors of a position": "GST GBS GRS PGRME",
        "datum": "DTM PGRMM",
        "route of a plotter": "RMB BOD BWC BWR AAM WPL RTE HSC",
        "speed by axis and to windward, distance sailed, set and drift": "VBW VPW VLW VDR",
        "radar targets": "TTM TLL",
        "texts and alarms of an instrument": "TXT ALR",
        "engine": "RPM",
        "commands to an Airmar instrument and its replies": "PAMTC PAMTR PAMTX",
        "reports of a u-blox receiver": "PUBX",
    }.items()
    for kind in kinds.split()
}


def decode_sentence(sentence: Sentence) -> DecodedSentence | None:
    """Return the values of a sentence without fault; None for a kind that is not in the table.

    Raises MessageError for an invalid field.
    """
    layout = TABLE.get(sentence.kind)
    fields = sentence.fields
    if layout is None or (layout.applies and not layout.applies(fields)):
        return None
    if len(fields) < layout.min_fields:
        raise MessageError(MALFORMED, f"{sentence.address}: {len(fields)} fields")
    numbers: dict[str, float | None] = {}
    unknown: tuple[str, ...] = ()
    name = ""
    try:
        for name, read in layout.numbers:
            numbers[name] = read(fields)
        if sentence.kind == "XDR":
            numbers, unknown = read_transducers(fields)
    except MessageError as error:
        text = f"{name} {error}".lstrip()
        raise MessageError(error.error, f"{sentence.address}: {text}") from None
    for name, derive in layout.derived:
        numbers[name] = derive(numbers)
    letters = {name: fields[index] if index < len(fields) else "" for name, index in layout.letters}
    return DecodedSentence(layout.topic, numbers, letters, unknown)
