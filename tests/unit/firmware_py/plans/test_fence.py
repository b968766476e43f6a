"""Items and legs of plans outside the fence."""

import math
import random

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans, place_of
from firmware_py.plans.fence import fence_of, find_breaches, margin_m

MAX_CHECKS = 500
CENTRE = Place(0.6, 2.0)
WAYPOINT, TURNS, ENABLE, RETURN_POINT, RALLY = 16, 18, 207, 5000, 5100  # MAV_CMD
INCLUDED, EXCLUDED, INCLUDED_CIRCLE, EXCLUDED_CIRCLE = 5001, 5002, 5003, 5004


def item_at(command, north_m, east_m, *params, centre=CENTRE):
    place = centre.at_offset(north_m, east_m)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (place.latitude_rad, place.longitude_rad))
    return PlanItem(command, 3, True, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def square(command, half_m, centre=CENTRE):
    return [item_at(command, n * half_m, e * half_m, 4, centre=centre) for n, e in ((1, 1), (1, -1), (-1, -1), (-1, 1))]


def breach_texts(mission, fence, rally=()):
    plans = Plans(
        Plan.of(PlanKind.MISSION, mission), Plan.of(PlanKind.FENCE, fence), Plan.of(PlanKind.RALLY, list(rally))
    )
    return [breach.message(int(breach.kind is PlanKind.MISSION)) for breach in find_breaches(plans) if breach]


SQUARE = square(INCLUDED, 500)
REEF = [*SQUARE, item_at(EXCLUDED_CIRCLE, 0, 0, 60)]
AT_POSITION = PlanItem(WAYPOINT, 3)
DISABLE, REENABLE = PlanItem(ENABLE, 2), PlanItem(ENABLE, 2, True, (1.0, 0.0, 0.0, 0.0))
EAST, WEST = item_at(WAYPOINT, 0, 300), item_at(WAYPOINT, 10, -300)


@pytest.mark.parametrize(
    ("mission", "fence", "texts"),
    [
        ([EAST, WEST], SQUARE, []),
        ([EAST, WEST], [], []),
        ([EAST, item_at(WAYPOINT, 0, 700)], SQUARE, ["Mission item 2 is 200 m outside the fence"]),
        ([item_at(WAYPOINT, 0, 700), EAST], SQUARE, ["Mission item 1 is 200 m outside the fence"]),
        ([EAST, item_at(WAYPOINT, 0, 500)], SQUARE, []),
        ([EAST, WEST], REEF, ["Leg to mission item 2 leaves the fence by 55 m"]),
        ([EAST, AT_POSITION, WEST], REEF, []),
        ([EAST, item_at(WAYPOINT, 0, 0), WEST], REEF, ["Mission item 2 is 60 m outside the fence"]),
        ([EAST, DISABLE, item_at(WAYPOINT, 0, 700), REENABLE, WEST], SQUARE, []),
        ([DISABLE, EAST, REENABLE, item_at(WAYPOINT, 0, 700)], SQUARE, ["Mission item 4 is 200 m outside the fence"]),
        ([item_at(TURNS, 0, 400, 2, 0, -150)], SQUARE, ["Mission item 1 is 50 m outside the fence"]),
        ([item_at(TURNS, 0, 499.5, 2, 0, math.nan)], SQUARE, []),
        ([EAST], [*SQUARE, item_at(RETURN_POINT, 510, 0)], ["Fence item 4 is 10 m outside the fence"]),
    ],
)
def test_items_and_legs_outside_the_fence_are_breaches(mission, fence, texts):
    assert breach_texts(mission, fence) == texts


def test_leg_across_a_bay_is_outside():
    bay = [
        item_at(INCLUDED, n, e, 8)
        for n, e in ((0, 0), (0, 300), (200, 300), (200, 200), (100, 150), (200, 100), (200, 0))
    ]
    bay.append(item_at(INCLUDED, 100, -50, 8))
    texts = breach_texts([item_at(WAYPOINT, 180, 50), item_at(WAYPOINT, 180, 250)], bay)
    assert len(texts) == 1
    assert texts[0].startswith("Leg to mission item 2 leaves the fence by ")


def test_rally_points_are_checked_without_legs():
    assert breach_texts([], REEF, [item_at(RALLY, 0, 300), item_at(RALLY, 0, -300), item_at(RALLY, -600, 0)]) == [
        "Rally point 2 is 100 m outside the fence"
    ]


def test_fence_may_cross_the_date_line():
    centre = Place(-0.29, math.pi - 1e-5)
    fence = square(INCLUDED, 500, centre=centre)
    assert (
        breach_texts([item_at(WAYPOINT, 0, 300, centre=centre), item_at(WAYPOINT, 0, -300, centre=centre)], fence) == []
    )
    assert breach_texts([item_at(WAYPOINT, 0, 600, centre=centre)], fence) == [
        "Mission item 1 is 100 m outside the fence"
    ]


def test_error_of_the_check_of_a_leg_is_limited():
    """Comparison with 501 points on each leg, for random fences and legs."""
    rng = random.Random(5)
    breach_count = 0
    for _ in range(60):
        reefs = [
            item_at(EXCLUDED_CIRCLE, rng.uniform(-500, 500), rng.uniform(-500, 500), rng.uniform(5, 80))
            for _ in range(4)
        ]
        fence = [*square(INCLUDED, 600), *reefs]
        plan = Plan.of(PlanKind.FENCE, fence)
        ends = [(rng.uniform(-500, 500), rng.uniform(-500, 500)) for _ in range(2)]
        margins_m = [
            margin_m(plan, CENTRE.at_offset(*(a + (b - a) * number / 500 for a, b in zip(*ends, strict=True))))
            for number in range(501)
        ]
        if min(margins_m[0], margins_m[-1]) < 0.0:
            continue
        texts = breach_texts([item_at(WAYPOINT, *end) for end in ends], fence)
        assert bool(texts) >= (min(margins_m) < -1000.0 * math.sqrt(2.0) / MAX_CHECKS)
        breach_count += min(margins_m) < 0.0
    assert breach_count > 5


@pytest.mark.parametrize(("length_m", "checks"), [(998.0, 500), (9.5, 10)])
def test_leg_is_checked_each_metre_but_at_most_500_times(length_m, checks):
    mission = [item_at(WAYPOINT, 499.9, -length_m / 2.0), item_at(WAYPOINT, 499.9, length_m / 2.0)]
    plans = Plans(Plan.of(PlanKind.MISSION, mission), Plan.of(PlanKind.FENCE, SQUARE))
    assert sum(breach is None for breach in find_breaches(plans)) == checks + len(mission)


@pytest.mark.parametrize(("outside_m", "texts"), [(0.095, []), (0.105, ["Mission item 1 is 1 m outside the fence"])])
def test_item_may_be_ten_centimetres_outside(outside_m, texts):
    waypoint = item_at(WAYPOINT, 100, 0)
    margin = margin_m(Plan.of(PlanKind.FENCE, [item_at(INCLUDED_CIRCLE, 0, 0, 100)]), place_of(waypoint))
    assert breach_texts([waypoint], [item_at(INCLUDED_CIRCLE, 0, 0, 100 - margin - outside_m)]) == texts


@pytest.mark.parametrize(
    ("north_m", "east_m", "margin"),
    [
        *((0, 0, 212.13), (100, 0, 141.42), (100, 100, 70.71), (-100, 50, 106.07), (0, -250, 35.36)),
        *((200, 200, -70.71), (-200, 150, -35.36), (-20, -310, -21.21), (160, -160, -14.14)),
        *((400, 0, -100.0), (0, 350, -50.0), (30, -340, -50.0), (-340, -30, -50.0)),  # a corner is nearest
    ],
)
def test_margin_is_the_distance_to_the_nearest_edge_or_corner(north_m, east_m, margin):
    """The fence is a diamond with corners 300 m from its centre."""
    corners = [(370, -40), (70, 260), (-230, -40), (70, -340)]
    place = CENTRE.at_offset(70 + north_m, -40 + east_m)
    for command, sign in ((INCLUDED, 1.0), (EXCLUDED, -1.0)):
        for order in (corners, corners[::-1], corners[1:] + corners[:1]):
            fence = Plan.of(PlanKind.FENCE, [item_at(command, *corner, 4) for corner in order])
            assert margin_m(fence, place) == pytest.approx(sign * margin, abs=0.1)


@pytest.mark.parametrize(
    "corners", [((0, 300), (-300, 0), (0, -300), (300, 0)), ((0, 300), (300, 0), (0, -300), (-300, 0))]
)
def test_place_at_the_latitude_of_a_corner_is_inside(corners):
    items = [item_at(INCLUDED, *corner, 4) for corner in corners]
    place = Place(place_of(items[0]).latitude_rad, CENTRE.longitude_rad)
    assert margin_m(Plan.of(PlanKind.FENCE, items), place) == pytest.approx(212.13, abs=0.1)


def test_boat_must_be_inside_all_areas_of_one_group():
    place = CENTRE.at_offset(150, 0)
    for groups, margin in (((0, 0), -50.0), ((0, 1), 50.0), ((254, 255), 50.0), ((math.nan, 0), -50.0)):
        circles = [item_at(INCLUDED_CIRCLE, 0, 0, *pair) for pair in zip((100, 200), groups, strict=True)]
        assert margin_m(Plan.of(PlanKind.FENCE, circles), place) == pytest.approx(margin, abs=0.1)
    assert margin_m(Plan.of(PlanKind.FENCE, [item_at(RETURN_POINT, 0, 0)]), place) == 1e7
    at_equator = PlanItem(INCLUDED_CIRCLE, 3, True, (100.0, 0.0, 0.0, 0.0))  # 0, 0 is a place
    assert margin_m(Plan.of(PlanKind.FENCE, [at_equator]), Place(0.0, 0.0)) == 100.0


@pytest.mark.parametrize("count", [math.nan, -4.0, 0.0, 4.0, 1e9])
def test_polygon_with_an_impossible_number_of_vertices_is_ignored(count):
    """A damaged log may contain one."""
    fence = fence_of(Plan.of(PlanKind.FENCE, [*square(INCLUDED, 500), item_at(INCLUDED, 0, 0, count)]))
    assert [len(area.corners) for area in fence.areas] == [4]
