"""Finds the columns of a manoeuvre table by their names, whatever separates them, and the units that the names say."""

from __future__ import annotations

import math
import re
from collections.abc import Collection
from dataclasses import dataclass

from firmware_py.common.angles import radians
from hil.errors import UsageError

NAMES = ("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s", "speed_m_s")


@dataclass(frozen=True, slots=True)
class Layout:
    """The quantities that a kind of table holds: those that it must have, and of `either` one.

    optional, units: what a message says of the others and of the units.
    """

    names: tuple[str, ...]
    must: tuple[str, ...]
    either: tuple[str, ...]
    optional: str
    units: str

    def missing(self, found: Collection[str]) -> list[str]:
        """Return what is needed and not there."""
        missing = [name for name in self.must if name not in found]
        if not missing and self.either and not any(name in found for name in self.either):
            missing = [" or ".join(self.either)]
        return missing


MANOEUVRE = Layout(
    NAMES,
    ("time_s", "rudder_rad"),
    ("heading_rad", "yaw_rate_rad_s"),
    "an unmeasured heading, yaw rate or speed may be empty or left out",
    "degrees and knots are rudder_deg, heading_deg, yaw_rate_deg_s, speed_kn",
)
# For `estimate`: speed over ground apart from speed through the water, position and goal, too.
MOTION = Layout(
    (*NAMES, "sog_m_s", "cog_rad", "lat_rad", "lon_rad", "goal_rad"),
    ("time_s", "heading_rad"),
    (),
    "all others may be empty or left out",
    "degrees and knots are heading_deg, rudder_deg, lat_deg, lon_deg, cog_deg, speed_kn, sog_kn",
)
GROUND_SPEED = ("sog", "speed_over_ground")
# quantity -> what else it is called, without its unit
ALIASES = {
    "time_s": (
        *("time", "t", "timestamp", "time_stamp", "seconds", "datetime", "date_time", "utc", "time_utc", "utc_time"),
        *("elapsed", "elapsed_time", "time_elapsed", "original_timestamp"),
    ),
    "rudder_rad": ("rudder", "rudder_angle", "delta", "rsa", "rudder_position", "rudder_pos", "rud", "delta_r"),
    "heading_rad": ("heading", "hdg", "hdt", "hdm", "psi", "yaw", "compass", "true_heading", "heading_true"),
    "yaw_rate_rad_s": ("yaw_rate", "yawrate", "rot", "rate_of_turn", "turn_rate", "r", "gyro_z", "gyr_z"),
    "speed_m_s": ("speed", "stw", "u", "speed_through_water", "water_speed", "boat_speed", *GROUND_SPEED),
    "sog_m_s": GROUND_SPEED,
    "cog_rad": ("course", "course_over_ground", "cmg"),
    "lat_rad": ("latitude",),
    "lon_rad": ("longitude", "lng", "long"),
    "goal_rad": ("goal_heading", "heading_goal"),
}
DEGREE, MINUTE_S, KNOT_M_S = radians(1.0), 60.0, 1852.0 / 3600.0
ANGLE = {"rad": 1.0, "deg": DEGREE}
SPEED = {"m_s": 1.0, "kn": KNOT_M_S, "kt": KNOT_M_S, "kts": KNOT_M_S, "knots": KNOT_M_S, "km_h": 1 / 3.6}
NO_ANGLE = 0.0  # size of a rudder's unit that is a share of full or a servo's pulse
# quantity -> unit as it is written after a name, or is the name -> its size
UNITS: dict[str, dict[str, float]] = {
    "time_s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rudder_rad": {**ANGLE, **dict.fromkeys(("percent", "pct", "pwm", "us"), NO_ANGLE)},
    "yaw_rate_rad_s": {"rad_s": 1.0, "deg_s": DEGREE, "deg_min": DEGREE / MINUTE_S, "rad_min": 1.0 / MINUTE_S},
    **dict.fromkeys(("heading_rad", "cog_rad", "lat_rad", "lon_rad", "goal_rad"), ANGLE),
    **dict.fromkeys(("speed_m_s", "sog_m_s"), SPEED),
}
SPELLINGS = {"degrees": "deg", "degree": "deg", "radians": "rad", "rps": "rad_s", "dps": "deg_s", "mps": "m_s"}
SPELLINGS |= {"kmh": "km_h", "kph": "km_h", "rads": "rad_s", "degs": "deg_s", "ms_1": "m_s", "rad_s_1": "rad_s"}
SPELLINGS |= {"deg_s_1": "deg_s", "seconds": "s", "knot": "kn", "m_s_1": "m_s", "deg_sec": "deg_s", "rad_sec": "rad_s"}
SPELLINGS |= {"degm": "deg", "degt": "deg", "deg_m": "deg", "deg_t": "deg", "m_sec": "m_s"}  # magnetic and true

