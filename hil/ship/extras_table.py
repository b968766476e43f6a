"""The options of `--with`: one row for each disturbance of the sea, with its source; how they are read and printed.

Each option is one disturbance, and each of its numbers has a range and most a default (hil/ship/extras.py). The
source of a number is named where there is one. "Assumed" marks a number without a source; its range is what
such boats could have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any

from hil.ship.extras import (
    Bias,
    Compass,
    Delay,
    Extras,
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

LONGEST_TEXT = 500
RECORDED = "recorded on a wave-propelled vessel of 5 m, 186 h"


class ExtrasError(ValueError):
    """A list of options that cannot be read; the text says what there is."""


@dataclass(frozen=True, slots=True)
class Option:
    """One row: the name, the record of its numbers and the field of Extras that holds it, what it does, the source."""

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
        "two bodies: the rudder turns the glider, the float with the compass follows by the umbilical",
        "Li, Pan, Liao et al., Appl. Math. Modelling 2020, and Liao et al., PLoS ONE 11(12) 2016: two bodies, a tense "
        "umbilical; reduced here to one equation, its numbers assumed: 0.2 to 1 rad/s, 0.4 to 0.9",
    ),
    Option(
        "leeway",
        Leeway,
        "leeway",
        "her way lies to starboard of her heading: always, and away from a wind on the beam (the sine of its angle)",
        "3 to 10 deg are usual for slow hulls; the sine is assumed",
    ),
    Option(
        "sway",
        Slide,
        "slide",
        "she slides outward in her turns",
        "Wang et al. 2018, eq. 1 to 3: regressions of Zhou and Clarke, made for ships, so the share is open",
    ),
    Option(
        "orbital",
        Orbital,
        "orbital",
        "the waves move the receiver along and across their direction, in step with the wave yaw unless it has a "
        "period of its own",
        "linear waves: pi Hs / 2T, 0.39 m/s for 2 m at 8 s; spread at the peak 9 to 16 deg in "
        "swell, 24 deg in a wind sea (Goda and Suzuki 1975: s = 75, 25, 10), wider beside it",
    ),
    Option(
        "speed",
        WaveSpeed,
        "wave_speed",
        "her speed follows the wave groups; in a calm, from a time and for a time, waves and way die",
        "telemetry: 5, 50, 95 % of the speed are 0.27, 0.70, 1.23 m/s; the minutes are assumed",
    ),
    Option(
        "receiver",
        Receiver,
        "receiver",
        "a receiver as bought: late, at times without a fix (1: always), its velocity filtered and noisy",
        "data sheets: 0.2 to 1 s, 0.05 m/s; recorded: a filter of 4 to 20 s, noise 0.005 m/s; gaps in heavy seas are "
        "assumed",
    ),
    Option(
        "compass",
        Compass,
        "compass",
        "a compass as bought: deviation A + B sin + C cos + D sin 2 + E cos 2 (east positive), heel error, lag",
        "NGA, Handbook of Magnetic Compass Adjustment, 2004; uncorrected on a small boat, assumed",
    ),
    Option(
        "kt",
        OtherShip,
        "other_ship",
        "the ship's K and T are these multiples of what the boat is told",
        "margins: K x2, K x0.5, T x3",
    ),
    Option("delay", Delay, "delay", "the rudder turns her so much later", "margins: 2 s"),
    Option(
        "supply",
        Supply,
        "supply",
        "panels under sun and clouds, a battery, a steady load beside the servo; a charger and a monitor tell of it",
        "clear sky: Haurwitz 1945; lengths of clouds assumed; four cells of lithium iron phosphate",
    ),
    Option(
        "vessels",
        Vessels,
        "vessels",
        "other ships on straight lines, laid for a boat that steers north from the start, as she hears them",
        "intervals: ITU-R M.1371-5; range and losses assumed: an antenna of 2 m hears ships some 20 nautical miles off",
    ),
    Option(
        "yaw",
        Yaw,
        "yaw",
        "white disturbance of the yaw acceleration: the heading diffuses",
        f"{RECORDED}: 0.4 to 10 deg^2/s, typically 2",
    ),
    Option(
        "waves",
        OwnWaves,
        "own_waves",
        "the wave yaw has a period of its own, not that of the sea",
        f"{RECORDED}: 1.9 to 3.6 s, damping 0.09 to 0.59, where the receiver moves with 5.5 to 8.5 s",
    ),
    Option(
        "bias",
        Bias,
        "bias",
        "the rudder bias varies with this standard deviation and memory, not with those of the sea",
        f"{RECORDED}: 8 to 15 deg, 900 to 3500 s",
    ),
)
BY_NAME: Mapping[str, Option] = {row.name: row for row in TABLE}


def parse(text: str, over: Extras | None = None) -> Extras:
    """Read "float=0.3:0.6,leeway=8,sway" over what there is already; ExtrasError with one line says what is wrong."""
    extras = over or Extras()
    if len(text) > LONGEST_TEXT:
        raise ExtrasError(f"{len(text)} characters of options; at most {LONGEST_TEXT}")
    seen: set[str] = set()
    for piece in text.split(","):
        name, equals, numbers = piece.strip().partition("=")
        row = BY_NAME.get(name)
        if row is None:
            raise ExtrasError(
                f"no option {name[:30]!r}; there are: {', '.join(BY_NAME)}; rambler-hil scenarios explains"
            )
        if name in seen:
            raise ExtrasError(f"option {name!r} is given twice")
        seen.add(name)
        extras = replace(extras, **{row.field: _record(row, numbers.split(":") if equals else [])})
    return extras


def text_of(extras: Extras) -> str:
    """Return what parse reads the same from; empty without any."""
    pieces = []
    for row in TABLE:
        record = getattr(extras, row.field)
        if record is not None:
            pieces.append(f"{row.name}=" + ":".join(_shown(getattr(record, one.name), 9) for one in fields(row.record)))
    return ",".join(pieces)


def names_of(extras: Extras) -> list[str]:
    """Return the names of the options that are there."""
    return [row.name for row in TABLE if getattr(extras, row.field) is not None]


def numbers(name: str) -> tuple[str, ...]:
    """Return the names of the numbers of an option."""
    return tuple(one.name for one in fields(BY_NAME[name].record))


def written(name: str, values: Mapping[str, float | str | None]) -> str:
    """Write an option as parse reads it, with the defaults of its numbers where there is None."""
    defaults: dict[str, Any] = {one.name: one.default for one in fields(BY_NAME[name].record)}
    shown = (_shown(defaults[key] if value is None else value, 9) for key, value in values.items())
    return f"{name}={':'.join(shown)}"


def needed(row: Option) -> tuple[str, ...]:
    """Return the names of the numbers of an option that have no default."""
    return tuple(one.name for one in fields(row.record) if one.default is MISSING)


def rows_of(extras: Extras) -> list[tuple[str, str]]:
    """Return what each option does and its numbers in words, for a report."""
    found = []
    for row in TABLE:
        record = getattr(extras, row.field)
        if record is not None:
            values = [f"{_words(one)} {_shown(getattr(record, one.name))}{_unit(one)}" for one in fields(row.record)]
            found.append((f"{row.name}: {row.text}", ", ".join(values)))
    return found


def listing() -> str:
    """Return the table as the terminal shows it."""
    lines = []
    for row in TABLE:
        lines.append(f"{_usage(row)}")
        lines.append(f"    {row.text}")
        for one in fields(row.record):
            given = "to be given" if one.default is MISSING else f"default {_shown(one.default)}"
            lines.append(f"    {_words(one)}: {_allowed(one)}, {given}")
        lines.append(f"    source: {row.source}")
    return "\n".join(lines)


def _record(row: Option, texts: list[str]) -> Any:
    known = fields(row.record)
    if len(texts) > len(known):
        raise ExtrasError(f"option {row.name}: {len(texts)} numbers; write {_usage(row)}")
    values = {one.name: _value(row, one, text) for one, text in zip(known, texts, strict=False)}
    lacking = [one for one in known if one.name not in values and one.default is MISSING]
    if lacking:
        raise ExtrasError(f"option {row.name}: a number is lacking; write {_usage(row)}")
    return row.record(**values)


def _value(row: Option, one: Any, text: str) -> float | str:
    if "choices" in one.metadata:
        if text not in one.metadata["choices"]:
            raise ExtrasError(f"option {row.name}: no {_words(one)} {text[:20]!r}; there are {_allowed(one)}")
        return text
    low, high = one.metadata["low"], one.metadata["high"]
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    # Written so that NaN fails the comparison.
    if not low <= value <= high:
        raise ExtrasError(
            f"option {row.name}: {_words(one)} {text[:20]!r} must be {_allowed(one)}; write {_usage(row)}"
        )
    return value


def _allowed(one: Any) -> str:
    """Return the range of a number, or the names that there are."""
    if "choices" in one.metadata:
        return ", ".join(one.metadata["choices"])
    return f"{one.metadata['low']:g} to {one.metadata['high']:g}{_unit(one)}"


def _shown(value: float | str, digits: int = 6) -> str:
    return value if isinstance(value, str) else f"{value:.{digits}g}"


def _usage(row: Option) -> str:
    """Return how an option is written: what may be left out, from the end, in brackets."""
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
