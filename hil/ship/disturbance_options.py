"""The options of `--with`: a table of the disturbances with their sources, parsing and printing.

Each number of an option has a range, and most have a default (hil/ship/disturbances.py). The row states the source of a
number; "assumed" marks a number without a source, with a range that is plausible for such boats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any

from hil.ship.disturbances import (
    Bias,
    Compass,
    Delay,
    Depth,
    Disturbances,
    FloatBody,
    Leeway,
    Orbital,
    OtherShip,
    OwnWaves,
    Receiver,
    Slide,
    Supply,
    Vessels,
    WaveSpeed,
    Wind,
    Yaw,
)

MAX_TEXT_LENGTH = 500
RECORDING_SOURCE = "recorded on a wave-propelled vessel of 5 m, 186 h"


class DisturbanceError(ValueError):
    """A list of options cannot be parsed; the text lists the valid ones."""


@dataclass(frozen=True, slots=True)
class Option:
    """One row: option name, record of its numbers, field of Disturbances, description, source."""

    name: str
    record: type
    field: str
    text: str
    source: str


TABLE: tuple[Option, ...] = (
    Option(
        "float",
        FloatBody,
        "float_body",
        "two bodies: the rudder turns the glider; the float with the compass follows on the umbilical",
        "Li, Pan, Liao et al., Appl. Math. Modelling 2020, and Liao et al., PLoS ONE 11(12) 2016: two bodies, a tense "
        "umbilical; reduced here to one equation, its numbers assumed: 0.2 to 1 rad/s, 0.4 to 0.9",
    ),
    Option(
        "leeway",
        Leeway,
        "leeway",
        "leeway to starboard of the heading: constant, and away from a wind on the beam (sine of its angle)",
        "3 to 10 deg are usual for slow hulls; the sine is assumed",
    ),
    Option(
        "sway",
        Slide,
        "slide",
        "outward sway in turns",
        "Wang et al. 2018, eq. 1 to 3: regressions of Zhou and Clarke, made for ships, so the share is uncertain",
    ),
    Option(
        "orbital",
        Orbital,
        "orbital",
        "wave orbital motion moves the receiver along and across the waves, correlated with the wave yaw unless that "
        "has its own period",
        "linear waves: pi Hs / 2T, 0.39 m/s for 2 m at 8 s; spread at the peak 9 to 16 deg in "
        "swell, 24 deg in a wind sea (Goda and Suzuki 1975: s = 75, 25, 10), wider beside the peak",
    ),
    Option(
        "speed",
        WaveSpeed,
        "wave_speed",
        "speed varies with the wave groups; in a calm, from a time and for a time, waves and speed decay",
        "telemetry: 5, 50, 95 % of the speed are 0.27, 0.70, 1.23 m/s; the minutes are assumed",
    ),
    Option(
        "receiver",
        Receiver,
        "receiver",
        "realistic GNSS receiver: latency, gaps without a fix (1: always), velocity filtered and noisy",
        "data sheets: 0.2 to 1 s, 0.05 m/s; recorded: a filter of 4 to 20 s, noise 0.005 m/s; gaps in heavy seas are "
        "assumed",
    ),
    Option(
        "compass",
        Compass,
        "compass",
        "uncorrected compass: deviation A + B sin + C cos + D sin 2 + E cos 2 (east positive), heel error, lag",
        "NGA, Handbook of Magnetic Compass Adjustment, 2004; uncorrected on a small boat, assumed",
    ),
    Option(
        "kt",
        OtherShip,
        "other_ship",
        "model mismatch: the ship's K and T are these multiples of the values in the vehicle file",
        "margins: K x2, K x0.5, T x3",
    ),
    Option("delay", Delay, "delay", "delay from rudder angle to yaw response", "margins: 2 s"),
    Option(
        "supply",
        Supply,
        "supply",
        "solar panels under clouds, a battery, a steady load beside the servo; charger and battery monitor report it",
        "clear sky: Haurwitz 1945; lengths of clouds assumed; four cells of lithium iron phosphate",
    ),
    Option(
        "vessels",
        Vessels,
        "vessels",
        "other ships on straight tracks, placed for a boat that steers north from the start, as received by AIS",
        "intervals: ITU-R M.1371-5; range and losses assumed: an antenna at 2 m receives some 20 nautical miles",
    ),
    Option(
        "yaw",
        Yaw,
        "yaw",
        "white noise of the yaw acceleration: the heading diffuses",
        f"{RECORDING_SOURCE}: 0.4 to 10 deg^2/s, typically 2",
    ),
    Option(
        "waves",
        OwnWaves,
        "own_waves",
        "the wave yaw has its own period instead of the scenario's",
        f"{RECORDING_SOURCE}: 1.9 to 3.6 s, damping 0.09 to 0.59, where the receiver moves with 5.5 to 8.5 s",
    ),
    Option(
        "bias",
        Bias,
        "bias",
        "standard deviation and time constant of the rudder bias, instead of the scenario's",
        f"{RECORDING_SOURCE}: 8 to 15 deg, 900 to 3500 s",
    ),
    Option(
        "wind",
        Wind,
        "wind",
        "wind that a wind sensor on the boat measures; it does not move the boat (see leeway)",
        "assumed: turbulence of 0.06 to 0.15 of the speed is usual over the open sea",
    ),
    Option(
        "depth",
        Depth,
        "depth",
        "water depth that an echo sounder on the boat measures: constant, or with a slope to the north",
        "assumed",
    ),
)
BY_NAME: Mapping[str, Option] = {row.name: row for row in TABLE}


def parse(text: str, base: Disturbances | None = None) -> Disturbances:
    """Parse "float=0.3:0.6,leeway=8,sway", which replaces options of `base`. Raise DisturbanceError with one line."""
    disturbances = base or Disturbances()
    if len(text) > MAX_TEXT_LENGTH:
        raise DisturbanceError(f"{len(text)} characters of options; the maximum is {MAX_TEXT_LENGTH}")
    names: set[str] = set()
    for piece in text.split(","):
        name, equals, values = piece.strip().partition("=")
        row = BY_NAME.get(name)
        if row is None:
            raise DisturbanceError(
                f"unknown option {name[:30]!r}; use one of {', '.join(BY_NAME)}; rambler-hil scenarios describes them"
            )
        if name in names:
            raise DisturbanceError(f"option {name!r} is given twice")
        names.add(name)
        disturbances = replace(disturbances, **{row.field: _parse_record(row, values.split(":") if equals else [])})
    return disturbances


def text_of(disturbances: Disturbances) -> str:
    """Format disturbances for parse; empty if there are none."""
    pieces = []
    for row in TABLE:
        record = getattr(disturbances, row.field)
        if record is not None:
            pieces.append(
                f"{row.name}=" + ":".join(_format(getattr(record, number.name), 9) for number in fields(row.record))
            )
    return ",".join(pieces)


def names_of(disturbances: Disturbances) -> list[str]:
    """Return the names of the options of these disturbances."""
    return [row.name for row in TABLE if getattr(disturbances, row.field) is not None]


def number_names(name: str) -> tuple[str, ...]:
    """Return the names of the numbers of an option."""
    return tuple(number.name for number in fields(BY_NAME[name].record))


def format_option(name: str, values: Mapping[str, float | str | None]) -> str:
    """Format an option for parse; None stands for the default of a number."""
    defaults: dict[str, Any] = {number.name: number.default for number in fields(BY_NAME[name].record)}
    texts = (_format(defaults[key] if value is None else value, 9) for key, value in values.items())
    return f"{name}={':'.join(texts)}"


def required_numbers(row: Option) -> tuple[str, ...]:
    """Return the names of the numbers of an option that have no default."""
    return tuple(number.name for number in fields(row.record) if number.default is MISSING)


def description_rows(disturbances: Disturbances) -> list[tuple[str, str]]:
    """Return the description and the numbers of each option, for a report."""
    rows = []
    for row in TABLE:
        record = getattr(disturbances, row.field)
        if record is not None:
            values = [
                f"{_label(number)} {_format(getattr(record, number.name))}{_unit_suffix(number)}"
                for number in fields(row.record)
            ]
            rows.append((f"{row.name}: {row.text}", ", ".join(values)))
    return rows


def describe_options() -> str:
    """Return the table as text for the terminal."""
    lines = []
    for row in TABLE:
        lines.append(f"{_describe_syntax(row)}")
        lines.append(f"    {row.text}")
        for number in fields(row.record):
            default = "required" if number.default is MISSING else f"default {_format(number.default)}"
            lines.append(f"    {_label(number)}: {_describe_range(number)}, {default}")
        lines.append(f"    source: {row.source}")
    return "\n".join(lines)


def _parse_record(row: Option, texts: list[str]) -> Any:
    numbers = fields(row.record)
    if len(texts) > len(numbers):
        raise DisturbanceError(f"option {row.name}: {len(texts)} numbers are too many; write {_describe_syntax(row)}")
    values = {number.name: _parse_number(row, number, text) for number, text in zip(numbers, texts, strict=False)}
    missing = [number for number in numbers if number.name not in values and number.default is MISSING]
    if missing:
        raise DisturbanceError(f"option {row.name}: {_label(missing[0])} is missing; write {_describe_syntax(row)}")
    return row.record(**values)


def _parse_number(row: Option, number: Any, text: str) -> float | str:
    if "choices" in number.metadata:
        if text not in number.metadata["choices"]:
            raise DisturbanceError(
                f"option {row.name}: unknown {_label(number)} {text[:20]!r}; use one of {_describe_range(number)}"
            )
        return text
    low, high = number.metadata["low"], number.metadata["high"]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Written so that NaN fails the comparison.
    if not low <= value <= high:
        raise DisturbanceError(
            f"option {row.name}: {_label(number)} {text[:20]!r} must be {_describe_range(number)}; "
            f"write {_describe_syntax(row)}"
        )
    return value


def _describe_range(number: Any) -> str:
    """Return the range of a number, or the list of names."""
    if "choices" in number.metadata:
        return ", ".join(number.metadata["choices"])
    return f"{number.metadata['low']:g} to {number.metadata['high']:g}{_unit_suffix(number)}"


def _format(value: float | str, digits: int = 6) -> str:
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def _describe_syntax(row: Option) -> str:
    """Return the syntax of an option; brackets mark numbers that may be omitted, from the end."""
    text = ""
    for index, number in reversed(list(enumerate(fields(row.record)))):
        piece = ("=" if index == 0 else ":") + str(number.name).upper() + text
        text = piece if number.default is MISSING else f"[{piece}]"
    return row.name + text


def _label(number: Any) -> str:
    """Return the name of a field without its unit."""
    name = str(number.name)
    for suffix in ("_rad_s", "_m_s", "_deg2_s", "_deg", "_km", "_m", "_s"):
        if name.endswith(suffix):
            name = name[: -len(suffix)]
            break
    return name.replace("_", " ")


def _unit_suffix(number: Any) -> str:
    unit = number.metadata.get("unit", "-")
    return "" if unit == "-" else f" {unit}"
