"""Plans as messages of ArduPilot."""

import pytest

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.log import ardupilot_formats
from firmware_py.log.ardupilot_formats import FENCE, MISSION_ITEM, RALLY
from firmware_py.log.ardupilot_plans import encode_plan
from firmware_py.log.dataflash import Format
from firmware_py.plans.items import Command


def rows_of(kind, plan, identity=3):
    """Return the messages of a plan, without the time; identity 3 is that of ArduPilot."""
    data = encode_plan(2.5, plan, identity)
    layout = Format(kind.number, kind.size, kind.name, kind.values, kind.labels)
    rows = [layout.unpack(data, offset) for offset in range(0, len(data), layout.length)]
    assert {row[0] for row in rows} == {2_500_000}
    return [row[1:] for row in rows]


def test_positions_have_seven_decimals_and_numbers_no_multiplier():
    kind = ardupilot_formats._message_type(200, "X", "I,N,Lat,Lng,M", "BBLLf", "#-DUm")
    assert (kind.labels, kind.values, kind.units) == ("TimeUS,I,N,Lat,Lng,M", "QBBLLf", "s#-DUm")
    assert kind.multipliers == "F--GG0"


def test_mission_items_are_numbered_from_home():
    items = [
        PlanItem(Command.WAYPOINT, 3, params=(1.0, 2.0, 3.0, 4.0), x=11, y=-12, z=5.0),
        PlanItem(Command.JUMP, 2, params=(0.0, 7.0, 0.0, 0.0), x=13, y=14, z=6.0),
    ]
    assert rows_of(MISSION_ITEM, Plan.of(PlanKind.MISSION, items)) == [
        (3, 1, Command.WAYPOINT, 1.0, 2.0, 3.0, 4.0, 11, -12, 5.0, 3),
        (3, 2, Command.JUMP, 1.0, 7.0, 0.0, 0.0, 0, 0, 6.0, 2),  # it has a target and no position
    ]


@pytest.mark.parametrize(
    ("command", "kind", "count", "radius_m"),
    [
        (Command.INCLUDED_VERTEX, 98, 3, 0.0),
        (Command.EXCLUDED_VERTEX, 97, 3, 0.0),
        (Command.FENCE_RETURN, 95, 0, 0.0),
        (Command.EXCLUDED_CIRCLE, 93, 0, 2.75),
        (Command.INCLUDED_CIRCLE, 92, 0, 2.75),
    ],
)
def test_fence_items_have_the_types_of_ardupilot(command, kind, count, radius_m):
    items = [PlanItem(int(command), 0, params=(2.75, 0, 0, 0), x=11, y=-12)]
    assert rows_of(FENCE, Plan.of(PlanKind.FENCE, items)) == [(1, 0, kind, 11, -12, count, radius_m)]


def test_rally_points_have_their_altitude():
    items = [PlanItem(Command.RALLY_POINT, 3, x=11, y=-12, z=1.5), PlanItem(Command.RALLY_POINT, 3, x=13, y=14, z=2.5)]
    assert rows_of(RALLY, Plan.of(PlanKind.RALLY, items)) == [(2, 0, 11, -12, 1.5, 0), (2, 1, 13, 14, 2.5, 0)]
