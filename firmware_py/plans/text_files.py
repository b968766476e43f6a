"""Text files of plans: `QGC WPL 110` (.waypoints) for all kinds, and MAVProxy's older fences and rally points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from msgspec.structs import replace

from firmware_py.common.parameters import format_value
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans.items import ROWS, Command, has_position
from firmware_py.plans.numbers import PlanFileError, located, make_item, read_number, read_whole, scale_place

HEADER = "QGC WPL 110"
_COLUMNS = 12
_GLOBAL, _RELATIVE = 0, 3  # MAV_FRAME

Line = tuple[int, list[str]]  # number in the file, and words


def lines_of(text: str) -> list[Line]:
    """Return the lines with content."""
    lines = [(number, line.split("#", 1)[0].split()) for number, line in enumerate(text.splitlines(), start=1)]
    return [line for line in lines if line[1]]


def read_text(text: str, source: str, *, home: bool = True) -> Plan:
    """Read a text format, recognised by its first line; `home`: item 0 of a mission is home."""
    lines = lines_of(text)
    first = " ".join(lines[0][1]) if lines else ""
    if first == HEADER:
        return _waypoints(lines[1:], source, home=home)
    if first.split(" ")[0].upper() == "RALLY":
        return Plan.of(PlanKind.RALLY, _each(lines, source, _rally_point))
    if lines and len(lines[0][1]) == 2:
        return _old_fence(lines, source)
    raise PlanFileError(
        f"{source}: not a supported plan file; use a .plan of QGroundControl, {HEADER} (.waypoints), "
        "or a fence or rally file of MAVProxy"
    )


def _each(lines: Iterable[Line], source: str, make: Callable[[list[str]], PlanItem]) -> list[PlanItem]:
    items = []
    for number, words in lines:
        try:
            items.append(make(words))
        except PlanFileError as error:
            raise located(source, f":{number}", error) from None
    return items


def _waypoints(lines: Sequence[Line], source: str, *, home: bool) -> Plan:
    for expected, (number, words) in enumerate(lines):
        if len(words) != _COLUMNS:
            raise PlanFileError(f"{source}:{number}: {len(words)} columns instead of {_COLUMNS}")
        if words[0] != str(expected):
            raise PlanFileError(f"{source}:{number}: item {words[0][:20]!r} instead of {expected}; number them from 0")
    kind = _kind(lines, source)
    home_count = int(home and kind is PlanKind.MISSION)
    if not lines:
        raise PlanFileError(f"{source}: no items, so that the kind of plan is unknown; clear a plan with a .plan file")
    items = _each(lines[home_count:], source, _waypoint)
    return Plan.of(kind, [_shift_jump(item, -home_count) for item in items])


def _kind(lines: Sequence[Line], source: str) -> PlanKind:
    """Return the kind of plan by its commands; item 0 does not count, because it may be home."""
    for number, words in lines[1:] or lines:
        try:
            row = ROWS.get(read_whole(words[3], 0xFFFF))
        except PlanFileError as error:
            raise located(source, f":{number}", error) from None
        if row is not None:
            return row.kind
    return PlanKind.MISSION


def _waypoint(words: list[str]) -> PlanItem:
    frame, command = read_whole(words[2], 0xFF), read_whole(words[3], 0xFFFF)
    params = [read_number(word) for word in words[4:11]]
    return make_item(command, frame, params, autocontinue=bool(read_whole(words[11], 1)))


def _shift_jump(item: PlanItem, by: int) -> PlanItem:
    if item.command != Command.JUMP:
        return item
    return replace(item, params=(item.params[0] + by, *item.params[1:]))


def _rally_point(words: list[str]) -> PlanItem:
    if len(words) != 7 or words[0].upper() != "RALLY":
        raise PlanFileError("expected RALLY LATITUDE LONGITUDE ALTITUDE BREAK_ALTITUDE DIRECTION FLAGS")
    latitude_deg, longitude_deg, altitude_m = (read_number(word) for word in words[1:4])
    params = [0.0, 0.0, 0.0, 0.0, latitude_deg, longitude_deg, altitude_m]
    return make_item(int(Command.RALLY_POINT), _RELATIVE, params, autocontinue=True)


def _old_fence(lines: Sequence[Line], source: str) -> Plan:
    """Read an older fence of MAVProxy: return point, vertices, and the first vertex again."""

    def corner(words: list[str]) -> PlanItem:
        if len(words) != 2:
            raise PlanFileError("expected LATITUDE LONGITUDE")
        x, y = scale_place(read_number(words[0]), read_number(words[1]))
        return PlanItem(int(Command.INCLUDED_VERTEX), _GLOBAL, x=x, y=y)

    return_point, *corners = _each(lines, source, corner)
    if len(corners) < 4 or (corners[0].x, corners[0].y) != (corners[-1].x, corners[-1].y):
        raise PlanFileError(
            f"{source}: a fence needs its return point, at least 3 vertices, and the first vertex again at the end"
        )
    count = float(len(corners) - 1)
    vertices = [replace(vertex, params=(count, 0.0, 0.0, 0.0)) for vertex in corners[:-1]]
    return Plan.of(PlanKind.FENCE, [replace(return_point, command=int(Command.FENCE_RETURN)), *vertices])


def write_text(plan: Plan) -> str:
    """Write a plan as `QGC WPL 110`; the home of a mission is 0, 0, because only the boat knows it."""
    home_count = int(plan.kind is PlanKind.MISSION)
    homes = [PlanItem(int(Command.WAYPOINT))] * home_count
    items = [*homes, *(_shift_jump(item, home_count) for item in plan.items)]
    lines = [HEADER]
    for number, item in enumerate(items):
        x, y = str(item.x), str(item.y)
        if has_position(item.command):
            x, y = f"{item.x * 1e-7:.7f}", f"{item.y * 1e-7:.7f}"
        params = [_single_text(value) for value in item.params]
        head = [number, int(number == 0), item.frame, item.command]
        lines.append("\t".join(map(str, [*head, *params, x, y, _single_text(item.z), int(item.autocontinue)])))
    return "\n".join(lines) + "\n"


def _single_text(value: float) -> str:
    """Write a number that reads back as the same single-precision value, including the sign of zero."""
    if math.isnan(value):
        return "nan"
    return format_value(value) if value else f"{value:g}"
