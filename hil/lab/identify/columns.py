"""Find the columns of a table by their names, and the units in the names."""

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
    """Quantities of a type of table: all of `required` and at least one of `alternatives` have to be present.

    optional_text, units_text: parts of the error message, on the other columns and on the units.
    """

    names: tuple[str, ...]
    required: tuple[str, ...]
    alternatives: tuple[str, ...]
    optional_text: str
    units_text: str

    def missing(self, present: Collection[str]) -> list[str]:
        """Return the names of missing columns."""
        missing = [name for name in self.required if name not in present]
        if not missing and self.alternatives and not any(name in present for name in self.alternatives):
            missing = [" or ".join(self.alternatives)]
        return missing


MANOEUVRE = Layout(
    NAMES,
    ("time_s", "rudder_rad"),
    ("heading_rad", "yaw_rate_rad_s"),
    "an unmeasured heading, yaw rate or speed may be empty or missing",
    "degrees and knots are rudder_deg, heading_deg, yaw_rate_deg_s, speed_kn",
)
# For `estimate`: also speed over ground, position and goal.
MOTION = Layout(
    (*NAMES, "sog_m_s", "cog_rad", "lat_rad", "lon_rad", "goal_rad"),
    ("time_s", "heading_rad"),
    (),
    "all others may be empty or missing",
    "degrees and knots are heading_deg, rudder_deg, lat_deg, lon_deg, cog_deg, speed_kn, sog_kn",
)
GROUND_SPEED = ("sog", "speed_over_ground")
# quantity -> other names, without unit
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
DEGREE_RAD, MINUTE_S, KNOT_M_S = radians(1.0), 60.0, 1852.0 / 3600.0
ANGLE_UNITS = {"rad": 1.0, "deg": DEGREE_RAD}
SPEED_UNITS = {"m_s": 1.0, "kn": KNOT_M_S, "kt": KNOT_M_S, "kts": KNOT_M_S, "knots": KNOT_M_S, "km_h": 1 / 3.6}
NO_ANGLE = 0.0  # unit of a rudder in percent or servo pulses
# quantity -> unit in the name -> size in SI units
UNITS: dict[str, dict[str, float]] = {
    "time_s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "rudder_rad": {**ANGLE_UNITS, **dict.fromkeys(("percent", "pct", "pwm", "us"), NO_ANGLE)},
    "yaw_rate_rad_s": {"rad_s": 1.0, "deg_s": DEGREE_RAD, "deg_min": DEGREE_RAD / MINUTE_S, "rad_min": 1.0 / MINUTE_S},
    **dict.fromkeys(("heading_rad", "cog_rad", "lat_rad", "lon_rad", "goal_rad"), ANGLE_UNITS),
    **dict.fromkeys(("speed_m_s", "sog_m_s"), SPEED_UNITS),
}
SPELLINGS = {"degrees": "deg", "degree": "deg", "radians": "rad", "rps": "rad_s", "dps": "deg_s", "mps": "m_s"}
SPELLINGS |= {"kmh": "km_h", "kph": "km_h", "rads": "rad_s", "degs": "deg_s", "ms_1": "m_s", "rad_s_1": "rad_s"}
SPELLINGS |= {"deg_s_1": "deg_s", "seconds": "s", "knot": "kn", "m_s_1": "m_s", "deg_sec": "deg_s", "rad_sec": "rad_s"}
SPELLINGS |= {"degm": "deg", "degt": "deg", "deg_m": "deg", "deg_t": "deg", "m_sec": "m_s"}  # magnetic and true

# Additional words in a name that do not change the quantity.
EXTRA_WORDS = {
    "hat",
    "est",
    "estimated",
    "meas",
    "measured",
    "raw",
    "filtered",
    "filt",
    "act",
    "actual",
    "mid",
    "angle",
}
EXTRA_WORDS |= {"vel", "velo", "velocity", "angvel", "angvelo", "value"}
# Words that mark a rudder command, which is used if there is no measured angle.
COMMAND_WORDS = {"cmd", "command", "commanded", "order", "ordered", "set", "setpoint", "desired", "demand", "target"}

MAX_LABEL_CHARACTERS, MAX_LISTED_COLUMNS = 60, 12
COURSE_WORDS, WATER_WORDS = {"cog", "cmg", "course"}, {"stw", "water"}


@dataclass(frozen=True, slots=True)
class Column:
    """Index of a column, its name in the file, the size of its unit (NaN without one), and whether it is a command."""

    index: int
    label: str
    unit: float
    is_command: bool = False

    @property
    def has_unit(self) -> bool:
        """Return whether the name contains the unit."""
        return not math.isnan(self.unit)


def separator_of(header: str) -> str:
    """Return the separator of the fields of a header line."""
    return next((mark for mark in ("\t", ";", ",") if mark in header), " " if len(header.split()) > 1 else ",")


def find_columns(header: list[str], layout: Layout) -> dict[str, list[int]]:
    """Return the indices of the columns of each quantity.

    The first group with a match counts: names of the manoeuvre file, aliases, names after a point (ROS:
    field.heading), names with additional words, rudder commands.
    """
    full_names, last_parts = (
        [_normalise(text) for text in header],
        [_normalise(text.rpartition(".")[2]) for text in header],
    )
    columns = {}
    for quantity in layout.names:
        candidates = (
            [index for index, name in enumerate(full_names) if name == quantity],
            *(
                [index for index, name in enumerate(names) if _unit(quantity, name) is not None]
                for names in (full_names, last_parts)
            ),
            [index for index, name in enumerate(full_names) if _unit_with_extra_words(quantity, name) is not None],
            [
                index
                for index, name in enumerate(full_names)
                if quantity == "rudder_rad" and _command_unit(name) is not None
            ],
        )
        columns[quantity] = next(filter(None, candidates), [])
    if ground := columns.get("sog_m_s"):
        columns["speed_m_s"] = [index for index in columns["speed_m_s"] if index not in ground]
    return {quantity: indices for quantity, indices in columns.items() if indices}