# Words beside one of these names that leave it the same quantity.
BESIDE = {"hat", "est", "estimated", "meas", "measured", "raw", "filtered", "filt", "act", "actual", "mid", "angle"}
BESIDE |= {"vel", "velo", "velocity", "angvel", "angvelo", "value"}
# Words beside the rudder's name that make it what was asked for; taken where nothing says what it did.
ASKED = {"cmd", "command", "commanded", "order", "ordered", "set", "setpoint", "desired", "demand", "target"}

LONGEST_SHOWN, MOST_NAMED = 60, 12
COURSE, WATER = {"cog", "cmg", "course"}, {"stw", "water"}


@dataclass(frozen=True, slots=True)
class Column:
    """Where a quantity stands, what the file calls it, and the size of its unit; NaN where the name says none.

    asked: it is the rudder's command, not its position.
    """

    place: int
    shown: str
    unit: float
    asked: bool = False

    @property
    def known(self) -> bool:
        """Whether the name says the unit."""
        return not math.isnan(self.unit)


def separator_of(header: str) -> str:
    """Return what separates the fields of a first line."""
    return next((mark for mark in ("\t", ";", ",") if mark in header), " " if len(header.split()) > 1 else ",")


def found_columns(header: list[str], layout: Layout) -> dict[str, list[int]]:
    """Return where each quantity stands, by the first that is there.

    The names of the manoeuvre file, other names, and those behind a point, as ROS's field.heading.
    """
    whole, ends = [_plain(text) for text in header], [_plain(text.rpartition(".")[2]) for text in header]
    found = {}
    for quantity in layout.names:
        ways = (
            [place for place, name in enumerate(whole) if name == quantity],
            *(
                [place for place, name in enumerate(names) if _unit(quantity, name) is not None]
                for names in (whole, ends)
            ),
            [place for place, name in enumerate(whole) if _beside(quantity, name) is not None],
            [place for place, name in enumerate(whole) if quantity == "rudder_rad" and _asked(name) is not None],
        )
        found[quantity] = next(filter(None, ways), [])
    if ground := found.get("sog_m_s"):
        found["speed_m_s"] = [place for place in found["speed_m_s"] if place not in ground]
    return {quantity: places for quantity, places in found.items() if places}


