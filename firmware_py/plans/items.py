"""Table of plan items: the allowed commands of missions, fences and rally points, and their parameters.

An accepted plan has only these commands, with these frames and ranges. Parameters that are not in a row have no
effect; they may be any finite number or NaN. With `allows_nan`, NaN means the default of the boat; 0 also
means the default if the text says so.

Places are `x`, `y` in 1e-7 degrees. In a mission the place (0, 0) means the position at the beginning of the item, as
in ArduPilot; in a fence it is a valid place. `z` is used only by DO_SET_HOME.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum

import msgspec

from firmware_py.common.plan import MAX_PLAN_ITEMS, PlanKind

MAX_DURATION_S = 1e8  # three years
MAX_DISTANCE_M = 1e7
MAX_TURNS = 10_000.0
MAX_JUMPS = 32_767.0
MAX_SPEED_M_S = 100.0


class Command(IntEnum):
    """Command of an item, numbered as MAVLink's MAV_CMD."""

    WAYPOINT = 16
    LOITER_UNLIMITED = 17
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN = 20
    DELAY = 93
    CONDITION_DELAY = 112
    CONDITION_DISTANCE = 114
    YAW = 115
    JUMP = 177
    CHANGE_SPEED = 178
    SET_HOME = 179
    FENCE_ENABLE = 207
    YAW_SPEED = 213
    JUMP_TAG = 600
    JUMP_TO_TAG = 601
    FENCE_RETURN = 5000
    INCLUDED_VERTEX = 5001
    EXCLUDED_VERTEX = 5002
    INCLUDED_CIRCLE = 5003
    EXCLUDED_CIRCLE = 5004
    RALLY_POINT = 5100


class Meaning(msgspec.Struct, frozen=True):
    """Meaning of a parameter: its number 1 to 4, its range, and whether it is an integer or may be NaN."""

    number: int
    text: str
    low: float
    high: float
    unit: str = ""
    is_integer: bool = False
    allows_nan: bool = False

    def allowed(self) -> str:
        """Return the allowed values as a text."""
        kind = "a whole number, " if self.is_integer else ""
        return f"{kind}{self.low:g} to {self.high:g} {self.unit}".rstrip()

    def admits(self, value: float) -> bool:
        """Return whether a value is allowed."""
        if math.isnan(value):
            return self.allows_nan
        return self.low <= value <= self.high and (not self.is_integer or value == math.floor(value))


class ItemRow(msgspec.Struct, frozen=True):
    """One command. `has_place`: x and y are a place. `has_duration`: an endless loop must contain such an item."""

    command: Command
    name: str
    kind: PlanKind
    has_place: bool
    has_duration: bool
    meanings: tuple[Meaning, ...] = ()


def _make_radius(text: str) -> Meaning:
    return Meaning(
        3, f"{text}; 0: by parameter; negative: anticlockwise", -MAX_DISTANCE_M, MAX_DISTANCE_M, "m", allows_nan=True
    )


_ANGLE = "degrees clockwise from north, or from the present heading (relative)"
_RELATIVE = "0: absolute, 1: relative"
_GROUP = Meaning(
    2, "inclusion group: the boat is inside all areas of one group", 0.0, 255.0, is_integer=True, allows_nan=True
)
_TAG = Meaning(1, "tag", 0.0, 65535.0, is_integer=True)
_TIMES = Meaning(2, "number of jumps, -1: unlimited", -1.0, MAX_JUMPS, is_integer=True)
_VERTICES = Meaning(
    1, "number of vertices of this polygon, the same in each of them", 3.0, float(MAX_PLAN_ITEMS), is_integer=True
)
_CIRCLE = Meaning(1, "radius", 1.0, MAX_DISTANCE_M, "m")

_MISSION, _FENCE, _RALLY = PlanKind.MISSION, PlanKind.FENCE, PlanKind.RALLY

