"""Polygons of a fence: assembly from their vertices, and validation.

Vertices are integers in 1e-7 degrees, so that the checks are exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from firmware_py.common.plan import PlanItem
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanProblem, PlanResult

_VERTICES = (Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX)
_FULL_CIRCLE = 3_600_000_000  # 1e-7 degrees
_MAX_EDGE_PAIRS = 20_000  # in the comparisons of one fence; about 10 ms
_MIN_EDGES = 3

Point = tuple[int, int]
Edge = tuple[Point, Point]


class Polygon(msgspec.Struct, frozen=True):
    """A polygon: the items [first_index, first_index + count) of a fence."""

    first_index: int
    count: int
    inclusion: bool


def polygons_of(items: Sequence[PlanItem]) -> Iterator[Polygon]:
    """Yield the polygons of a valid fence."""
    index = 0
    while index < len(items):
        count = 1
        if items[index].command in _VERTICES:
            count = int(items[index].params[0])
            yield Polygon(index, count, items[index].command == Command.INCLUDED_VERTEX)
        index += count


def polygons_problem(items: Sequence[PlanItem]) -> PlanProblem | None:
    """Return the problem of a second return point, or of the first polygon that is invalid or too complex."""
    returns = [index for index, item in enumerate(items) if item.command == Command.FENCE_RETURN]
    if len(returns) > 1:
        return PlanProblem(returns[1], PlanResult.INVALID, "a second fence return point")
    pairs_left = _MAX_EDGE_PAIRS
    index = 0
    while index < len(items):
        item = items[index]
        if item.command not in _VERTICES:
            index += 1
            continue
        count = int(item.params[0])
        vertices = items[index : index + count]
        for offset, vertex in enumerate(vertices):
            if vertex.command != item.command or vertex.params[0] != item.params[0]:
                text = f"vertex {offset + 1} of {count} is not one of its polygon"
                return PlanProblem(index + offset, PlanResult.INVALID_PARAM1, text)
        if len(vertices) < count:
            text = f"the polygon ends after {len(vertices)} of {count} vertices"
            return PlanProblem(len(items) - 1, PlanResult.INVALID_PARAM1, text)
        edges = _edges(vertices)
        if len(edges) < _MIN_EDGES:
            return PlanProblem(index, PlanResult.INVALID, "the polygon has fewer than 3 different vertices")
        has_crossing, pairs_left = _find_crossing(edges, pairs_left)
        if pairs_left < 0:
            return PlanProblem(
                index, PlanResult.INVALID, "the polygon is too complex to be checked; use fewer vertices"
            )
        if has_crossing:
            return PlanProblem(index, PlanResult.INVALID, "the polygon crosses itself")
        if _is_line(edges):
            return PlanProblem(index, PlanResult.INVALID, "the polygon has all its vertices on one line")
        index += count
    return None


def _edges(vertices: Sequence[PlanItem]) -> list[Edge]:
    """Return the edges of non-zero length, with continuous longitudes across the date line."""
    points: list[Point] = []
    for vertex in vertices:
        y = vertex.y
        if points:
            y += _FULL_CIRCLE * round((points[-1][1] - y) / _FULL_CIRCLE)
        points.append((vertex.x, y))
    edges = zip(points, [*points[1:], points[0]], strict=True)
    return [(start, end) for start, end in edges if start != end]


def _find_crossing(edges: Sequence[Edge], pairs_left: int) -> tuple[bool, int]:
    """Return whether two edges cross, and the number of comparisons left; negative: the comparison is incomplete."""
    spans = [[(min(start[axis], end[axis]), max(start[axis], end[axis])) for start, end in edges] for axis in (0, 1)]
    # The sweep is along the axis on which the edges are shorter relative to the polygon: fewer edges overlap there.
    overlaps = [
        sum(high - low for low, high in span) / (max(s[1] for s in span) - min(s[0] for s in span) or 1)
        for span in spans
    ]
    span = spans[0] if overlaps[0] <= overlaps[1] else spans[1]
    active: list[int] = []
    for index in sorted(range(len(edges)), key=lambda number: span[number][0]):
        start = span[index][0]
        active = [other for other in active if span[other][1] >= start]
        pairs_left -= len(active)
        if pairs_left < 0:
            return False, pairs_left
        if any(_do_cross(edges[index], edges[other]) for other in active):
            return True, pairs_left
        active.append(index)
    return False, pairs_left


def _is_line(edges: Sequence[Edge]) -> bool:
    """Return whether all vertices are within one unit of the line from the first to the farthest vertex."""
    offsets = [(x - edges[0][0][0], y - edges[0][0][1]) for (x, y), _ in edges]
    dx, dy = max(offsets, key=lambda offset: offset[0] ** 2 + offset[1] ** 2)
    return all((dx * y - dy * x) ** 2 <= dx * dx + dy * dy for x, y in offsets)


def _do_cross(edge: Edge, other: Edge) -> bool:
    """Return whether two edges cross; edges that only touch do not."""
    return _side_product(edge, other) < 0 and _side_product(other, edge) < 0


def _side_product(line: Edge, edge: Edge) -> int:
    """Return the product of the signed distances of the ends of an edge to a line: negative on different sides."""
    (ax, ay), (bx, by) = line
    dx, dy = bx - ax, by - ay
    (px, py), (qx, qy) = edge
    return (dx * (py - ay) - dy * (px - ax)) * (dx * (qy - ay) - dy * (qx - ax))
