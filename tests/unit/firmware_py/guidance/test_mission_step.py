"""Conversion of mission items."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.guidance.mission_commands import TABLE as COMMANDS
from firmware_py.guidance.mission_step import MissionStep, convert_item, convert_mission
from firmware_py.plans.items import TABLE, Command

NAN = math.nan
TAKEOFF = 22  # MAV_CMD of an item that is skipped


def item(command, *params, x=0, y=0, autocontinue=True):
    return PlanItem(command, 3, autocontinue, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def waypoint(place=None, radius_m=None, seconds=0.0, *, autocontinue=True):
    return MissionStep(Command.WAYPOINT, place, radius_m, seconds, autocontinue=autocontinue)


def delay(seconds, time_of_day_s=None):
    return MissionStep(Command.DELAY, seconds=seconds, time_of_day_s=time_of_day_s)


def heading(command, angle_deg, *, relative=False):
    return MissionStep(command, angle_rad=math.radians(angle_deg), relative=relative)


PLACE_X_Y = {"x": 360000000, "y": 1210000000}
PLACE = Place(math.radians(36.0), math.radians(121.0))


@pytest.mark.parametrize(
    ("plan_item", "step"),
    [
        (item(Command.WAYPOINT, 30, 12.5, autocontinue=False), waypoint(None, 12.5, 30.0, autocontinue=False)),
        (item(Command.WAYPOINT, -5, -12.5, **PLACE_X_Y), waypoint(PLACE, 12.5)),
        (item(Command.WAYPOINT, NAN, NAN), waypoint()),
        (item(Command.LOITER_UNLIMITED), MissionStep(Command.LOITER_UNLIMITED)),
        (item(Command.LOITER_UNLIMITED, 0, 0, 100_001), MissionStep(Command.LOITER_UNLIMITED, radius_m=100_000.0)),
        (
            item(Command.LOITER_TURNS, 3, 0, -40),
            MissionStep(Command.LOITER_TURNS, None, 40.0, 3.0, turns=3.0, clockwise=False),
        ),
        (item(Command.LOITER_TURNS, -3, 0, 40), MissionStep(Command.LOITER_TURNS, None, 40.0)),
        (item(Command.LOITER_TIME, 0.5, 0, 70), MissionStep(Command.LOITER_TIME, None, 70.0, 0.5, turns=0.5)),
        (item(Command.RETURN), MissionStep(Command.RETURN)),
        (item(Command.DELAY, 90), delay(90.0)),
        (item(Command.DELAY, 0), delay(0.0)),
        (item(Command.DELAY, -1, 13, 30, 5), delay(0.0, 48_605.0)),
        (item(Command.DELAY, NAN, 0, 0, 1), delay(0.0, 1.0)),
        (item(Command.DELAY, NAN, -1, 1, 1), delay(0.0)),
        (item(Command.DELAY, -1, -2, -2, -2), delay(0.0, 0.0)),
        (item(Command.DELAY, -1, 25, 0, 0), delay(0.0, 23.0 * 3600.0)),
        (item(Command.DELAY, -1, 0, 61, 0), delay(0.0, 59.0 * 60.0)),
        (item(Command.DELAY, -1, 0, 0, 62), delay(0.0, 60.0)),
        (item(Command.DELAY, -1, 23, 59, 60), delay(0.0, 0.0)),
        (item(Command.CONDITION_DELAY, 0.5), MissionStep(Command.CONDITION_DELAY, seconds=0.5)),
        (item(Command.CONDITION_DELAY, -5), MissionStep(Command.CONDITION_DELAY)),
        (item(Command.CONDITION_DISTANCE, 0.5), MissionStep(Command.CONDITION_DISTANCE, distance_m=0.5)),
        (item(Command.CONDITION_DISTANCE, -5), MissionStep(Command.CONDITION_DISTANCE)),
        (item(Command.YAW, 90, 0, -1, 0), heading(Command.YAW, 90.0)),
        (item(Command.YAW, 30, 0, -1, 1), heading(Command.YAW, 330.0, relative=True)),
        (item(Command.YAW, 30, 0, 0, 1), heading(Command.YAW, 30.0, relative=True)),
        (item(Command.YAW, 400), heading(Command.YAW, 0.0)),
        (item(Command.YAW, -400), heading(Command.YAW, 0.0)),
        (item(Command.YAW_SPEED, -45, 0, 1), heading(Command.YAW_SPEED, 315.0, relative=True)),
        (item(Command.YAW_SPEED, 400), heading(Command.YAW_SPEED, 0.0)),
        (item(Command.YAW_SPEED, -400), heading(Command.YAW_SPEED, 0.0)),
        (item(Command.JUMP, 3, -1), MissionStep(Command.JUMP, target=3, times=-1)),
        (item(Command.JUMP, -5, -5), MissionStep(Command.JUMP, target=-1, times=-1)),
        (item(Command.JUMP, 2e6, 2e6), MissionStep(Command.JUMP, target=1_000_000, times=1_000_000)),
        (item(Command.CHANGE_SPEED, 0, 2), MissionStep(Command.CHANGE_SPEED)),
        (item(Command.SET_HOME, 1, **PLACE_X_Y), MissionStep(Command.SET_HOME)),
        (item(Command.SET_HOME, 0, **PLACE_X_Y), MissionStep(Command.SET_HOME, PLACE)),
        (item(Command.FENCE_ENABLE, 1), MissionStep(Command.FENCE_ENABLE, enabled=True)),
        (item(Command.FENCE_ENABLE, 0, autocontinue=False), MissionStep(Command.FENCE_ENABLE, autocontinue=False)),
        (item(TAKEOFF, 5, autocontinue=False), MissionStep(None, autocontinue=False)),
    ],
)
def test_items_are_converted_to_si_units_within_their_limits(plan_item, step):
    converted = convert_item(plan_item)
    assert converted.angle_rad == pytest.approx(step.angle_rad, abs=1e-12)
    assert replace(converted, angle_rad=step.angle_rad) == step


def test_mission_is_converted_once():
    plan = Plan.of(PlanKind.MISSION, [item(Command.WAYPOINT), item(Command.RETURN)])
    assert convert_mission(plan) is convert_mission(plan)
    assert [step.command for step in convert_mission(plan)] == [Command.WAYPOINT, Command.RETURN]


items = st.builds(
    PlanItem,
    st.sampled_from([*(int(row.command) for row in TABLE), TAKEOFF, 0, 65535]),
    autocontinue=st.booleans(),
    params=st.tuples(*[st.floats(width=32) for _ in range(4)]),
    x=st.integers(-(2**31), 2**31 - 1),
    y=st.integers(-(2**31), 2**31 - 1),
)


@given(items)
def test_step_is_finite_for_any_item(plan_item):
    step = convert_item(plan_item)
    for value in (step.seconds, step.turns, step.angle_rad, step.radius_m or 0.0, step.time_of_day_s or 0.0):
        assert math.isfinite(value)
        assert value >= 0.0
    if step.place is not None:
        assert abs(step.place.latitude_rad) <= math.pi / 2
        assert abs(step.place.longitude_rad) <= math.pi


def test_tags_and_distances_are_resolved_to_items_and_places():
    items = [
        item(Command.JUMP_TAG, 7),
        item(Command.CONDITION_DISTANCE, 80),
        item(Command.FENCE_ENABLE, 0),
        item(Command.CONDITION_DELAY, 30),
        item(Command.WAYPOINT, **PLACE_X_Y),
        item(Command.JUMP_TO_TAG, 7, 2),
    ]
    tag, distance, fence, pause, _, to_tag = convert_mission(Plan.of(PlanKind.MISSION, items))
    assert tag == MissionStep(Command.JUMP_TAG)
    assert distance == MissionStep(Command.CONDITION_DISTANCE, PLACE, distance_m=80.0)
    assert fence == MissionStep(Command.FENCE_ENABLE)
    assert pause == MissionStep(Command.CONDITION_DELAY, seconds=30.0)
    assert to_tag == MissionStep(Command.JUMP, target=0, times=2)


@pytest.mark.parametrize(("tag", "target"), [(0, 0), (-3, 0), (65535, 1), (70_000, 1), (9, -1)])
def test_tag_without_an_item_is_no_target(tag, target):
    """A jump without a target is skipped; such a plan is refused."""
    items = [item(Command.JUMP_TAG, 0), item(Command.JUMP_TAG, 65535), item(Command.JUMP_TO_TAG, tag)]
    assert convert_mission(Plan.of(PlanKind.MISSION, items))[2].target == target


def test_table_of_commands_has_all_items_with_a_duration():
    assert COMMANDS.keys() == {row.command for row in TABLE if row.kind is PlanKind.MISSION and row.has_duration}
