"""The fence: how far the boat is from breaching it.

Areas are polygons and circles, to stay within or to stay out of. As MAVLink has it, the boat
must be inside all inclusion areas of at least one group, and outside every exclusion.
Edges are straight on the plane that touches the fence's first corner, which is good to
0.1 % over a hundred kilometres.
"""

from __future__ import annotations

import functools
import math

import msgspec

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import MOST_ITEMS, Plan, PlanItem
from firmware_py.guidance.mission_step import number, place_of
from firmware_py.plans.items import FARTHEST_M, Command

# The distance is computed anew when the boat has gone this part of the last one, or so far.
MOVED_PART, MOVED_M = 0.1, 2.0

Point = tuple[float, float]


class Area(msgspec.Struct, frozen=True):
    """A polygon (corners) or a circle (one corner and a radius), in metres north and east of the anchor."""

    corners: tuple[Point, ...]
    radius_m: float
    inclusion: bool
    group: int = 0


class Fence(msgspec.Struct, frozen=True):
    """The areas of a fence around their anchor."""

    anchor: Place
    areas: tuple[Area, ...]


class FenceState(msgspec.Struct, frozen=True):
    """The margin at a place, of the fence with checksum `identity`; kept until the boat has moved."""

    identity: int = 0
    place: Place | None = None
    margin_m: float = FARTHEST_M


@functools.lru_cache(maxsize=4)
def fence_of(plan: Plan) -> Fence | None:
    """Convert a fence, once; None when nothing of it bounds the boat."""
    if not plan.items:
        return None
    anchor = _place(plan.items[0])
    areas = []
    items = list(plan.items)
    while items:
        command = items[0].command
        if command in (Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX):
            count = round(number(items[0].params[0], 1.0, MOST_ITEMS))
            corners = tuple(_point(anchor, item) for item in items[:count] if item.command == command)
            if len(corners) >= 3:
                areas.append(Area(corners, 0.0, command == Command.INCLUDED_VERTEX, _group(items[0])))
            items = items[count:]
            continue
        if command in (Command.INCLUDED_CIRCLE, Command.EXCLUDED_CIRCLE):
            radius_m = number(items[0].params[0], 0.0, FARTHEST_M)
            areas.append(
                Area((_point(anchor, items[0]),), radius_m, command == Command.INCLUDED_CIRCLE, _group(items[0]))
            )
        items = items[1:]
    return Fence(anchor, tuple(areas)) if areas else None


def _group(item: PlanItem) -> int:
    return round(number(item.params[1], 0.0, 255.0))


def _place(item: PlanItem) -> Place:
    """Return the place of an item; 0, 0 is a corner like any other, and not where the boat is."""
    return place_of(item) or Place(0.0, 0.0)


def _point(anchor: Place, item: PlanItem) -> Point:
    return anchor.offset_m(_place(item))


def margin_m(plan: Plan, place: Place) -> float:
    """Return the distance to a breach, negative in breach; FARTHEST_M where no area bounds the boat."""
    fence = fence_of(plan)
    if fence is None:
        return FARTHEST_M
    here = fence.anchor.offset_m(place)
    inside: dict[int, float] = {}
    margin = FARTHEST_M
    for area in fence.areas:
        # Positive within the area.
        depth_m = _depth_m(area, here)
        if area.inclusion:
            inside[area.group] = min(inside.get(area.group, FARTHEST_M), depth_m)
        else:
            margin = min(margin, -depth_m)
    return min(margin, max(inside.values())) if inside else margin


def update(state: FenceState, plan: Plan, place: Place) -> FenceState:
    """Return the state with the margin at a place, computed anew when the boat has moved."""
    if state.identity == plan.identity and state.place is not None:
        moved_m, _ = state.place.distance_and_bearing(place)
        if moved_m <= max(MOVED_M, MOVED_PART * abs(state.margin_m)):
            return state
    return FenceState(plan.identity, place, margin_m(plan, place))


def _depth_m(area: Area, here: Point) -> float:
    if len(area.corners) == 1:
        centre = area.corners[0]
        return area.radius_m - math.hypot(here[0] - centre[0], here[1] - centre[1])
    inside = False
    nearest = math.inf
    north, east = here
    before = area.corners[-1]
    for corner in area.corners:
        nearest = min(nearest, _square_to_edge(before, corner, here))
        if (before[0] > north) is not (corner[0] > north):
            crossing = before[1] + (north - before[0]) * (corner[1] - before[1]) / (corner[0] - before[0])
            if east < crossing:
                inside = not inside
        before = corner
    distance_m = math.sqrt(nearest)
    return distance_m if inside else -distance_m


def _square_to_edge(start: Point, end: Point, here: Point) -> float:
    along_north, along_east = end[0] - start[0], end[1] - start[1]
    north, east = here[0] - start[0], here[1] - start[1]
    square = along_north * along_north + along_east * along_east
    part = (north * along_north + east * along_east) / square if square > 0.0 else 0.0
    part = min(max(part, 0.0), 1.0)
    north, east = north - part * along_north, east - part * along_east
    return north * north + east * east
