"""Fence: distance to a breach, and the items and legs of plans that are outside.

Areas are inclusion or exclusion polygons and circles. As in MAVLink, the boat must be inside all inclusion areas of at
least one group, and outside all exclusion areas. Edges are straight on the tangential plane at the first vertex, with
an error of 0.1 % over a hundred kilometres.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import MAX_PLAN_ITEMS, Plan, PlanItem, PlanKind, Plans, limit_number, place_of
from firmware_py.plans.items import MAX_DISTANCE_M, Command

MAX_CHECKS = 500  # of one leg
MIN_STEP_M = 1.0
TOLERANCE_M = 0.1  # a place is inside if its distance outside is smaller
_DESTINATIONS = frozenset(
    {Command.WAYPOINT, Command.LOITER_UNLIMITED, Command.LOITER_TURNS, Command.LOITER_TIME}
    | {Command.FENCE_RETURN, Command.RALLY_POINT}
)
_ITEM_NAMES = {PlanKind.MISSION: "Mission item", PlanKind.FENCE: "Fence item", PlanKind.RALLY: "Rally point"}

Point = tuple[float, float]


class Area(msgspec.Struct, frozen=True):
    """A polygon (corners) or a circle (centre as the only corner, radius), in metres north and east of the anchor."""

    corners: tuple[Point, ...]
    radius_m: float
    inclusion: bool
    group: int


class Fence(msgspec.Struct, frozen=True):
    """The areas of a fence and their anchor."""

    anchor: Place
    areas: tuple[Area, ...]


class Breach(msgspec.Struct, frozen=True):
    """An item at `distance_m` outside the fence or, with `is_leg`, the leg to this item with that largest distance."""

    kind: PlanKind
    index: int
    distance_m: float
    is_leg: bool

    def message(self, first_number: int) -> str:
        """Return the text; `first_number` is the number of the first item of the plan."""
        item, distance = f"{_ITEM_NAMES[self.kind]} {self.index + first_number}", f"{max(self.distance_m, 1.0):.0f} m"
        if self.is_leg:
            return f"Leg to {item.lower()} leaves the fence by {distance}"
        return f"{item} is {distance} outside the fence"


@functools.lru_cache(maxsize=4)
def fence_of(plan: Plan) -> Fence | None:
    """Convert a fence to areas, or return None if it has no area; cached."""
    if not plan.items:
        return None
    anchor = _place(plan.items[0])
    areas = []
    items = list(plan.items)
    while items:
        command = items[0].command
        if command in (Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX):
            count = round(limit_number(items[0].params[0], 1.0, MAX_PLAN_ITEMS))
            corners = tuple(_point(anchor, item) for item in items[:count] if item.command == command)
            if len(corners) >= 3:
                areas.append(Area(corners, 0.0, command == Command.INCLUDED_VERTEX, _group(items[0])))
            items = items[count:]
            continue
        if command in (Command.INCLUDED_CIRCLE, Command.EXCLUDED_CIRCLE):
            radius_m = limit_number(items[0].params[0], 0.0, MAX_DISTANCE_M)
            areas.append(
                Area((_point(anchor, items[0]),), radius_m, command == Command.INCLUDED_CIRCLE, _group(items[0]))
            )
        items = items[1:]
    return Fence(anchor, tuple(areas)) if areas else None


def _group(item: PlanItem) -> int:
    return round(limit_number(item.params[1], 0.0, 255.0))


def _place(item: PlanItem) -> Place:
    """Return the place of an item; in a fence, 0, 0 is a valid place."""
    return place_of(item) or Place(0.0, 0.0)


def _point(anchor: Place, item: PlanItem) -> Point:
    return anchor.offset_m(_place(item))


def margin_m(plan: Plan, place: Place) -> float:
    """Return the distance to a breach in metres, negative in breach; MAX_DISTANCE_M without an area."""
    fence = fence_of(plan)
    if fence is None:
        return MAX_DISTANCE_M
    return _margin_m(fence, fence.anchor.offset_m(place))


def _margin_m(fence: Fence, point: Point) -> float:
    group_margins_m: dict[int, float] = {}
    margin = MAX_DISTANCE_M
    for area in fence.areas:
        depth_m = _depth_m(area, point)
        if area.inclusion:
            group_margins_m[area.group] = min(group_margins_m.get(area.group, MAX_DISTANCE_M), depth_m)
        else:
            margin = min(margin, -depth_m)
    return min(margin, max(group_margins_m.values())) if group_margins_m else margin


def find_breaches(plans: Plans) -> Iterator[Breach | None]:
    """Yield the breaches of the plans in order, and None before each check of the fence, so that callers can pause.

    The first leg is not checked, because its start is unknown.
    """
    fence = fence_of(plans.fence)
    if fence is None:
        return
    for plan in (plans.mission, plans.fence, plans.rally):
        previous: Point | None = None
        is_enabled = True
        for index, item in enumerate(plan.items):
            if item.command == Command.FENCE_ENABLE:
                is_enabled = item.params[0] != 0.0
            if item.command not in _DESTINATIONS:
                continue
            if (place := place_of(item)) is None or not is_enabled:
                previous = None
                continue
            point = fence.anchor.offset_m(place)
            # Guidance moves loiter circles inward, except those of LOITER_TURNS.
            orbit_m = (
                limit_number(abs(item.params[2]), 0.0, MAX_DISTANCE_M) if item.command == Command.LOITER_TURNS else 0.0
            )
            yield None
            worst_m = _margin_m(fence, point) - orbit_m
            is_leg = False
            if previous is not None and worst_m >= -TOLERANCE_M:
                is_leg = True
                for margin_m in _margins_on_leg(fence, previous, point):
                    worst_m = min(worst_m, margin_m)
                    yield None
            if worst_m < -TOLERANCE_M:
                yield Breach(plan.kind, index, -worst_m, is_leg)
            previous = point if plan.kind is PlanKind.MISSION and (is_leg or worst_m >= -TOLERANCE_M) else None


def _margins_on_leg(fence: Fence, start: Point, end: Point) -> Iterator[float]:
    """Yield the margins of points on a leg; each step is the last margin, and there are at most MAX_CHECKS steps."""
    length_m = math.dist(start, end)
    at_m = 0.0
    while at_m < length_m:
        fraction = at_m / length_m
        point = start[0] + fraction * (end[0] - start[0]), start[1] + fraction * (end[1] - start[1])
        margin_m = _margin_m(fence, point)
        yield margin_m
        at_m += max(margin_m, length_m / MAX_CHECKS, MIN_STEP_M)


def _depth_m(area: Area, point: Point) -> float:
    """Return the distance of a point to the edge of an area in metres, positive inside (ray casting)."""
    if len(area.corners) == 1:
        centre = area.corners[0]
        return area.radius_m - math.hypot(point[0] - centre[0], point[1] - centre[1])
    is_inside = False
    min_square = math.inf
    north, east = point
    previous = area.corners[-1]
    for corner in area.corners:
        min_square = min(min_square, _squared_distance(previous, corner, point))
        if (previous[0] > north) is not (corner[0] > north):
            crossing = previous[1] + (north - previous[0]) * (corner[1] - previous[1]) / (corner[0] - previous[0])
            if east < crossing:
                is_inside = not is_inside
        previous = corner
    distance_m = math.sqrt(min_square)
    return distance_m if is_inside else -distance_m


def _squared_distance(start: Point, end: Point, point: Point) -> float:
    """Return the squared distance of a point to an edge."""
    along_north, along_east = end[0] - start[0], end[1] - start[1]
    north, east = point[0] - start[0], point[1] - start[1]
    length_squared = along_north * along_north + along_east * along_east
    fraction = (north * along_north + east * along_east) / length_squared if length_squared > 0.0 else 0.0
    fraction = min(max(fraction, 0.0), 1.0)
    north, east = north - fraction * along_north, east - fraction * along_east
    return north * north + east * east
