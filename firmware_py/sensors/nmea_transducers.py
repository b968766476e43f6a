"""The transducers of XDR: the quantity of each group of type, value, unit and name.

Names are those of NMEA 0183 4.11 and of the instruments and programs that docs/reference/nmea-sentences.md lists.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from firmware_py.sensors.message_error import MALFORMED, MessageError, check_range
from firmware_py.sensors.nmea_fields import Fields, to_number

MAX_NAME_CHARACTERS = 20  # of an unknown transducer in a report


class Quantity(NamedTuple):
    """A quantity: transducer type, allowed range and names in capitals; "" for a group without a name.

    Types: A angle, C temperature, H humidity, P pressure, S speed.
    """

    kind: str
    low: float
    high: float
    names: tuple[str, ...]


QUANTITIES: Mapping[str, Quantity] = {
    "pitch_deg": Quantity("A", -180.0, 180.0, ("PTCH", "PITCH")),
    "roll_deg": Quantity("A", -180.0, 180.0, ("ROLL",)),
    "heel_deg": Quantity("A", -180.0, 180.0, ("HEEL",)),
    "trim_deg": Quantity("A", -90.0, 90.0, ("TRIM",)),
    "yaw_deg": Quantity("A", -360.0, 360.0, ("YAW",)),
    "leeway_deg": Quantity("A", -180.0, 180.0, ("LEEWAY",)),
    "rudder_deg": Quantity("A", -90.0, 90.0, ("RUDDER",)),
    "wind_angle_deg": Quantity("A", 0.0, 360.0, ("1",)),
    "wind_speed_m_s": Quantity("S", 0.0, 200.0, ("1",)),
    "air_temperature_c": Quantity(
        "C", -100.0, 100.0, ("AIRTEMP", "TEMPAIR", "AIR", "TEMP", "TE", "ENV_OUTAIR_T", "ENV_OUTSIDE_T", "0", "")
    ),
    "inside_temperature_c": Quantity("C", -100.0, 100.0, ("ENV_INSIDE_T", "1")),
    "water_temperature_c": Quantity("C", -10.0, 100.0, ("ENV_WATER_T", "SEA_T")),
    "wind_chill_relative_c": Quantity("C", -150.0, 100.0, ("WCHR",)),
    "wind_chill_theoretical_c": Quantity("C", -150.0, 100.0, ("WCHT",)),
    "heat_index_c": Quantity("C", -150.0, 150.0, ("HINX",)),
    "air_pressure_pa": Quantity(
        "P", 5e4, 1.5e5, ("STNP", "BARO", "BAROMETER", "PRESSURE", "ENV_ATMOS_P", "P", "0", "")
    ),
    "humidity_percent": Quantity("H", 0.0, 100.0, ("AIR", "HUMIDITY", "RH", "ENV_OUTSIDE_H", "0", "")),
    "inside_humidity_percent": Quantity("H", 0.0, 100.0, ("ENV_INSIDE_H",)),
}  # fmt: skip
# Factor and offset that convert a value to the unit of the quantity, by transducer type and unit letter.
UNITS: Mapping[tuple[str, str], tuple[float, float]] = {
    ("A", "D"): (1.0, 0.0),
    ("C", "C"): (1.0, 0.0),
    ("C", "K"): (1.0, -273.15),
    ("C", "F"): (5.0 / 9.0, -160.0 / 9.0),
    ("H", "P"): (1.0, 0.0),
    ("P", "B"): (1e5, 0.0),
    ("P", "H"): (100.0, 0.0),
    ("P", "I"): (3386.389, 0.0),
    ("P", "M"): (133.3224, 0.0),
    ("P", "P"): (1.0, 0.0),
    ("S", "K"): (1.0 / 3.6, 0.0),
    ("S", "M"): (1.0, 0.0),
    ("S", "N"): (1852.0 / 3600.0, 0.0),
    ("S", "S"): (0.44704, 0.0),
}
_MIN_HECTOPASCALS = 500.0  # a higher pressure in "bar" is in hPa: some programs write 1013.2,B
_QUANTITY_NAMES = {(row.kind, name): value for value, row in QUANTITIES.items() for name in row.names}
_KINDS_BY_NAME = {name: kind for kind, name in _QUANTITY_NAMES if len(name) > 1}


def read_transducers(fields: Fields) -> tuple[dict[str, float | None], tuple[str, ...]]:
    """Return the values of an XDR sentence (None for an empty field) and the unknown transducers.

    Some plotters repeat or omit the type of a group, so a known name marks the end of its group. Raises MessageError
    for a known transducer with an invalid unit or value.
    """
    numbers: dict[str, float | None] = {}
    unknown: list[str] = []
    start = 0
    while start < len(fields):
        candidates = range(start, min(start + 5, len(fields)))
        end = next((index for index in candidates if fields[index].strip().upper() in _KINDS_BY_NAME), start + 3)
        group = [fields[index] if start <= index < len(fields) else "" for index in range(end - 3, end + 1)]
        start = end + 1
        kind, text, unit, name = group
        kind, name = kind.strip(), name.strip().upper().removesuffix("#0")  # the first of several instances
        quantity_name = _QUANTITY_NAMES.get((kind or _KINDS_BY_NAME.get(name, ""), name))
        if quantity_name is None:
            if any(group):
                unknown.append(f"{group[3][:MAX_NAME_CHARACTERS] or 'no name'} (type {kind[:3]}, unit {unit[:3]})")
        elif numbers.get(quantity_name) is None:
            numbers[quantity_name] = _convert(quantity_name, text, unit)
    return numbers, tuple(unknown)


def _convert(quantity_name: str, text: str, unit: str) -> float | None:
    quantity = QUANTITIES[quantity_name]
    number = to_number(text)
    if number is None:
        return None
    if quantity.kind == "P" and unit == "B" and number >= _MIN_HECTOPASCALS:
        unit = "H"
    try:
        factor, offset = UNITS[quantity.kind, unit]
    except KeyError:
        raise MessageError(MALFORMED, f"{quantity_name} has an unknown unit") from None
    return check_range(number * factor + offset, quantity.low, quantity.high, quantity_name)
