"""Acknowledgements of commands, waypoints and mission items after their result is stored."""

import gc

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Arm, SetMissionItem, SetMode, SteerPosition, Verdict
from firmware_py.common.mode_table import Mode

ARM, REQUEST, CHANGE_HEADING = 400, 512, 43002  # MAV_CMD
SET_MODE_MESSAGE, AUTOPILOT_VERSION = mavlink.MAVLINK_MSG_ID_SET_MODE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
ACCEPTED, REJECTED, IN_PROGRESS = 0, 1, 5  # MAV_RESULT
STORED, NOT_STORED = 0, 1  # result_param2


def acks(messages):
    return [(message.result, message.result_param2) for message in messages if message.get_type() == "COMMAND_ACK"]


@pytest.fixture
def slow(rig):
    """A rig whose disk finishes when the test calls it."""
    rig.request_handler.orders_at_once = False
    return rig


def test_command_is_executed_at_once_and_acknowledged_after_storing(slow, texts):
    assert acks(slow.command(ARM, 1.0)) == []
    assert slow.request_handler.intents == [Arm(True)]
    slow.request_handler.waiting.pop()(True)
    replies = slow.replies()
    assert (acks(replies), texts(replies)) == ([(ACCEPTED, STORED)], [])
    assert acks(slow.ticks(30)) == []


def test_command_that_cannot_be_stored_is_acknowledged_with_a_text(slow, texts):
    """A refusal would mean that the boat is still armed."""
    slow.command(ARM, 0.0)
    slow.request_handler.waiting.pop()(False)
    replies = slow.replies()
    assert acks(replies) == [(ACCEPTED, NOT_STORED)]
    assert texts(replies) == ["COMPONENT_ARM_DISARM: done but not stored"]
    # A retry stores again.
    assert acks(slow.command(ARM, 0.0, confirmation=1)) == []
    slow.request_handler.waiting.pop()(True)
    assert acks(slow.replies()) == [(ACCEPTED, STORED)]
    assert slow.request_handler.intents == [Arm(False)]


def test_request_or_refusal_is_acknowledged_at_once(rig, slow):
    assert acks(slow.command(REQUEST, AUTOPILOT_VERSION)) == [(ACCEPTED, STORED)]
    slow.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "no")
    assert acks(slow.command(ARM, 1.0)) == [(REJECTED, STORED)]
    slow.request_handler.answer = Answer(Verdict.ACCEPTED)
    slow.request_handler.orders_at_once = True
    assert acks(slow.command(ARM, 1.0)) == [(ACCEPTED, STORED)]


def test_slow_disk_does_not_delay_the_next_command(slow):
    assert acks(slow.command(ARM, 1.0)) == []
    assert acks(slow.command(ARM, 0.0)) == []
    assert acks(slow.command(ARM, 0.0, confirmation=1)) == [(IN_PROGRESS, STORED)]
    assert slow.request_handler.intents == [Arm(True), Arm(False)]
    for finish_storing in slow.request_handler.waiting:
        finish_storing(True)
    assert acks(slow.replies()) == [(ACCEPTED, STORED)] * 2


@pytest.mark.parametrize("at_once", [True, False])
def test_completed_command_leaves_no_reference_cycle(slow, at_once):
    """The garbage collector runs once a minute; until then cycles of a flood would take 0.8 MiB a second."""
    slow.request_handler.orders_at_once = at_once
    slow.command(ARM, 1.0)
    gc.freeze()  # ignore older objects
    gc.disable()
    try:
        slow.command(ARM, 0.0)
        while slow.request_handler.waiting:
            slow.request_handler.waiting.pop()(True)
        assert acks(slow.replies()) or at_once
        collected = gc.collect()
    finally:
        gc.enable()
    assert collected == 0


def test_long_storing_sends_progress_and_ends_with_a_text(slow, texts):
    slow.command(ARM, 0.0)
    replies = slow.ticks(155)
    assert acks(replies)[:-1] == [(IN_PROGRESS, STORED)] * 14
    assert acks(replies)[-1] == (ACCEPTED, NOT_STORED)
    assert texts(replies) == ["COMPONENT_ARM_DISARM: done but not yet stored"]
    slow.request_handler.waiting.pop()(True)
    assert acks([*slow.replies(), *slow.ticks(30)]) == []


def test_only_the_latest_of_repeated_commands_sends_progress(slow):
    for number in range(20):
        assert acks(slow.command(CHANGE_HEADING, 1.0, float(number))) == []
        assert acks(slow.tick()) == []
    assert acks(slow.ticks(10)) == [(IN_PROGRESS, STORED)]
    for finish_storing in slow.request_handler.waiting:
        finish_storing(True)
    assert acks(slow.replies()) == [(ACCEPTED, STORED)] * 20


def test_set_mode_message_is_acknowledged_after_storing(slow):
    assert acks(slow.send(mavlink.MAVLink_set_mode_message(1, 1, Mode.GUIDED))) == []
    assert slow.request_handler.intents == [SetMode(Mode.GUIDED)]
    slow.request_handler.waiting.pop()(True)
    (ack,) = slow.replies()
    assert (ack.command, ack.result) == (SET_MODE_MESSAGE, ACCEPTED)


@pytest.mark.parametrize("is_stored", [True, False])
def test_guided_waypoint_is_acknowledged_after_storing(slow, of, texts, is_stored):
    frame, command, guided = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT, 2
    item = mavlink.MAVLink_mission_item_int_message(
        1, 1, 0, frame, command, guided, 1, 0, 0, 0, 0, 10**7, 2 * 10**7, 0.0
    )
    assert of(slow.send(item), "MISSION_ACK") == []
    assert isinstance(slow.request_handler.intents[0], SteerPosition)
    slow.request_handler.waiting.pop()(is_stored)
    replies = [*slow.replies(), *slow.tick()]
    assert [ack.type for ack in of(replies, "MISSION_ACK")] == [ACCEPTED]
    assert texts(replies) == ([] if is_stored else ["guided waypoint active but not stored"])


@pytest.mark.parametrize("is_stored", [True, False])
def test_new_current_item_is_reported_after_storing(slow, of, texts, is_stored):
    slow.ticks(2)
    reports = slow.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert slow.request_handler.intents == [SetMissionItem(1)]
    assert of([*reports, *slow.tick()], "MISSION_CURRENT") == []
    slow.request_handler.waiting.pop()(is_stored)
    replies = [*slow.replies(), *slow.tick()]
    assert len(of(replies, "MISSION_CURRENT")) == 1
    assert texts(replies) == ([] if is_stored else ["Mission item 2 active but not stored"])
