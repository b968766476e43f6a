"""The guided waypoint: a mission item with `current` 2."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, SteerPosition, Verdict

GUIDED = 2  # `current`
WAYPOINT, LAND = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
LOCAL_NED, GLOBAL_RELATIVE_ALT, GLOBAL_RELATIVE_ALT_INT = 1, 3, 6  # MAV_FRAME


def int_item(x, y, *, frame=GLOBAL_RELATIVE_ALT_INT, command=WAYPOINT):
    return mavlink.MAVLink_mission_item_int_message(1, 1, 0, frame, command, GUIDED, 0, 0, 0, 0, 0, x, y, 0)


def float_item(x, y):
    return mavlink.MAVLink_mission_item_message(
        1, 1, 0, GLOBAL_RELATIVE_ALT, WAYPOINT, GUIDED, 0, 0, 0, 0, 0, x, y, math.nan
    )


@pytest.mark.parametrize("message", [int_item(401_000_000, -115_000_000), float_item(40.1, -11.5)])
def test_guided_waypoint_is_a_position_goal(rig, message):
    (reply,) = rig.send(message)
    assert (reply.get_type(), reply.type) == ("MISSION_ACK", mavlink.MAV_MISSION_ACCEPTED)
    (goal,) = rig.request_handler.intents
    assert goal == SteerPosition(pytest.approx(math.radians(40.1)), pytest.approx(math.radians(-11.5)))


@pytest.mark.parametrize(
    ("message", "result"),
    [
        (int_item(2_147_483_647, 0), mavlink.MAV_MISSION_INVALID),
        (int_item(0, -1_800_000_001), mavlink.MAV_MISSION_INVALID),
        (int_item(0, 0), mavlink.MAV_MISSION_INVALID),
        (int_item(1, 1, frame=LOCAL_NED), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
        (int_item(1, 1, command=LAND), mavlink.MAV_MISSION_UNSUPPORTED),
        (float_item(math.nan, 0), mavlink.MAV_MISSION_INVALID),
    ],
)
def test_invalid_waypoint_is_refused(rig, message, result):
    assert rig.send(message)[0].type == result
    assert rig.request_handler.intents == []


@pytest.mark.parametrize(("reason", "text"), [("not in GUIDED",) * 2, ("", "guided waypoint refused")])
def test_refusal_of_the_loop_is_sent_with_its_reason(rig, texts, reason, text):
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, reason)
    replies = rig.send(int_item(1, 1))
    assert replies[0].type == mavlink.MAV_MISSION_DENIED
    assert texts(replies) == [text]
