"""Polygons of a fence: assembly and validation."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans.items import Command
from firmware_py.plans.polygons import polygons_of
from firmware_py.plans.problem import PlanResult
from firmware_py.plans.validation import problem_of

INCLUDED_VERTEX, EXCLUDED_VERTEX = Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX
INCLUDED_CIRCLE, FENCE_RETURN = Command.INCLUDED_CIRCLE, Command.FENCE_RETURN


def problem(*items):
    """Return index and result of the problem of a fence; None if it is valid."""
    refusal = problem_of(Plan.of(PlanKind.FENCE, items))
    return None if refusal is None else (refusal.index, refusal.result)


def item(command, param1=0.0):
    return PlanItem(command, 6, params=(param1, 0.0, 0.0, 0.0), x=1, y=1)


def ring(*points, command=INCLUDED_VERTEX, count=None):
    """Return the items of a polygon with these vertices (latitude, longitude) in 1e-7 degrees."""
    return [replace(item(command, len(points) if count is None else count), x=x, y=y, frame=0) for x, y in points]


SQUARE = ((0, 0), (0, 100), (100, 100), (100, 0))


def test_polygons_are_assembled():
    items = [*ring(*SQUARE), item(INCLUDED_CIRCLE, 5.0), *ring((0, 0), (0, 9), (9, 0), command=EXCLUDED_VERTEX)]
    plan = Plan.of(PlanKind.FENCE, items)
    assert problem_of(plan) is None
    polygons = [(polygon.first_index, polygon.count, polygon.inclusion) for polygon in polygons_of(plan.items)]
    assert polygons == [(0, 4, True), (5, 3, False)]


WEST, EAST = -1_799_999_900, 1_799_999_900
SAW = [(0, -5000), *((10 * number, 1000 * (number % 2)) for number in range(300)), (3000, -5000)]


@pytest.mark.parametrize(
    "points",
    [
        SQUARE,
        (*SQUARE, SQUARE[0]),
        ((0, 0), (0, 0), (0, 100), (100, 100)),
        ((0, EAST), (0, WEST), (100, WEST), (100, EAST)),
        ((0, 0), (100, 50), (0, 100), (50, 50)),
        ((0, 0), (1000, 0), (500, 2)),
        # The farthest vertex has a small or a negative coordinate.
        *(((0, 0), (50, 100), (0, 300)), ((0, 0), (-300, 10), (-100, 50)), ((0, 0), (10, -300), (50, -100))),
        # All edges overlap along one axis only.
        *([point[::step] for point in SAW] for step in (1, -1)),
        tuple(
            (round(1e6 * math.cos(a / 250 * math.tau)), round(1e6 * math.sin(a / 250 * math.tau))) for a in range(250)
        ),
    ],
)
@pytest.mark.parametrize("command", [INCLUDED_VERTEX, EXCLUDED_VERTEX])
def test_valid_polygon_is_accepted(points, command):
    assert problem(*ring(*points, command=command)) is None


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        (ring(*SQUARE)[:3], (2, PlanResult.INVALID_PARAM1)),
        ([*ring(*SQUARE)[:3], *ring(*SQUARE[:1], command=EXCLUDED_VERTEX, count=4)], (3, PlanResult.INVALID_PARAM1)),
        ([*ring(*SQUARE[:2], count=3), *ring(SQUARE[2], count=4)], (2, PlanResult.INVALID_PARAM1)),
        ([*ring(*SQUARE)[:3], item(INCLUDED_CIRCLE, 5.0)], (3, PlanResult.INVALID_PARAM1)),
        (ring((0, 0), (0, 0), (0, 100)), (0, PlanResult.INVALID)),
        (ring((0, 0), (0, 0), (0, 0)), (0, PlanResult.INVALID)),
        (ring((0, 0), (100, 100), (0, 100), (100, 0)), (0, PlanResult.INVALID)),
        (ring((0, EAST), (100, WEST), (0, WEST), (100, EAST)), (0, PlanResult.INVALID)),
        ([item(FENCE_RETURN), item(INCLUDED_CIRCLE, 5.0), item(FENCE_RETURN)], (2, PlanResult.INVALID)),
    ],
)
def test_invalid_polygon_is_refused(items, expected):
    assert problem(*items) == expected


def test_fence_of_more_than_twenty_thousand_pairs_of_edges_is_refused():
    zigzag = [(100_000 * (index % 2) + index // 2, 100_000 * (index % 2) - index // 2) for index in range(198)]
    large = ring(*zigzag, (600, -610))  # 199 edges: 19,701 compared pairs, as each overlaps all others along both axes
    square, triangle = ring(*SQUARE), ring(*SQUARE[:3])  # 5 and 3 compared pairs
    assert problem(*large, *square, *triangle * 98) is None
    refusal = problem_of(Plan.of(PlanKind.FENCE, [*large, *triangle * 100]))
    assert (refusal.index, refusal.text) == (496, "the polygon is too complex to be checked; use fewer vertices")


@pytest.mark.parametrize(
    "points",
    [
        ((0, 0), (0, 100), (0, 200)),
        ((0, 0), (1000, 0), (500, 1)),
        ((5, 5), (50_005, 100_005), (100_005, 200_005), (25_006, 50_005)),  # within the resolution of the coordinates
        ((0, EAST), (100, EAST + 100), (200, WEST)),
        ((0, 0), (100, 100), (0, 0), (300, 300)),
    ],
)
@pytest.mark.parametrize("command", [INCLUDED_VERTEX, EXCLUDED_VERTEX])
def test_polygon_with_all_vertices_on_one_line_is_refused(points, command):
    refusal = problem_of(Plan.of(PlanKind.FENCE, [item(INCLUDED_CIRCLE, 5.0), *ring(*points, command=command)]))
    assert (refusal.index, refusal.result) == (1, PlanResult.INVALID)
    assert refusal.text == "the polygon has all its vertices on one line"


@given(st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=3, max_size=9))
def test_crossing_agrees_with_a_comparison_of_all_pairs(points):
    def side(a, b, p):
        return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])

    def cross(edge, other):
        (a, b), (c, d) = edge, other
        return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0

    edges = list(zip(points, [*points[1:], points[0]], strict=True))
    has_crossing = any(cross(edge, other) for edge in edges for other in edges)
    refusal = problem_of(Plan.of(PlanKind.FENCE, ring(*points)))
    text = "" if refusal is None else refusal.text
    assert (text == "the polygon crosses itself") == (has_crossing and "different" not in text)
