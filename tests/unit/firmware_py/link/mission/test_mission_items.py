"""Conversion of mission items, and duplicates of messages."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.mission.items import DuplicateMessages, item_of
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanProblem, PlanResult

WAYPOINT, DELAY, JUMP = Command.WAYPOINT, Command.CONDITION_DELAY, Command.JUMP


def old_item(command, x, y):
    return mavlink.MAVLink_mission_item_message(1, 1, 1, 3, command, 0, 1, 0, 0, 0, 0, x, y, 0)


@pytest.mark.parametrize(
    ("command", "coordinate", "expected"),
    [
        (WAYPOINT, 36.25, 362_500_000),
        (WAYPOINT, -214.7483648, -(2**31)),
        (WAYPOINT, -214.7483649, None),
        (WAYPOINT, 214.7483647, 2**31 - 1),
        (WAYPOINT, 214.7483648, None),
        (WAYPOINT, math.nan, None),
        (WAYPOINT, math.inf, None),
        (DELAY, math.nan, 0),  # as stations send it for no value
        (DELAY, 7.9, 7),
        (DELAY, -(2.0**31), -(2**31)),
        (DELAY, 2.0**31 - 1.0, 2**31 - 1),
        (DELAY, 2.0**31, None),
        (DELAY, -math.inf, None),
        (DELAY, 1e30, None),
    ],
)
def test_coordinate_of_mission_item_is_an_integer_of_32_bits_or_refused(command, coordinate, expected):
    for x, y, result in ((coordinate, 5, PlanResult.INVALID_PARAM5_X), (5, coordinate, PlanResult.INVALID_PARAM6_Y)):
        item = item_of(old_item(command, x, y), 1)
        if expected is None:
            assert isinstance(item, PlanProblem)
            assert item.result is result
        else:
            assert (item.x, item.y)[x == 5] == expected


@pytest.mark.parametrize(
    ("target", "home_count", "expected"), [(0.0, 1, None), (1.0, 1, 0.0), (-1.0, 1, -2.0), (0.0, 0, 0.0)]
)
def test_jump_target_is_an_item_of_the_plan_without_home(target, home_count, expected):
    message = mavlink.MAVLink_mission_item_int_message(1, 1, 1, 2, JUMP, 0, 1, target, 1, 0, 0, 0, 0, 0, 0)
    item = item_of(message, home_count)
    assert (None if isinstance(item, PlanProblem) else item.params[0]) == expected


@pytest.mark.parametrize(("others", "delay_s", "is_duplicate"), [(15, 9.9, True), (16, 9.9, False), (0, 10.0, False)])
def test_latest_messages_of_sixteen_stations_are_stored_for_ten_seconds(others, delay_s, is_duplicate):
    messages, sender = DuplicateMessages(), mavlink.MAVLink(None)
    sender.seq = 5
    count = sender.decode(bytearray(mavlink.MAVLink_mission_count_message(1, 1, 3, 0).pack(sender)))
    assert not messages.is_duplicate("first", count, 0.0)
    for other in range(others):
        assert not messages.is_duplicate(other, count, 0.0)
    assert messages.is_duplicate("first", count, delay_s) is is_duplicate