TABLE: tuple[ItemRow, ...] = (
    ItemRow(
        Command.WAYPOINT,
        "NAV_WAYPOINT",
        _MISSION,
        has_place=True,
        has_duration=True,
        meanings=(
            Meaning(1, "time of station keeping there", 0.0, MAX_DURATION_S, "s", allows_nan=True),
            Meaning(2, "acceptance radius; 0: by parameter", 0.0, MAX_DISTANCE_M, "m", allows_nan=True),
        ),
    ),
    ItemRow(
        Command.LOITER_UNLIMITED,
        "NAV_LOITER_UNLIM",
        _MISSION,
        has_place=True,
        has_duration=True,
        meanings=(_make_radius("radius of station keeping"),),
    ),
    ItemRow(
        Command.LOITER_TURNS,
        "NAV_LOITER_TURNS",
        _MISSION,
        has_place=True,
        has_duration=True,
        meanings=(Meaning(1, "turns", 0.0, MAX_TURNS), _make_radius("radius")),
    ),
    ItemRow(
        Command.LOITER_TIME,
        "NAV_LOITER_TIME",
        _MISSION,
        has_place=True,
        has_duration=True,
        meanings=(
            Meaning(1, "time of station keeping from the arrival", 0.0, MAX_DURATION_S, "s"),
            _make_radius("radius"),
        ),
    ),
    ItemRow(Command.RETURN, "NAV_RETURN_TO_LAUNCH", _MISSION, has_place=False, has_duration=True),
    ItemRow(
        Command.DELAY,
        "NAV_DELAY",
        _MISSION,
        has_place=False,
        has_duration=True,
        meanings=(
            Meaning(1, "time; -1: until the time of day (UTC) of the other parameters", -1.0, MAX_DURATION_S, "s"),
            Meaning(2, "hour; needed with -1", -1.0, 23.0, "h", is_integer=True, allows_nan=True),
            Meaning(3, "minute; -1: 0", -1.0, 59.0, "min", is_integer=True, allows_nan=True),
            Meaning(4, "second; -1: 0", -1.0, 59.0, "s", is_integer=True, allows_nan=True),
        ),
    ),
    ItemRow(
        Command.CONDITION_DELAY,
        "CONDITION_DELAY",
        _MISSION,
        has_place=False,
        has_duration=True,
        meanings=(Meaning(1, "time", 0.0, MAX_DURATION_S, "s"),),
    ),
    ItemRow(
        Command.CONDITION_DISTANCE,
        "CONDITION_DISTANCE",
        _MISSION,
        has_place=False,
        has_duration=True,
        meanings=(Meaning(1, "distance to the next place", 0.0, MAX_DISTANCE_M, "m"),),
    ),
    ItemRow(
        Command.YAW,
        "CONDITION_YAW",
        _MISSION,
        has_place=False,
        has_duration=True,
        meanings=(
            Meaning(1, _ANGLE, -360.0, 360.0, "deg"),
            Meaning(3, "relative: -1 turns to port; otherwise ignored", -1.0, 1.0, is_integer=True, allows_nan=True),
            Meaning(4, _RELATIVE, 0.0, 1.0, is_integer=True),
        ),
    ),
    ItemRow(
        Command.JUMP,
        "DO_JUMP",
        _MISSION,
        has_place=False,
        has_duration=False,
        meanings=(
            Meaning(1, "number of the next item, as in the ground station", 0.0, MAX_PLAN_ITEMS - 1.0, is_integer=True),
            _TIMES,
        ),
    ),
    ItemRow(Command.JUMP_TAG, "JUMP_TAG", _MISSION, has_place=False, has_duration=False, meanings=(_TAG,)),
    ItemRow(
        Command.JUMP_TO_TAG,
        "DO_JUMP_TAG",
        _MISSION,
        has_place=False,
        has_duration=False,
        meanings=(Meaning(1, "continues with the first JUMP_TAG of this tag", 0.0, 65535.0, is_integer=True), _TIMES),
    ),
    ItemRow(
        Command.CHANGE_SPEED,
        "DO_CHANGE_SPEED",
        _MISSION,
        has_place=False,
        has_duration=False,
        meanings=(
            Meaning(1, "0: through the water, 1: over the ground", 0.0, 1.0, is_integer=True),
            Meaning(2, "speed for planning; -1: no change, -2: default", -2.0, MAX_SPEED_M_S, "m/s"),
        ),
    ),
    ItemRow(
        Command.SET_HOME,
        "DO_SET_HOME",
        _MISSION,
        has_place=True,
        has_duration=False,
        meanings=(Meaning(1, "1: the present position, 0: the given place", 0.0, 1.0, is_integer=True),),
    ),
    ItemRow(
        Command.FENCE_ENABLE,
        "DO_FENCE_ENABLE",
        _MISSION,
        has_place=False,
        has_duration=False,
        meanings=(
            Meaning(1, "1: enable the fence, 0: disable it", 0.0, 1.0, is_integer=True),
            Meaning(2, "kinds of fence; 0: all", 0.0, 0.0, allows_nan=True),
        ),
    ),
    ItemRow(
        Command.YAW_SPEED,
        "NAV_SET_YAW_SPEED",
        _MISSION,
        has_place=False,
        has_duration=True,
        meanings=(Meaning(1, _ANGLE, -360.0, 360.0, "deg"), Meaning(3, _RELATIVE, 0.0, 1.0, is_integer=True)),
    ),
    ItemRow(Command.FENCE_RETURN, "NAV_FENCE_RETURN_POINT", _FENCE, has_place=True, has_duration=False),
    ItemRow(
        Command.INCLUDED_VERTEX,
        "NAV_FENCE_POLYGON_VERTEX_INCLUSION",
        _FENCE,
        has_place=True,
        has_duration=False,
        meanings=(_VERTICES, _GROUP),
    ),
    ItemRow(
        Command.EXCLUDED_VERTEX,
        "NAV_FENCE_POLYGON_VERTEX_EXCLUSION",
        _FENCE,
        has_place=True,
        has_duration=False,
        meanings=(_VERTICES,),
    ),
    ItemRow(
        Command.INCLUDED_CIRCLE,
        "NAV_FENCE_CIRCLE_INCLUSION",
        _FENCE,
        has_place=True,
        has_duration=False,
        meanings=(_CIRCLE, _GROUP),
    ),
    ItemRow(
        Command.EXCLUDED_CIRCLE,
        "NAV_FENCE_CIRCLE_EXCLUSION",
        _FENCE,
        has_place=True,
        has_duration=False,
        meanings=(_CIRCLE,),
    ),
    ItemRow(Command.RALLY_POINT, "NAV_RALLY_POINT", _RALLY, has_place=True, has_duration=False),
)

