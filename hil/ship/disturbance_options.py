"""The options of `--with`: one row for each disturbance, with its source; how they are read and printed.

Each number of an option has a range and most a default (hil/ship/disturbances.py). The row names the source of a
number where there is one; "assumed" marks a number without a source, with a range that is plausible for such boats.
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
    Yaw,
)

MAX_TEXT_LENGTH = 500
RECORDED = "recorded on a wave-propelled vessel of 5 m, 186 h"


class DisturbanceError(ValueError):
    """A list of options that cannot be read; the text lists the valid ones."""


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
        "Wang et al. 2018, eq. 1 to 3: regressions of Zhou and Clarke, made for ships, so the share is open",
    ),
    Option(
        "orbital",
        Orbital,
        "orbital",
        "wave orbital motion moves the receiver along and across the waves, correlated with the wave yaw unless that "
        "has its own period",
        "linear waves: pi Hs / 2T, 0.39 m/s for 2 m at 8 s; spread at the peak 9 to 16 deg in "
        "swell, 24 deg in a wind sea (Goda and Suzuki 1975: s = 75, 25, 10), wider beside it",
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
        "intervals: ITU-R M.1371-5; range and losses assumed: an antenna of 2 m hears ships some 20 nautical miles off",
    ),
    Option(
        "yaw",
        Yaw,
        "yaw",
        "white noise of the yaw acceleration: the heading diffuses",
        f"{RECORDED}: 0.4 to 10 deg^2/s, typically 2",
    ),
    Option(
        "waves",
        OwnWaves,
        "own_waves",
        "the wave yaw has its own period instead of the scenario's",
        f"{RECORDED}: 1.9 to 3.6 s, damping 0.09 to 0.59, where the receiver moves with 5.5 to 8.5 s",
    ),
    Option(
        "bias",
        Bias,
        "bias",
        "standard deviation and time constant of the rudder bias, instead of the scenario's",
        f"{RECORDED}: 8 to 15 deg, 900 to 3500 s",
    ),
)
BY_NAME: Mapping[str, Option] = {row.name: row for row in TABLE}


def parse(text: str, base: Disturbances | None = None) -> Disturbances:
    """Parse "float=0.3:0.6,leeway=8,sway"; options replace those of `base`. Raise DisturbanceError with one line."""
    disturbances = base or Disturbances()
    if len(text) > MAX_TEXT_LENGTH:
        raise DisturbanceError(f"{len(text)} characters of options; the maximum is {MAX_TEXT_LENGTH}")
    seen: set[str] = set()
    for piece in text.split(","):
        name, equals, numbers = piece.strip().partition("=")
        row = BY_NAME.get(name)
        if row is None:
            raise DisturbanceError(
                f"unknown option {name[:30]!r}; use one of {', '.join(BY_NAME)}; rambler-hil scenarios describes them"
            )
        if name in seen:
            raise DisturbanceError(f"option {name!r} is given twice")
        seen.add(name)
        disturbances = replace(disturbances, **{row.field: _record(row, numbers.split(":") if equals else [])})
    return disturbances


def text_of(disturbances: Disturbances) -> str:
    """Return the text that parse reads back to the same disturbances; empty if there are none."""
    pieces = []
    for row in TABLE:
        record = getattr(disturbances, row.field)
        if record is not None:
            pieces.append(
                f"{row.name}=" + ":".join(_formatted(getattr(record, one.name), 9) for one in fields(row.record))
            )
    return ",".join(pieces)


def names_of(disturbances: Disturbances) -> list[str]:
    """Return the names of the options that are present."""
    return [row.name for row in TABLE if getattr(disturbances, row.field) is not None]


def numbers(name: str) -> tuple[str, ...]:
    """Return the names of the numbers of an option."""
    return tuple(one.name for one in fields(BY_NAME[name].record))


def written(name: str, values: Mapping[str, float | str | None]) -> str:
    """Format an option for parse; a number of None takes its default."""
    defaults: dict[str, Any] = {one.name: one.default for one in fields(BY_NAME[name].record)}
    texts = (_formatted(defaults[key] if value is None else value, 9) for key, value in values.items())
    return f"{name}={':'.join(texts)}"


def needed(row: Option) -> tuple[str, ...]:
    """Return the names of the numbers of an option that have no default."""
    return tuple(one.name for one in fields(row.record) if one.default is MISSING)


def description_rows(disturbances: Disturbances) -> list[tuple[str, str]]:
    """Return the description and the numbers of each option, for a report."""
    rows = []
    for row in TABLE:
        record = getattr(disturbances, row.field)
        if record is not None:
            values = [
                f"{_words(one)} {_formatted(getattr(record, one.name))}{_unit(one)}" for one in fields(row.record)
            ]
            rows.append((f"{row.name}: {row.text}", ", ".join(values)))
    return rows


def listing() -> str:
    """Return the table as text for the terminal."""
    lines = []
    for row in TABLE:
        lines.append(f"{_usage(row)}")
        lines.append(f"    {row.text}")
        for one in fields(row.record):
            default = "required" if one.default is MISSING else f"default {_formatted(one.default)}"
            lines.append(f"    {_words(one)}: {_allowed(one)}, {default}")
        lines.append(f"    source: {row.source}")
    return "\n".join(lines)


def _record(row: Option, texts: list[str]) -> Any:
    known = fields(row.record)
    if len(texts) > len(known):
        raise DisturbanceError(f"option {row.name}: {len(texts)} numbers are too many; write {_usage(row)}")
    values = {one.name: _value(row, one, text) for one, text in zip(known, texts, strict=False)}
    missing = [one for one in known if one.name not in values and one.default is MISSING]
    if missing:
        raise DisturbanceError(f"option {row.name}: {_words(missing[0])} is missing; write {_usage(row)}")
    return row.record(**values)


def _value(row: Option, one: Any, text: str) -> float | str:
    if "choices" in one.metadata:
        if text not in one.metadata["choices"]:
            raise DisturbanceError(
                f"option {row.name}: unknown {_words(one)} {text[:20]!r}; use one of {_allowed(one)}"
            )
        return text
    low, high = one.metadata["low"], one.metadata["high"]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Written so that NaN fails the comparison.
    if not low <= value <= high:
        raise DisturbanceError(
            f"option {row.name}: {_words(one)} {text[:20]!r} must be {_allowed(one)}; write {_usage(row)}"
        )
    return value


def _allowed(one: Any) -> str:
    """Return the range of a number, or the list of names."""
    if "choices" in one.metadata:
        return ", ".join(one.metadata["choices"])
    return f"{one.metadata['low']:g} to {one.metadata['high']:g}{_unit(one)}"


def _formatted(value: float | str, digits: int = 6) -> str:
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def _usage(row: Option) -> str:
    """Return the syntax of an option; brackets mark numbers that may be omitted, from the end."""
    text = ""
    for place, one in reversed(list(enumerate(fields(row.record)))):
        part = ("=" if place == 0 else ":") + str(one.name).upper() + text
        text = part if one.default is MISSING else f"[{part}]"
    return row.name + text


def _words(one: Any) -> str:
    """Return a field's name without its unit."""
    name = str(one.name)
    for suffix in ("_rad_s", "_m_s", "_deg2_s", "_deg", "_km", "_s"):
        if name.endswith(suffix):
            name = name[: -len(suffix)]
            break
    return name.replace("_", " ")


def _unit(one: Any) -> str:
    unit = one.metadata.get("unit", "-")
    return "" if unit == "-" else f" {unit}"
