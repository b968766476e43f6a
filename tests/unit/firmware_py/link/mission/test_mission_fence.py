"""Mission items outside the fence are reported."""

import pytest

from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans
from firmware_py.plans.items import Command


def square_fence(station, half_side=1_000):
    """Vertices around the first waypoint; half of the side in 1e-7 deg."""
    corners = ((1, 1), (1, -1), (-1, -1), (-1, 1))
    places = [(360_000_000 + x * half_side, 1_210_000_000 + y * half_side) for x, y in corners]
    params = (4.0, 0.0, 0.0, 0.0)
    return [
        station.item(n, Command.INCLUDED_VERTEX, kind=1, frame=0, x=x, y=y, params=params)
        for n, (x, y) in enumerate(places)
    ]


WARNING = "Mission item {} is 11 m outside the fence"


@pytest.mark.parametrize("identity", [0, 3])
def test_item_outside_the_fence_is_reported_after_each_change_of_mission_or_fence(make_station, texts, identity):
    station = make_station(identity=identity)
    items = [*station.mission(1), station.item(station.home_count + 1, x=360_002_000)]
    warning = WARNING.format(station.home_count + 1)
    station.upload(square_fence(station), 1)
    assert warning not in texts(station.rig.ticks(3))
    for _ in range(2):
        station.upload(items)
        assert texts(station.rig.ticks(3)).count(warning) == 1
        assert warning not in texts(station.rig.ticks(3))
    station.upload(square_fence(station, half_side=3_000), 1)
    assert not [text for text in texts(station.rig.ticks(3)) if "outside" in text]
    station.upload(square_fence(station), 1)
    assert texts(station.rig.ticks(3)).count(warning) == 1


def test_several_items_outside_the_fence_are_reported_in_one_text(station, texts):
    station.upload(square_fence(station), 1)
    station.upload([*station.mission(1), *(station.item(n, x=360_002_000) for n in range(2, 52))])
    assert texts(station.rig.ticks(5)) == [f"{WARNING.format(2)}, and 49 more"]


def test_checks_of_a_large_fence_are_distributed_over_ticks(station, texts):
    """A tick checks about 500 corners, or the whole fence once."""
    corners = [
        PlanItem(Command.EXCLUDED_CIRCLE, 0, True, (1.0, 0.0, 0.0, 0.0), 370_000_000 + n, 1_210_000_000)
        for n in range(999)
    ]
    station.handler.stored_plans = Plans(
        Plan.of(
            PlanKind.MISSION, [PlanItem(Command.WAYPOINT, 3, x=360_002_000, y=1_210_000_000 + n) for n in range(20)]
        ),
        Plan.of(
            PlanKind.FENCE,
            [*corners, PlanItem(Command.INCLUDED_CIRCLE, 0, True, (11.1, 0, 0, 0), 360_000_000, 1_210_000_000)],
        ),
    )
    reported = [len(texts(station.rig.tick())) for _ in range(50)]
    assert (reported.index(1), sum(reported)) == (40, 1)  # 20 items, 20 legs
