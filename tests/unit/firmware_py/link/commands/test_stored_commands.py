"""What is acknowledged is there after a restart: commands, waypoints and items wait for the disk, steering does not."""

import gc

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Arm, SetMissionItem, SetMode, SteerPosition, Verdict

ARM, SET_MODE_MESSAGE = 400, 11
ACCEPTED, REJECTED, IN_PROGRESS = 0, 1, 5
KEPT, UNKEPT = 0, 1  # result_param2


def acks(messages):
    return [(message.result, message.result_param2) for message in messages if message.get_type() == "COMMAND_ACK"]


@pytest.fixture
def slow(rig):
    """A rig whose disk answers when it is reported to."""
    rig.request_handler.orders_at_once = False
    return rig


def test_a_command_is_done_at_once_and_acknowledged_when_it_is_on_disk(slow, texts):
    assert acks(slow.command(ARM, 1.0)) == []
    assert slow.request_handler.intents == [Arm(True)]
    slow.request_handler.waiting.pop()(True)
    replies = slow.replies()
    assert (acks(replies), texts(replies)) == ([(ACCEPTED, KEPT)], [])
    assert acks(slow.ticks(30)) == []


def test_one_that_cannot_be_stored_is_acknowledged_since_it_is_done_and_that_is_said(slow, texts):
    """Any peer that disarms on a broken disk must not be reported that the boat is still armed."""
    slow.command(ARM, 0.0)
    slow.request_handler.waiting.pop()(False)
    replies = slow.replies()
    assert acks(replies) == [(ACCEPTED, UNKEPT)]
    assert texts(replies) == ["COMPONENT_ARM_DISARM: done, but it could not be stored; a restart may forget it"]
    # The retry asks the disk again.
    assert acks(slow.command(ARM, 0.0, confirmation=1)) == []
    slow.request_handler.waiting.pop()(True)
    assert acks(slow.replies()) == [(ACCEPTED, KEPT)]
    assert slow.request_handler.intents == [Arm(False)]


def test_where_nothing_is_to_be_resumed_and_where_nothing_was_changed_nothing_waits(rig, slow):
    assert acks(slow.command(512, 148.0)) == [(ACCEPTED, KEPT)]
    slow.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "no")
    assert acks(slow.command(ARM, 1.0)) == [(REJECTED, KEPT)]
    slow.request_handler.answer = Answer(Verdict.ACCEPTED)
    slow.request_handler.orders_at_once = True
    assert acks(slow.command(ARM, 1.0)) == [(ACCEPTED, KEPT)]


def test_a_disk_that_is_slow_does_not_keep_anybody_from_commanding(slow):
    assert acks(slow.command(ARM, 1.0)) == []
    assert acks(slow.command(ARM, 0.0)) == []
    assert acks(slow.command(ARM, 0.0, confirmation=1)) == [(IN_PROGRESS, KEPT)]
    assert slow.request_handler.intents == [Arm(True), Arm(False)]
    for stored in slow.request_handler.waiting:
        stored(True)
    assert acks(slow.replies()) == [(ACCEPTED, KEPT)] * 2


@pytest.mark.parametrize("at_once", [True, False])
def test_one_that_is_done_leaves_nothing_for_the_collector(slow, at_once):
    """The boat collects once a minute: until then a flood of commands grew the memory by .8 MiB a second."""
    slow.request_handler.orders_at_once = at_once
    slow.command(ARM, 1.0)
    gc.freeze()  # what was there before is not looked through
    gc.disable()
    try:
        slow.command(ARM, 0.0)
        while slow.request_handler.waiting:
            slow.request_handler.waiting.pop()(True)
        assert acks(slow.replies()) or at_once
        found = gc.collect()
    finally:
        gc.enable()
    assert found == 0


def test_one_that_waits_long_says_so_and_in_the_end_that_it_is_done_and_may_be_forgotten(slow, texts):
    slow.command(ARM, 0.0)
    replies = slow.ticks(155)
    assert acks(replies)[:-1] == [(IN_PROGRESS, KEPT)] * 14
    assert acks(replies)[-1] == (ACCEPTED, UNKEPT)
    assert texts(replies) == ["COMPONENT_ARM_DISARM: done, but not on disk yet; a restart may forget it"]
    slow.request_handler.waiting.pop()(True)
    assert acks([*slow.replies(), *slow.ticks(30)]) == []


def test_of_a_stream_of_one_command_that_waits_only_the_latest_says_so(slow):
    for number in range(20):
        assert acks(slow.command(43002, 1.0, float(number))) == []
        assert acks(slow.tick()) == []
    assert acks(slow.ticks(10)) == [(IN_PROGRESS, KEPT)]
    for stored in slow.request_handler.waiting:
        stored(True)
    assert acks(slow.replies()) == [(ACCEPTED, KEPT)] * 20


def test_the_old_set_mode_message_waits_too(slow):
    assert acks(slow.tell(mavlink.MAVLink_set_mode_message(1, 1, 15))) == []
    assert slow.request_handler.intents == [SetMode(15)]
    slow.request_handler.waiting.pop()(True)
    (ack,) = slow.replies()
    assert (ack.command, ack.result) == (SET_MODE_MESSAGE, ACCEPTED)


@pytest.mark.parametrize("kept", [True, False])
def test_a_waypoint_to_be_gone_to_at_once_is_acknowledged_when_it_is_on_disk(slow, of, texts, kept):
    item = mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 16, 2, 1, 0, 0, 0, 0, 10**7, 2 * 10**7, 0.0)
    assert of(slow.tell(item), "MISSION_ACK") == []
    assert isinstance(slow.request_handler.intents[0], SteerPosition)
    slow.request_handler.waiting.pop()(kept)
    replies = [*slow.replies(), *slow.tick()]
    assert [ack.type for ack in of(replies, "MISSION_ACK")] == [ACCEPTED]
    lost = "guided waypoint: taken, but it could not be stored; a restart may forget it"
    assert texts(replies) == ([] if kept else [lost])


@pytest.mark.parametrize("kept", [True, False])
def test_a_new_current_item_is_reported_when_it_is_on_disk(slow, of, texts, kept):
    slow.ticks(2)
    reports = slow.tell(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert slow.request_handler.intents == [SetMissionItem(1)]
    assert of([*reports, *slow.tick()], "MISSION_CURRENT") == []
    slow.request_handler.waiting.pop()(kept)
    replies = [*slow.replies(), *slow.tick()]
    assert len(of(replies, "MISSION_CURRENT")) == 1
    lost = "Item 2 is under way, but this could not be stored; a restart may forget it"
    assert texts(replies) == ([] if kept else [lost])
