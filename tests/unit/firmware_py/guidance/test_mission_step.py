"""Conversion of mission items."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.guidance.mission_commands import TABLE as COMMANDS
from firmware_py.guidance.mission_step import MissionStep, convert_item, convert_mission
from firmware_py.plans.items import TABLE, Command

NAN = math.nan


def item(command, *params, x=0, y=0, autocontinue=True):
    return PlanItem(command, 3, autocontinue, (*map(float, params), 0.0, 0.0, 0.0, 0.0)[:4], x, y)


def test_waypoint_has_hold_time_and_radius():
    step = convert_item(item(16, 30, 12.5, x=360000000, y=1210000000, autocontinue=False))
    assert step.command is Command.WAYPOINT
    assert (step.seconds, step.radius_m, step.autocontinue) == (30.0, 12.5, False)
    assert math.degrees(step.place.latitude_rad) == pytest.approx(36.0)
    assert math.degrees(step.place.longitude_rad) == pytest.approx(121.0)
    assert convert_item(item(16, NAN, NAN)) == MissionStep(Command.WAYPOINT)


def test_loiter_has_radius_turns_and_direction():
    assert convert_item(item(18, 3, 0, -40)) == MissionStep(
        Command.LOITER_TURNS, radius_m=40.0, seconds=3.0, turns=3.0, clockwise=False
    )
    assert convert_item(item(19, 600, 0, 70)).seconds == 600.0
    assert convert_item(item(17)).radius_m is None


def test_heading_is_absolute_or_relative_with_a_direction():
    assert convert_item(item(115, 90, 0, 0, 0)).angle_rad == pytest.approx(math.pi / 2)
    to_port = convert_item(item(115, 30, 0, -1, 1))
    assert (to_port.relative, math.degrees(to_port.angle_rad)) == (True, pytest.approx(330.0))
    assert convert_item(item(213, -45, 0, 1)).relative
    assert math.degrees(convert_item(item(213, -45, 0, 1)).angle_rad) == pytest.approx(315.0)


def test_delay_is_a_duration_or_a_time_of_day():
    assert convert_item(item(93, 90)).seconds == 90.0
    assert convert_item(item(93, -1, 13, 30, 5)).time_of_day_s == 48605.0
    assert convert_item(item(93, 0)).time_of_day_s is None


def test_jump_home_and_unknown_items():
    assert (convert_item(item(177, 3, -1)).target, convert_item(item(177, 3, -1)).times) == (3, -1)
    assert convert_item(item(179, 1, x=5, y=5)).place is None
    assert convert_item(item(179, 0, x=5, y=5)).place is not None
    assert convert_item(item(178, 0, 2)).command is Command.CHANGE_SPEED
    assert convert_item(item(20)).command is Command.RETURN
    assert convert_item(item(22)).command is None


def test_mission_is_converted_once():
    plan = Plan.of(PlanKind.MISSION, [item(16), item(20)])
    assert convert_mission(plan) is convert_mission(plan)
    assert [step.command for step in convert_mission(plan)] == [Command.WAYPOINT, Command.RETURN]


items = st.builds(
    PlanItem,
    st.sampled_from([*(int(row.command) for row in TABLE), 22, 0, 65535]),
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
    place = {"x": 360000000, "y": 1210000000}
    items = [item(600, 7), item(114, 80), item(207, 0), item(112, 30), item(16, **place), item(601, 7, 2), item(601, 9)]
    tag, distance, fence, delay, _, to_tag, without_tag = convert_mission(Plan.of(PlanKind.MISSION, items))
    assert tag == MissionStep(Command.JUMP_TAG)
    assert (distance.distance_m, distance.place) == (80.0, convert_item(item(16, **place)).place)
    assert (fence.command, fence.enabled, convert_item(item(207, 1)).enabled) == (Command.FENCE_ENABLE, False, True)
    assert (delay.command, delay.seconds) == (Command.CONDITION_DELAY, 30.0)
    assert (to_tag.command, to_tag.target, to_tag.times) == (Command.JUMP, 0, 2)
    assert without_tag.target == -1  # the item is skipped; such a plan is refused


def test_table_of_commands_has_all_items_with_a_duration():
    assert COMMANDS.keys() == {row.command for row in TABLE if row.kind is PlanKind.MISSION and row.has_duration}


@pytest.mark.parametrize(("param", "value"), [(0.0, 0.0), (0.5, 0.5), (30.0, 30.0)])
def test_conditions_of_less_than_one_are_not_changed(param, value):
    assert convert_item(item(114, param)).distance_m == value
    assert convert_item(item(112, param)).seconds == value