ROWS: Mapping[int, ItemRow] = {int(row.command): row for row in TABLE}

# MAV_CMD of cameras, triggers and gimbals: plan files may contain them, although the boat has none.
CAMERA = frozenset(
    {*range(195, 199), *range(200, 207), 214, 260, *range(530, 535), 1000, 1001, *range(2000, 2006), *range(2500, 2504)}
)

# MAV_FRAME: GLOBAL and GLOBAL_RELATIVE_ALT, their _INT forms, and the two over terrain.
PLACE_FRAMES = frozenset({0, 3, 5, 6, 10, 11})
MISSION_FRAME = 2  # of items without a place


def markdown() -> str:
    """Return the table as Markdown."""
    lines = ["| plan | command | number | parameters |", "| --- | --- | --- | --- |"]
    for row in TABLE:
        meanings = [f"param{meaning.number}: {meaning.text} ({meaning.allowed()})" for meaning in row.meanings]
        text = "; ".join([*meanings, *(["a place"] if row.has_place else [])])
        lines.append(f"| {row.kind.name.lower()} | {row.name} | {int(row.command)} | {text} |")
    return "\n".join(lines) + "\n"


def has_position(command: int) -> bool:
    """Return whether x and y of a command are a position; True for unknown commands except those of cameras."""
    row = ROWS.get(command)
    return command not in CAMERA if row is None else row.has_place