def columns_of(where: str, header: list[str], layout: Layout) -> dict[str, Column]:
    """Find the columns; UsageError names what is missing."""
    shown = [_shown(text) for text in header]
    found: dict[str, Column] = {}
    for quantity, all_places in found_columns(header, layout).items():
        places = all_places if quantity != "speed_m_s" else _through_water(all_places, header)
        if len(places) > 1:
            names = " and ".join(dict.fromkeys(shown[place] for place in places))
            several = " and " in names
            what = f"columns {names} all say {quantity}" if several else f"column {names} stands there twice"
            raise UsageError(f"{where}: {what}; remove all but one")
        name = header[places[0]]
        units = (
            *(_unit(quantity, _plain(text)) for text in (name, name.rpartition(".")[2])),
            _beside(quantity, _plain(name)),
        )
        unit = next((unit for unit in units if unit is not None), None)
        said = _asked(_plain(name)) if unit is None else unit
        found[quantity] = Column(places[0], shown[places[0]], math.nan if said is None else said, unit is None)
    missing, usual = layout.missing(found), ",".join(layout.names)
    if missing and all(re.fullmatch(r"[-+.\deE]*|nan", text.strip()) for text in header):
        raise UsageError(f"{where}: numbers where the columns' names should be; put a line above, as {usual}")
    if missing:
        raise UsageError(
            f"{where}: missing column{'s' if len(missing) > 1 else ''} {', '.join(missing)}; name the columns "
            f"{usual} ({layout.optional}; {layout.units}); {_there(shown)}"
        )
    return found


def _through_water(places: list[int], header: list[str]) -> list[int]:
    """Return the columns of the speed through the water if there is one beside that over the ground."""
    water = [place for place in places if WATER & {*_plain(header[place]).split("_")}]
    return water if len(places) > 1 and water else places


def _there(shown: list[str]) -> str:
    """Say what columns there are, and what of them is easily taken for a heading."""
    shown = [name for name in shown if name]
    named = ", ".join(shown[:MOST_NAMED]) + (f" and {len(shown) - MOST_NAMED} more" if len(shown) > MOST_NAMED else "")
    course = next((name for name in shown if COURSE & {*_plain(name).split("_")}), None)
    of_course = f"; {course} is the course over ground, not a heading" if course is not None else ""
    return f"there are {named}{of_course}"


def _shown(text: str) -> str:
    """Write a name for a message: on one line, and not longer than that."""
    text = text.strip()
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def _plain(text: str) -> str:
    """Write a name as words joined by underscores: `Rate of Turn [°/s]` is rate_of_turn_deg_s."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", re.sub(r"(?<!^)%", " percent", text.strip())).lower()
    text = text.replace("°", "deg").replace("µ", "u")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")


def _unit(quantity: str, name: str) -> float | None:
    """Return the size of the unit, NaN where the name is without one, None if it is another quantity's."""
    for alias in _aliases(quantity):
        if name == alias:
            return UNITS[quantity].get(SPELLINGS.get(name, name), math.nan)
        if name.startswith(alias + "_"):
            unit = name.removeprefix(alias + "_")
            size = UNITS[quantity].get(SPELLINGS.get(unit, unit))
            if size is not None:
                return size
    return None


def _beside(quantity: str, name: str) -> float | None:
    """Return the unit of a column name that has further words, such as `delta_rudder_rad` or `psi_hat`."""
    words = name.split("_")
    for count in range(len(words), 0, -1):
        unit = "_".join(words[count:])
        size = UNITS[quantity].get(SPELLINGS.get(unit, unit)) if unit else math.nan
        text = f"_{'_'.join(words[:count])}_"
        for alias in _aliases(quantity) if size is not None else ():
            rest = text.replace(f"_{alias}_", "_", 1)
            if rest != text and {*rest.split("_")} <= {"", *BESIDE, *_aliases(quantity)}:
                return size
    return None


def _asked(name: str) -> float | None:
    """Return the unit of a column name of a rudder command, such as `rudder_cmd_deg`."""
    words = name.split("_")
    kept = [word for word in words if word not in ASKED]
    if len(kept) == len(words):
        return None
    plain = "_".join(kept)
    unit = _unit("rudder_rad", plain)
    return _beside("rudder_rad", plain) if unit is None else unit


def _aliases(quantity: str) -> list[str]:
    """Return all names of a quantity without its unit, the longest first."""
    bare = quantity.removesuffix("_rad").removesuffix("_rad_s").removesuffix("_m_s").removesuffix("_s")
    return sorted({bare, *ALIASES[quantity]}, key=len, reverse=True)
