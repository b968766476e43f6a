"""What of the plans the fence would end."""

import math
import random

import pytest

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.plans.fence import MAX_CHECKS, breaches, margin_m

CENTRE = Place(0.6, 2.0)
WAYPOINT, TURNS, ENABLE, RETURN_POINT, INCLUDED, EXCLUDED, CIRCLE, RALLY = 16, 18, 207, 5000, 5001, 5002, 5004, 5100


def at(command, north_m, east_m, *params, centre=CENTRE):
    place = centre.at_offset(north_m, east_m)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (place.latitude_rad, place.longitude_rad))
    return PlanItem(command, 3, True, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def square(command, half_m, **more):
    return [at(command, n * half_m, e * half_m, 4, **more) for n, e in ((1, 1), (1, -1), (-1, -1), (-1, 1))]


def found(mission, fence, rally=()):
    plans = Plans(
        Plan.of(PlanKind.MISSION, mission), Plan.of(PlanKind.FENCE, fence), Plan.of(PlanKind.RALLY, list(rally))
    )
    return [breach.message(int(breach.kind is PlanKind.MISSION)) for breach in breaches(plans) if breach]


SQUARE = square(INCLUDED, 500)
REEF = [*SQUARE, at(CIRCLE, 0, 0, 60)]
HERE = PlanItem(WAYPOINT, 3)
NO_FENCE, FENCE_AGAIN = PlanItem(ENABLE, 2), PlanItem(ENABLE, 2, True, (1.0, 0.0, 0.0, 0.0))
EAST, WEST = at(WAYPOINT, 0, 300), at(WAYPOINT, 10, -300)


@pytest.mark.parametrize(
    ("mission", "fence", "texts"),
    [
        ([EAST, WEST], SQUARE, []),
        ([EAST, WEST], [], []),
        ([EAST, at(WAYPOINT, 0, 700)], SQUARE, ["Mission item 2 is 200 m outside the fence"]),
        ([at(WAYPOINT, 0, 700), EAST], SQUARE, ["Mission item 1 is 200 m outside the fence"]),
        ([EAST, at(WAYPOINT, 0, 500)], SQUARE, []),
        ([EAST, WEST], REEF, ["Leg to mission item 2 leaves the fence by 55 m"]),
        ([EAST, HERE, WEST], REEF, []),
        ([EAST, at(WAYPOINT, 0, 0), WEST], REEF, ["Mission item 2 is 60 m outside the fence"]),
        ([EAST, NO_FENCE, at(WAYPOINT, 0, 700), FENCE_AGAIN, WEST], SQUARE, []),
        ([NO_FENCE, EAST, FENCE_AGAIN, at(WAYPOINT, 0, 700)], SQUARE, ["Mission item 4 is 200 m outside the fence"]),
        ([at(TURNS, 0, 400, 2, 0, -150)], SQUARE, ["Mission item 1 is 50 m outside the fence"]),
        ([at(TURNS, 0, 400, 2, 0, math.nan)], SQUARE, []),
        ([EAST], [*SQUARE, at(RETURN_POINT, 510, 0)], ["Fence item 4 is 10 m outside the fence"]),
    ],
)
def test_breaches_of_a_mission(mission, fence, texts):
    assert found(mission, fence) == texts


def test_a_leg_across_a_bay_leaves_the_fence():
    bay = [
        at(INCLUDED, n, e, 8) for n, e in ((0, 0), (0, 300), (200, 300), (200, 200), (100, 150), (200, 100), (200, 0))
    ]
    bay.append(at(INCLUDED, 100, -50, 8))
    texts = found([at(WAYPOINT, 180, 50), at(WAYPOINT, 180, 250)], bay)
    assert len(texts) == 1
    assert texts[0].startswith("Leg to mission item 2 leaves the fence by ")


def test_rally_points_are_checked_one_by_one():
    assert found([], REEF, [at(RALLY, 0, 300), at(RALLY, 0, -300), at(RALLY, -600, 0)]) == [
        "Rally point 2 is 100 m outside the fence"
    ]


def test_the_date_line_is_no_fence():
    centre = Place(-0.29, math.pi - 1e-5)
    fence = square(INCLUDED, 500, centre=centre)
    assert found([at(WAYPOINT, 0, 300, centre=centre), at(WAYPOINT, 0, -300, centre=centre)], fence) == []
    assert found([at(WAYPOINT, 0, 600, centre=centre)], fence) == ["Mission item 1 is 100 m outside the fence"]


def test_a_leg_is_checked_with_a_bounded_error():
    """Against a dense walk along the way, over random fences and ways."""
    draws = random.Random(5)
    missed = 0
    for _ in range(60):
        reefs = [at(CIRCLE, draws.uniform(-500, 500), draws.uniform(-500, 500), draws.uniform(5, 80)) for _ in range(4)]
        fence = [*square(INCLUDED, 600), *reefs]
        plan = Plan.of(PlanKind.FENCE, fence)
        ends = [(draws.uniform(-500, 500), draws.uniform(-500, 500)) for _ in range(2)]
        walk = [
            margin_m(plan, CENTRE.at_offset(*(a + (b - a) * part / 500 for a, b in zip(*ends, strict=True))))
            for part in range(501)
        ]
        if min(walk[0], walk[-1]) < 0.0:
            continue
        texts = found([at(WAYPOINT, *end) for end in ends], fence)
        assert bool(texts) >= (min(walk) < -1000.0 * math.sqrt(2.0) / MAX_CHECKS)
        missed += min(walk) < 0.0
    assert missed > 5


def test_the_checks_of_a_fence_are_bounded():
    alongside = [at(WAYPOINT, 499.9, -499.0), at(WAYPOINT, 499.9, 499.0)]
    plans = Plans(Plan.of(PlanKind.MISSION, alongside), Plan.of(PlanKind.FENCE, SQUARE))
    assert sum(breach is None for breach in breaches(plans)) <= MAX_CHECKS + 3
