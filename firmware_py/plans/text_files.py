"""Text files of plans: `QGC WPL 110` (.waypoints) for all kinds, and older fence and rally files of MAVProxy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from msgspec.structs import replace

from firmware_py.common.parameters import format_value
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans.items import ROWS, Command, has_position
from firmware_py.plans.numbers import PlanFileError, add_location, make_item, read_integer, read_number, scale_position

HEADER = "QGC WPL 110"
_COLUMNS = 12
_GLOBAL, _RELATIVE = 0, 3  # MAV_FRAME

Line = tuple[int, list[str]]  # number in the file, and words


def split_lines(text: str) -> list[Line]:
    """Return the numbers and words of the lines that are not empty; comments are removed."""
    lines = [(number, line.split("#", 1)[0].split()) for number, line in enumerate(text.splitlines(), start=1)]
    return [line for line in lines if line[1]]


def read_text(text: str, source: str, *, home: bool = True) -> Plan:
    """Read a plan; the first line defines the format. `home`: item 0 of a mission is home. Raise PlanFileError."""
    lines = split_lines(text)
    first_line = " ".join(lines[0][1]) if lines else ""
    if first_line == HEADER:
        return _read_waypoints(lines[1:], source, home=home)
    if first_line.split(" ")[0].upper() == "RALLY":
        return Plan.of(PlanKind.RALLY, _read_items(lines, source, _read_rally_point))
    if lines and len(lines[0][1]) == 2:
        return _read_mavproxy_fence(lines, source)
    raise PlanFileError(
        f"{source}: not a supported plan file; use a .plan of QGroundControl, {HEADER} (.waypoints), "
        "or a fence or rally file of MAVProxy"
    )


def _read_items(lines: Iterable[Line], source: str, make: Callable[[list[str]], PlanItem]) -> list[PlanItem]:
    items = []
    for number, words in lines:
        try:
            items.append(make(words))
        except PlanFileError as error:
            raise add_location(source, f":{number}", error) from None
    return items


def _read_waypoints(lines: Sequence[Line], source: str, *, home: bool) -> Plan:
    for expected, (number, words) in enumerate(lines):
        if len(words) != _COLUMNS:
            raise PlanFileError(f"{source}:{number}: {len(words)} columns instead of {_COLUMNS}")
        if words[0] != str(expected):
            raise PlanFileError(f"{source}:{number}: item {words[0][:20]!r} instead of {expected}; number them from 0")
    kind = _find_kind(lines, source)
    home_count = int(home and kind is PlanKind.MISSION)
    if not lines:
        raise PlanFileError(f"{source}: no items, so that the kind of plan is unknown; clear a plan with a .plan file")
    items = _read_items(lines[home_count:], source, _read_waypoint)
    return Plan.of(kind, [_shift_jump(item, -home_count) for item in items])


def _find_kind(lines: Sequence[Line], source: str) -> PlanKind:
    """Return the kind of plan by its commands; item 0 is ignored, because it may be home."""
    for number, words in lines[1:] or lines:
        try:
            row = ROWS.get(read_integer(words[3], 0xFFFF))
        except PlanFileError as error:
            raise add_location(source, f":{number}", error) from None
        if row is not None:
            return row.kind
    return PlanKind.MISSION


def _read_waypoint(words: list[str]) -> PlanItem:
    frame, command = read_integer(words[2], 0xFF), read_integer(words[3], 0xFFFF)
    params = [read_number(word) for word in words[4:11]]
    return make_item(command, frame, params, autocontinue=bool(read_integer(words[11], 1)))


def _shift_jump(item: PlanItem, shift: int) -> PlanItem:
    if item.command != Command.JUMP:
        return item
    return replace(item, params=(item.params[0] + shift, *item.params[1:]))


def _read_rally_point(words: list[str]) -> PlanItem:
    if len(words) != 7 or words[0].upper() != "RALLY":
        raise PlanFileError("expected RALLY LATITUDE LONGITUDE ALTITUDE BREAK_ALTITUDE DIRECTION FLAGS")
    latitude_deg, longitude_deg, altitude_m = (read_number(word) for word in words[1:4])
    params = [0.0, 0.0, 0.0, 0.0, latitude_deg, longitude_deg, altitude_m]
    return make_item(int(Command.RALLY_POINT), _RELATIVE, params, autocontinue=True)


def _read_mavproxy_fence(lines: Sequence[Line], source: str) -> Plan:
    """Read an older fence of MAVProxy: return point, vertices, and the first vertex again."""

    def read_corner(words: list[str]) -> PlanItem:
        if len(words) != 2:
            raise PlanFileError("expected LATITUDE LONGITUDE")
        x, y = scale_position(read_number(words[0]), read_number(words[1]))
        return PlanItem(int(Command.INCLUDED_VERTEX), _GLOBAL, x=x, y=y)

    return_point, *corners = _read_items(lines, source, read_corner)
    if len(corners) < 4 or (corners[0].x, corners[0].y) != (corners[-1].x, corners[-1].y):
        raise PlanFileError(
            f"{source}: a fence needs its return point, at least 3 vertices, and the first vertex again at the end"
        )
    count = float(len(corners) - 1)
    vertices = [replace(vertex, params=(count, 0.0, 0.0, 0.0)) for vertex in corners[:-1]]
    return Plan.of(PlanKind.FENCE, [replace(return_point, command=int(Command.FENCE_RETURN)), *vertices])


def write_text(plan: Plan) -> str:
    """Write a plan as `QGC WPL 110`; home of a mission is 0, 0, because it is not part of the plan."""
    home_count = int(plan.kind is PlanKind.MISSION)
    homes = [PlanItem(int(Command.WAYPOINT))] * home_count
    items = [*homes, *(_shift_jump(item, home_count) for item in plan.items)]
    lines = [HEADER]
    for number, item in enumerate(items):
        x, y = str(item.x), str(item.y)
        if has_position(item.command):
            x, y = f"{item.x * 1e-7:.7f}", f"{item.y * 1e-7:.7f}"
        params = [_format_single(value) for value in item.params]
        header = [number, int(number == 0), item.frame, item.command]
        lines.append("\t".join(map(str, [*header, *params, x, y, _format_single(item.z), int(item.autocontinue)])))
    return "\n".join(lines) + "\n"


def _format_single(value: float) -> str:
    """Format a number so that reading gives the same single-precision value, including the sign of zero."""
    if math.isnan(value):
        return "nan"
    return format_value(value) if value else f"{value:g}"
