"""The guided waypoint."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SteerPosition, Verdict


def item(x, y, *, frame=6, command=16, current=2):
    return mavlink.MAVLink_mission_item_int_message(1, 1, 0, frame, command, current, 0, 0, 0, 0, 0, x, y, 0)


def test_a_guided_waypoint_is_a_position_goal(rig):
    (reply,) = rig.tell(item(401_000_000, -115_000_000))
    assert (reply.get_type(), reply.type) == ("MISSION_ACK", mavlink.MAV_MISSION_ACCEPTED)
    (goal,) = rig.request_handler.intents
    assert goal == SteerPosition(pytest.approx(math.radians(40.1)), pytest.approx(math.radians(-11.5)))


def test_the_old_item_in_degrees_too(rig):
    rig.tell(mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, 40.0, -11.5, math.nan))
    (goal,) = rig.request_handler.intents
    assert goal == SteerPosition(pytest.approx(math.radians(40.0)), pytest.approx(math.radians(-11.5)))


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (item(2_147_483_647, 0), mavlink.MAV_MISSION_INVALID),
        (item(0, -1_800_000_001), mavlink.MAV_MISSION_INVALID),
        (item(0, 0), mavlink.MAV_MISSION_INVALID),
        (item(1, 1, frame=1), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (item(1, 1, command=21), mavlink.MAV_MISSION_UNSUPPORTED),
        (
            mavlink.MAVLink_mission_item_message(1, 1, 0, 3, 16, 2, 0, 0, 0, 0, 0, math.nan, 0, 0),
            mavlink.MAV_MISSION_INVALID,
        ),
    ],
)
def test_a_bad_waypoint_is_refused_and_changes_nothing(rig, message, result):
    assert rig.tell(message)[0].type == result
    assert rig.request_handler.intents == []


def test_a_refusal_of_the_loop_is_passed_on_with_its_reason(rig, texts):
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "not in GUIDED")
    replies = rig.tell(item(1, 1))
    assert replies[0].type == mavlink.MAV_MISSION_DENIED
    assert texts(replies) == ["not in GUIDED"]