def columns_of(where: str, header: list[str], layout: Layout) -> dict[str, Column]:
    """Find the columns, or raise UsageError that names missing or ambiguous ones."""
    labels = [label_of(text) for text in header]
    columns: dict[str, Column] = {}
    for quantity, all_indices in find_columns(header, layout).items():
        indices = all_indices if quantity != "speed_m_s" else _through_water(all_indices, header)
        if len(indices) > 1:
            names = " and ".join(dict.fromkeys(labels[index] for index in indices))
            is_ambiguous = " and " in names
            problem = f"columns {names} all contain {quantity}" if is_ambiguous else f"column {names} occurs twice"
            raise UsageError(f"{where}: {problem}; remove all but one")
        name = header[indices[0]]
        units = (
            *(_unit(quantity, _normalise(text)) for text in (name, name.rpartition(".")[2])),
            _unit_with_extra_words(quantity, _normalise(name)),
        )
        unit = next((unit for unit in units if unit is not None), None)
        unit_size = _command_unit(_normalise(name)) if unit is None else unit
        columns[quantity] = Column(
            indices[0], labels[indices[0]], math.nan if unit_size is None else unit_size, unit is None
        )
    missing, all_names = layout.missing(columns), ",".join(layout.names)
    if missing and all(re.fullmatch(r"[-+.\deE]*|nan", text.strip()) for text in header):
        raise UsageError(f"{where}: numbers instead of column names; add a header line such as {all_names}")
    if missing:
        raise UsageError(
            f"{where}: missing column{'s' if len(missing) > 1 else ''} {', '.join(missing)}; name the columns "
            f"{all_names} ({layout.optional_text}; {layout.units_text}); {_columns_text(labels)}"
        )
    return columns


def _through_water(indices: list[int], header: list[str]) -> list[int]:
    """Return the columns of the speed through the water if there is one, else all speed columns."""
    water = [index for index in indices if WATER_WORDS & {*_normalise(header[index]).split("_")}]
    return water if len(indices) > 1 and water else indices


def _columns_text(labels: list[str]) -> str:
    """Return a text that lists the columns of the file, with a hint if one is a course over ground."""
    labels = [name for name in labels if name]
    listed = ", ".join(labels[:MAX_LISTED_COLUMNS]) + (
        f" and {len(labels) - MAX_LISTED_COLUMNS} more" if len(labels) > MAX_LISTED_COLUMNS else ""
    )
    course = next((name for name in labels if COURSE_WORDS & {*_normalise(name).split("_")}), None)
    hint = f"; {course} is the course over ground, not a heading" if course is not None else ""
    return f"the file has {listed}{hint}"


def label_of(text: str) -> str:
    """Return a column name for a message: printable and shortened."""
    text = text.strip()
    text = text if text.isprintable() else text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= MAX_LABEL_CHARACTERS else text[: MAX_LABEL_CHARACTERS - 3] + "..."


def _normalise(text: str) -> str:
    """Return a name in lower case with underscores: `Rate of Turn [°/s]` gives rate_of_turn_deg_s."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", re.sub(r"(?<!^)%", " percent", text.strip())).lower()
    text = text.replace("°", "deg").replace("µ", "u")
    return re.sub(r"[^a-z0-9]+", "_", text).strip("_")


def _unit(quantity: str, name: str) -> float | None:
    """Return the size of the unit, NaN without unit, None if the name is of another quantity."""
    for alias in _aliases(quantity):
        if name == alias:
            return UNITS[quantity].get(SPELLINGS.get(name, name), math.nan)
        if name.startswith(alias + "_"):
            unit = name.removeprefix(alias + "_")
            unit_size = UNITS[quantity].get(SPELLINGS.get(unit, unit))
            if unit_size is not None:
                return unit_size
    return None


def _unit_with_extra_words(quantity: str, name: str) -> float | None:
    """Return the unit of a column name with additional words, such as `delta_rudder_rad` or `psi_hat`."""
    words = name.split("_")
    for count in range(len(words), 0, -1):
        unit = "_".join(words[count:])
        unit_size = UNITS[quantity].get(SPELLINGS.get(unit, unit)) if unit else math.nan
        text = f"_{'_'.join(words[:count])}_"
        for alias in _aliases(quantity) if unit_size is not None else ():
            rest = text.replace(f"_{alias}_", "_", 1)
            if rest != text and {*rest.split("_")} <= {"", *EXTRA_WORDS, *_aliases(quantity)}:
                return unit_size
    return None


def _command_unit(name: str) -> float | None:
    """Return the unit of a column name of a rudder command, such as `rudder_cmd_deg`."""
    words = name.split("_")
    other_words = [word for word in words if word not in COMMAND_WORDS]
    if len(other_words) == len(words):
        return None
    without_command = "_".join(other_words)
    unit = _unit("rudder_rad", without_command)
    return _unit_with_extra_words("rudder_rad", without_command) if unit is None else unit


def _aliases(quantity: str) -> list[str]:
    """Return all names of a quantity without unit, the longest first."""
    bare = quantity.removesuffix("_rad").removesuffix("_rad_s").removesuffix("_m_s").removesuffix("_s")
    return sorted({bare, *ALIASES[quantity]}, key=len, reverse=True)
