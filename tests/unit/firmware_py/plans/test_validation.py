"""Validation of plans: items, jumps, tags and limits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans import items as module
from firmware_py.plans.items import PLACE_FRAMES, ROWS, TABLE, Command, has_position, markdown
from firmware_py.plans.validation import PlanResult, problem_of
from support.paths import ROOT

NAN, INF = math.nan, math.inf
LAND, CHANGE_ALTITUDE, UNUSED_NUMBER = 21, 113, 5005  # MAV_CMD that no plan may contain
MISSION, FENCE, RALLY = PlanKind
WAYPOINT = PlanItem(Command.WAYPOINT, 6, x=360_000_000, y=1_210_000_000)
RETURN = PlanItem(Command.RETURN, 2)


def problem(kind, *items):
    refusal = problem_of(Plan.of(kind, items))
    return None if refusal is None else (refusal.index, refusal.result)


def item(command, *params, x=1, y=1, z=0.0, frame=6):
    return PlanItem(command, frame, params=(*params, *(0.0,) * (4 - len(params))), x=x, y=y, z=z)


def jump(target, times=1.0):
    return item(Command.JUMP, target, times, frame=2)


def test_commands_have_the_numbers_of_mavlink():
    mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
    assert {row.command: getattr(mavlink, f"MAV_CMD_{row.name}") for row in TABLE} == {n: n for n in ROWS}


def test_camera_commands_have_names_of_cameras():
    mavlink = pytest.importorskip("pymavlink.dialects.v20.common")
    names = [entry.name for number, entry in mavlink.enums["MAV_CMD"].items() if number in module.CAMERA]
    words = ("ROI", "CAM", "VIDEO", "MOUNT", "SURVEY", "GIMBAL", "IMAGE", "TRIGGER", "STORAGE")
    assert len(names) == len(module.CAMERA) == 30
    assert [name for name in names if not any(word in name for word in words)] == []


def test_reference_page_states_commands_and_limits():
    assert markdown() in (ROOT / "docs/reference/plan-items.md").read_text(encoding="utf-8")


VALID = [
    (MISSION, item(Command.WAYPOINT, x=900_000_000, y=1_800_000_000)),
    (MISSION, item(Command.WAYPOINT, x=-900_000_000, y=-1_800_000_000)),
    (RALLY, item(Command.RALLY_POINT, x=0, y=7)),
    (MISSION, item(Command.WAYPOINT, 0.0, NAN, NAN, NAN, z=NAN)),
    (MISSION, item(Command.WAYPOINT, 1e8, 5.0, x=0, y=0)),
    (MISSION, item(Command.LOITER_UNLIMITED, NAN, NAN, -50.0, NAN)),
    (MISSION, item(Command.LOITER_TURNS, 2.5, 1.0, 20.0, 1.0)),
    (MISSION, item(Command.LOITER_TIME, 3600.0, 0.0, NAN, NAN)),
    (MISSION, item(Command.RETURN, NAN, NAN, NAN, NAN, frame=2)),
    (MISSION, item(Command.RETURN, frame=3)),
    (MISSION, item(Command.DELAY, 10.0, NAN, NAN, NAN, frame=2)),
    (MISSION, item(Command.DELAY, -1.0, 6.0, 30.0, -1.0, frame=2)),
    (MISSION, item(Command.DELAY, -1.0, 0.0, frame=2)),
    (MISSION, item(Command.YAW, 90.0, NAN, 0.0, 0.0, frame=2)),
    (MISSION, item(Command.YAW, 30.0, 0.0, -1.0, 1.0, frame=2)),
    (MISSION, item(Command.CHANGE_SPEED, 1.0, 0.5, NAN, NAN, frame=2)),
    (MISSION, item(Command.CHANGE_SPEED, 0.0, -2.0, -1.0, frame=2)),
    (MISSION, item(Command.SET_HOME, 1.0, NAN, NAN, NAN, z=NAN)),
    (MISSION, item(Command.SET_HOME, 0.0, z=1.5)),
    (MISSION, item(Command.YAW_SPEED, -20.0, NAN, 1.0, frame=2)),
    (FENCE, item(Command.FENCE_RETURN, frame=0)),
    (FENCE, item(Command.INCLUDED_CIRCLE, 100.0, NAN, frame=5)),
    (FENCE, item(Command.INCLUDED_CIRCLE, 100.0, 3.0, frame=5)),
    (FENCE, item(Command.EXCLUDED_CIRCLE, 100.0, x=0, y=0, frame=0)),
    (RALLY, item(Command.RALLY_POINT, NAN, frame=3)),
]


@pytest.mark.parametrize(("kind", "plan_item"), VALID)
def test_valid_item_is_accepted(kind, plan_item):
    assert problem(kind, plan_item) is None


INVALID = [
    (MISSION, item(LAND), PlanResult.UNSUPPORTED),
    (MISSION, item(CHANGE_ALTITUDE, frame=2), PlanResult.UNSUPPORTED),
    (MISSION, item(Command.CONDITION_DELAY, NAN, frame=2), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.RALLY_POINT), PlanResult.UNSUPPORTED),
    (FENCE, item(Command.WAYPOINT), PlanResult.UNSUPPORTED),
    (RALLY, item(Command.WAYPOINT), PlanResult.UNSUPPORTED),
    (MISSION, item(Command.WAYPOINT, frame=2), PlanResult.UNSUPPORTED_FRAME),
    (MISSION, item(Command.WAYPOINT, frame=1), PlanResult.UNSUPPORTED_FRAME),
    (MISSION, item(Command.RETURN, frame=1), PlanResult.UNSUPPORTED_FRAME),
    (MISSION, item(Command.WAYPOINT, -1.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.WAYPOINT, 0.0, -0.1), PlanResult.INVALID_PARAM2),
    (MISSION, item(Command.WAYPOINT, 0.0, 0.0, INF), PlanResult.INVALID_PARAM3),
    (MISSION, item(Command.WAYPOINT, 0.0, 0.0, 0.0, -INF), PlanResult.INVALID_PARAM4),
    (MISSION, item(Command.WAYPOINT, x=900_000_001), PlanResult.INVALID_PARAM5_X),
    (MISSION, item(Command.WAYPOINT, x=-900_000_001), PlanResult.INVALID_PARAM5_X),
    (MISSION, item(Command.WAYPOINT, y=1_800_000_001), PlanResult.INVALID_PARAM6_Y),
    (MISSION, item(Command.WAYPOINT, y=-1_800_000_001), PlanResult.INVALID_PARAM6_Y),
    (MISSION, item(Command.WAYPOINT, z=INF), PlanResult.INVALID_PARAM7),
    (MISSION, item(Command.LOITER_TURNS, NAN), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.LOITER_TIME, NAN), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.LOITER_UNLIMITED, 0.0, 0.0, 1e9), PlanResult.INVALID_PARAM3),
    *((MISSION, item(Command.DELAY, seconds), PlanResult.INVALID_PARAM1) for seconds in (-2.0, -0.5)),
    (MISSION, item(Command.DELAY, -1.0, -1.0), PlanResult.INVALID_PARAM2),
    (MISSION, item(Command.DELAY, -1.0, NAN), PlanResult.INVALID_PARAM2),
    (MISSION, item(Command.DELAY, -1.0, 6.5), PlanResult.INVALID_PARAM2),
    (MISSION, item(Command.DELAY, -1.0, 6.0, 60.0), PlanResult.INVALID_PARAM3),
    (MISSION, item(Command.DELAY, -1.0, 6.0, 0.0, 60.0), PlanResult.INVALID_PARAM4),
    (MISSION, item(Command.YAW, 361.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.YAW, 1.0, 0.0, 2.0), PlanResult.INVALID_PARAM3),
    (MISSION, item(Command.YAW, 1.0, 0.0, 0.0, NAN), PlanResult.INVALID_PARAM4),
    (MISSION, item(Command.CHANGE_SPEED, 2.0, 1.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.CHANGE_SPEED, 1.0, NAN), PlanResult.INVALID_PARAM2),
    (MISSION, item(Command.SET_HOME, 2.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.SET_HOME, 0.0, z=NAN), PlanResult.INVALID_PARAM7),
    (MISSION, item(Command.YAW_SPEED, NAN), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.YAW_SPEED, 1.0, 0.0, 2.0), PlanResult.INVALID_PARAM3),
    (MISSION, item(Command.JUMP, NAN, 1.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.JUMP, -1.0, 1.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.JUMP, 0.5, 1.0), PlanResult.INVALID_PARAM1),
    (MISSION, item(Command.JUMP, 0.0, -2.0), PlanResult.INVALID_PARAM2),
    (FENCE, item(Command.INCLUDED_CIRCLE, 0.0), PlanResult.INVALID_PARAM1),
    (FENCE, item(Command.EXCLUDED_CIRCLE, NAN), PlanResult.INVALID_PARAM1),
    (FENCE, item(Command.INCLUDED_CIRCLE, 10.0, 256.0), PlanResult.INVALID_PARAM2),
    (FENCE, item(Command.INCLUDED_CIRCLE, 10.0, 0.5), PlanResult.INVALID_PARAM2),
    (FENCE, item(Command.INCLUDED_VERTEX, 2.0), PlanResult.INVALID_PARAM1),
    (FENCE, item(UNUSED_NUMBER, 10.0), PlanResult.UNSUPPORTED),
    (RALLY, item(Command.RALLY_POINT, frame=2), PlanResult.UNSUPPORTED_FRAME),
    (RALLY, item(Command.RALLY_POINT, x=0, y=0), PlanResult.INVALID_PARAM5_X),
]


@pytest.mark.parametrize(("kind", "plan_item", "result"), INVALID)
def test_invalid_item_is_refused(kind, plan_item, result):
    assert problem(kind, plan_item) == (0, result)


def test_parameters_with_a_default_may_be_nan():
    numbers = {(command, meaning.number) for command, row in ROWS.items() for meaning in row.meanings}
    refused = {(n, i) for n, i in numbers if not next(m for m in ROWS[n].meanings if m.number == i).admits(NAN)}
    assert numbers - refused == {
        (Command.WAYPOINT, 1),
        (Command.WAYPOINT, 2),
        (Command.LOITER_UNLIMITED, 3),
        (Command.LOITER_TURNS, 3),
        (Command.LOITER_TIME, 3),
        (Command.DELAY, 2),
        (Command.DELAY, 3),
        (Command.DELAY, 4),
        (Command.YAW, 3),
        (Command.FENCE_ENABLE, 2),
        (Command.INCLUDED_VERTEX, 2),
        (Command.INCLUDED_CIRCLE, 2),
    }


def test_items_with_and_without_a_place_have_their_frames():
    """Numbers of MAV_FRAME."""
    for command, frames in ((Command.WAYPOINT, [0, 3, 5, 6, 10, 11]), (Command.RETURN, [0, 2, 3, 5, 6, 10, 11])):
        assert [frame for frame in range(256) if problem(MISSION, item(command, frame=frame)) is None] == frames


def test_only_these_items_have_a_place_or_take_time():
    assert {n for n in ROWS if has_position(n)} == {
        Command.WAYPOINT,
        Command.LOITER_UNLIMITED,
        Command.LOITER_TURNS,
        Command.LOITER_TIME,
        Command.SET_HOME,
        Command.FENCE_RETURN,
        Command.INCLUDED_VERTEX,
        Command.EXCLUDED_VERTEX,
        Command.INCLUDED_CIRCLE,
        Command.EXCLUDED_CIRCLE,
        Command.RALLY_POINT,
    }
    loops = {n: problem(MISSION, item(n), jump(0, -1)) for n, row in ROWS.items() if row.kind is MISSION}
    assert {n for n, refusal in loops.items() if refusal is None} == {
        Command.WAYPOINT,
        Command.LOITER_UNLIMITED,
        Command.LOITER_TURNS,
        Command.LOITER_TIME,
        Command.RETURN,
        Command.DELAY,
        Command.CONDITION_DELAY,
        Command.YAW,
        Command.YAW_SPEED,
    }


singles = st.floats(width=32)
ints = st.integers(-(2**31), 2**31 - 1)


@given(
    st.sampled_from(PlanKind),
    st.builds(
        PlanItem,
        command=st.sampled_from(sorted(ROWS)) | st.integers(0, 65535),
        frame=st.sampled_from([0, 2, 3]) | st.integers(0, 255),
        params=st.tuples(*[singles | st.sampled_from([0.0, 1.0, 3.0])] * 4),
        x=ints,
        y=ints,
        z=singles,
    ),
)
def test_accepted_item_is_finite_and_in_range(kind, plan_item):
    refusal = problem_of(Plan.of(kind, (plan_item,)))
    assert refusal is None or (refusal.result is not PlanResult.ACCEPTED and refusal.text)
    if refusal is None:
        row = ROWS[plan_item.command]
        assert row.kind is kind
        assert not any(map(math.isinf, (*plan_item.params, plan_item.z)))
        assert plan_item.frame in PLACE_FRAMES or (plan_item.frame == 2 and not row.has_place)
        for meaning in row.meanings:
            value = plan_item.params[meaning.number - 1]
            assert meaning.low <= value <= meaning.high or (meaning.allows_nan and math.isnan(value))
        if row.has_place:
            assert abs(plan_item.x) <= 9e8
            assert abs(plan_item.y) <= 1.8e9


def test_number_of_items_is_limited():
    assert problem(MISSION, *[WAYPOINT] * 2000) is None
    assert problem(MISSION, *[WAYPOINT] * 2001) == (None, PlanResult.NO_SPACE)


def test_first_invalid_item_is_reported():
    refusal = problem_of(Plan.of(MISSION, (WAYPOINT, item(Command.WAYPOINT, frame=1), item(LAND))))
    assert (refusal.message(0), refusal.message(1)[:6]) == ("item 1: NAV_WAYPOINT: frame 1 is not supported", "item 2")


@pytest.mark.parametrize(
    "items",
    [
        (WAYPOINT, jump(0, -1)),
        (jump(1), WAYPOINT),
        (jump(2), WAYPOINT, jump(1, -1)),
        (WAYPOINT, RETURN, item(Command.CHANGE_SPEED, 1.0, 1.0, frame=2), jump(1, 32767)),
        # A limited jump is no endless loop.
        (jump(0),),
        (WAYPOINT, item(Command.CHANGE_SPEED, 1.0, 1.0, frame=2), jump(1, 32767)),
        (jump(0, 0),),
        (item(Command.CHANGE_SPEED, 1.0, -1.0, frame=2), WAYPOINT),
        (jump(2, 3), WAYPOINT, jump(0, 3)),
        (WAYPOINT, jump(2, 5), jump(1, 5)),
        (item(Command.CHANGE_SPEED, 1.0, 1.0, frame=2), jump(0, 2), jump(3, -1), WAYPOINT),
    ],
)
def test_valid_jumps_are_accepted(items):
    assert problem(MISSION, *items) is None


@pytest.mark.parametrize(
    ("items", "index"),
    [
        ((WAYPOINT, jump(2)), 1),
        ((jump(0, -1),), 0),
        ((WAYPOINT, item(Command.CHANGE_SPEED, 1.0, 1.0, frame=2), jump(1, -1)), 2),
        ((jump(2, -1), WAYPOINT, jump(0, -1)), 2),
        ((WAYPOINT, jump(2, -1), jump(1, -1)), 2),
        ((WAYPOINT, item(Command.CHANGE_SPEED, 1.0, 1.0, frame=2), jump(1, 3), jump(1, -1)), 3),
    ],
)
def test_invalid_and_endless_jumps_are_refused(items, index):
    assert problem(MISSION, *items) == (index, PlanResult.INVALID_PARAM1)


NEAR, DELAY, TAG = (
    item(Command.CONDITION_DISTANCE, 50.0, frame=2),
    item(Command.CONDITION_DELAY, 5.0, frame=2),
    item(Command.JUMP_TAG, 3.0, frame=2),
)


@pytest.mark.parametrize(
    ("items", "expected"),
    [
        ((TAG, WAYPOINT, item(Command.JUMP_TO_TAG, 3.0, -1.0, frame=2)), None),
        ((item(Command.JUMP_TO_TAG, 4.0, 1.0, frame=2), TAG), (0, PlanResult.INVALID_PARAM1)),
        ((WAYPOINT, TAG, item(Command.JUMP_TO_TAG, 3.0, -1.0, frame=2)), (2, PlanResult.INVALID_PARAM1)),
        ((TAG, DELAY, item(Command.JUMP_TO_TAG, 3.0, -1.0, frame=2)), None),
        ((item(Command.JUMP_TAG, 0.5, frame=2),), (0, PlanResult.INVALID_PARAM1)),
        ((NEAR, item(Command.FENCE_ENABLE, 1.0, frame=2), DELAY, WAYPOINT), None),
        ((NEAR, item(Command.WAYPOINT, x=0, y=0), WAYPOINT), (0, PlanResult.INVALID)),  # the present position
        ((NEAR, item(Command.WAYPOINT, x=0, y=5), NEAR, item(Command.WAYPOINT, x=5, y=0)), None),
        ((NEAR, jump(2), WAYPOINT), (0, PlanResult.INVALID)),
        ((NEAR, RETURN), (0, PlanResult.INVALID)),
        ((item(Command.FENCE_ENABLE, 2.0, frame=2),), (0, PlanResult.INVALID_PARAM1)),
        ((item(Command.FENCE_ENABLE, 1.0, 4.0, frame=2),), (0, PlanResult.INVALID_PARAM2)),
    ],
)
def test_tags_distances_and_fence_items_are_validated(items, expected):
    assert problem(MISSION, *items) == expected


def test_two_thousand_conditions_and_tags_are_accepted():
    assert problem(MISSION, *[NEAR] * 1000, *[TAG] * 998, WAYPOINT) is None


def test_two_thousand_jumps_need_no_recursion():
    assert problem(MISSION, WAYPOINT, *[jump(0)] * 1999) is None


def test_validation_is_cached_by_the_plan_object():
    plan = Plan.of(MISSION, (item(LAND),))
    assert problem_of(plan) is problem_of(plan)
    assert problem_of(Plan.of(MISSION, (WAYPOINT,))) is None
    assert problem_of(Plan(MISSION, (item(LAND),), Plan.of(MISSION, (WAYPOINT,)).identity)) is not None


def test_four_problems_are_cached():
    plans = [Plan.of(MISSION, (item(LAND, x=number),)) for number in range(5)]
    problems = [problem_of(plan) for plan in plans]
    assert all(problem_of(plan) is found for plan, found in zip(plans[1:], problems[1:], strict=True))
    assert problem_of(plans[0]) is not problems[0]
