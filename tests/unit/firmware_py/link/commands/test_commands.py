"""Acknowledgement of commands, and detection of retries and duplicates."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Answer, Arm, SetMode, Verdict
from firmware_py.common.mode_table import Mode

ARM, YAW, YAW_SPEED = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_CONDITION_YAW, 213
REPOSITION, MISSION_START, REQUEST = mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_CMD_MISSION_START, 512
AUTOPILOT_VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
ACCEPTED, REJECTED, DENIED, UNSUPPORTED = range(4)  # MAV_RESULT


def only_ack(messages):
    (ack,) = [message for message in messages if message.get_type() == "COMMAND_ACK"]
    return ack


def command_long(number, *values, confirmation=0):
    values = (*values, *(0.0,) * (7 - len(values)))
    return mavlink.MAVLink_command_long_message(1, 1, number, confirmation, *values)


def test_acknowledgement_has_the_command_and_its_sender(rig):
    ack = only_ack(rig.command(ARM, 1.0))
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (ARM, ACCEPTED, 255, 190)
    (request,) = rig.request_handler.requests
    assert (request.intent, request.system, request.component) == (Arm(True), 255, 190)


@pytest.mark.parametrize("number", [0, 1, 16, 21, 65534, 65535])
def test_unknown_command_is_unsupported(rig, number):
    ack = only_ack(rig.command(number))
    assert (ack.result, ack.progress, ack.result_param2) == (UNSUPPORTED, 0, 0)
    message = mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    assert only_ack(rig.send(message)).result == UNSUPPORTED


@pytest.mark.parametrize("target", [(2, 1), (1, 2), (2, 0), (0, 154)])
def test_command_to_another_component_is_ignored(rig, target):
    assert rig.command(ARM, 1.0, target=target) == []
    assert rig.request_handler.requests == []


@pytest.mark.parametrize("target", [(0, 0), (1, 0), (0, 1)])
def test_broadcast_command_is_accepted(rig, target):
    assert only_ack(rig.command(ARM, 1.0, target=target)).result == ACCEPTED


@pytest.mark.parametrize("verdict", list(Verdict))
def test_verdict_and_reason_of_the_loop_are_sent(rig, texts, verdict):
    rig.request_handler.answer = Answer(verdict, "" if verdict is Verdict.ACCEPTED else "because")
    replies = rig.command(ARM, 1.0)
    assert only_ack(replies).result == verdict
    assert texts(replies) == ([] if verdict is Verdict.ACCEPTED else ["because"])


def test_retry_gets_the_first_result_and_is_not_executed(rig):
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED, "no")
    rig.command(ARM, 1.0, 0.0, math.nan)
    rig.request_handler.answer = Answer(Verdict.ACCEPTED)
    for confirmation in (1, 2, 255):
        assert only_ack(rig.command(ARM, 1.0, 0.0, math.nan, confirmation=confirmation)).result == REJECTED
    assert len(rig.request_handler.requests) == 1


def test_retry_of_a_lost_command_is_executed(rig):
    assert only_ack(rig.command(ARM, 1.0, confirmation=1)).result == ACCEPTED
    assert len(rig.request_handler.requests) == 1


def test_two_stations_with_one_system_id_get_separate_results(make_rig):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    command, retry = command_long(ARM, 1.0), command_long(ARM, 1.0, confirmation=1)
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED)
    assert only_ack(rig.send(command, address="one")).result == REJECTED
    rig.request_handler.answer = Answer(Verdict.ACCEPTED)
    # The first command of the second station is lost.
    assert only_ack(rig.send(retry, address="two")).result == ACCEPTED
    assert only_ack(rig.send(retry, address="one")).result == REJECTED
    assert rig.request_handler.intents == [Arm(True), Arm(True)]


def test_command_that_is_no_retry_is_executed(rig):
    rig.command(ARM, 1.0)
    rig.command(ARM, 0.0, confirmation=1)  # other parameters
    rig.command(ARM, 0.0)  # no confirmation
    rig.station.srcSystem = 254
    rig.command(ARM, 0.0, confirmation=1)  # another sender
    rig.station.srcSystem = 255
    rig.now_s += 60.0
    rig.command(ARM, 0.0, confirmation=1)  # long after
    assert rig.request_handler.intents == [Arm(True), Arm(False), Arm(False), Arm(False), Arm(False)]


def int_frame(rig, number, *values, x=0, y=0):
    values = (*values, *(0.0,) * (4 - len(values)))
    return rig.frame(mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, *values, x, y, 0))


def test_duplicate_frame_is_executed_once_and_acknowledged_twice(rig):
    frame = rig.frame(command_long(YAW, 10, 0, 1, 1))
    assert [ack.result for ack in rig.give(frame + frame)] == [ACCEPTED, ACCEPTED]
    assert len(rig.request_handler.requests) == 1
    frame = int_frame(rig, MISSION_START)
    assert [only_ack(rig.give(frame)).result for _ in range(2)] == [DENIED, DENIED]


def test_delayed_duplicate_after_the_opposite_command_is_not_executed(rig):
    arm, disarm = rig.frame(command_long(ARM, 1)), rig.frame(command_long(ARM, 0))
    rig.give(arm)
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED)
    rig.give(disarm)
    rig.now_s += 1.0
    assert only_ack(rig.give(arm)).result == ACCEPTED  # its result, not that of the command in between
    assert only_ack(rig.give(disarm)).result == REJECTED
    assert rig.request_handler.intents == [Arm(True), Arm(False)]
    rig.now_s += 2.0
    rig.give(arm)  # after this time it is a new command
    assert len(rig.request_handler.requests) == 3


def test_duplicate_set_mode_does_not_undo_the_next_one(rig):
    guided, hold = (rig.frame(mavlink.MAVLink_set_mode_message(1, 1, mode)) for mode in (Mode.GUIDED, Mode.HOLD))
    for frame in (guided, hold, guided):
        assert only_ack(rig.give(frame)).result == ACCEPTED
    assert rig.request_handler.intents == [SetMode(Mode.GUIDED), SetMode(Mode.HOLD)]


def test_late_end_of_a_command_does_not_change_the_result_of_the_next(rig):
    rig.request_handler.orders_at_once = False
    rig.command(ARM, 1.0)
    rig.request_handler.answer = Answer(Verdict.TEMPORARILY_REJECTED)
    rig.command(ARM, 0.0)
    rig.request_handler.waiting.pop()(True)
    rig.replies()
    assert only_ack(rig.command(ARM, 0.0, confirmation=1)).result == REJECTED


def test_relative_command_int_repeated_at_once_is_a_retry(rig):
    for wait_s, expected in ((0.0, 1), (0.5, 1), (1.2, 2)):
        rig.now_s += wait_s
        assert only_ack(rig.give(int_frame(rig, YAW, 10, 0, 1, 1))).result == ACCEPTED
        assert len(rig.request_handler.requests) == expected
    rig.give(int_frame(rig, REPOSITION, x=10))
    rig.give(int_frame(rig, REPOSITION, x=10))  # not relative: executed again
    assert len(rig.request_handler.requests) == 4


RELATIVE = {YAW: (10, 0, 1, 1), YAW_SPEED: (10, 0, 1)}


def turn(number, confirmation=0, angle_deg=10):
    return command_long(number, angle_deg, *RELATIVE[number][1:], confirmation=confirmation)


@pytest.mark.parametrize("by_int", [False, True])
@pytest.mark.parametrize("delay_s", [0.0, 1.5, 9.0])
@pytest.mark.parametrize("number", RELATIVE)
def test_relative_turn_on_two_links_is_executed_once(make_rig, number, delay_s, by_int):
    """The two paths are not yet known as those of one station."""
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    frame = int_frame(rig, number, *RELATIVE[number]) if by_int else rig.frame(turn(number))
    assert only_ack(rig.give(frame, "one")).result == ACCEPTED
    rig.now_s += delay_s
    assert only_ack(rig.give(frame, "two")).result == ACCEPTED
    assert len(rig.request_handler.requests) == 1


@pytest.mark.parametrize("address", ["one", "two"])
@pytest.mark.parametrize("number", RELATIVE)
@pytest.mark.parametrize("verdict", [Verdict.ACCEPTED, Verdict.TEMPORARILY_REJECTED])
def test_retry_of_a_relative_turn_is_acknowledged_again(make_rig, number, address, verdict):
    """QGroundControl repeats the command after 3, 6 and 9 s."""
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    rig.request_handler.answer = Answer(verdict)
    rig.send(turn(number), address="one")
    rig.request_handler.answer = Answer(Verdict.ACCEPTED)
    for confirmation in (1, 2, 3):
        rig.now_s += 3.0
        assert only_ack(rig.send(turn(number, confirmation), address=address)).result == verdict
    assert len(rig.request_handler.requests) == 1
    rig.send(turn(number, 4, angle_deg=20.0), address=address)  # another turn
    rig.now_s += 30.0
    rig.send(turn(number, 1), address=address)  # a retry of a lost command
    assert len(rig.request_handler.requests) == 3


def test_turn_of_a_restarted_script_is_executed(make_rig):
    """The script repeats its sequence numbers on another port."""
    rig = make_rig(addresses=())
    for number in range(3):
        rig.station.seq = 0
        rig.prove(("script", number))
        assert only_ack(rig.send(turn(YAW), address=("script", number))).result == ACCEPTED
        rig.tick(seconds=3.0)
    assert len(rig.request_handler.requests) == 3


def test_retry_of_a_message_request_sends_the_message_again(rig, of):
    rig.command(REQUEST, AUTOPILOT_VERSION)
    assert len(of(rig.command(REQUEST, AUTOPILOT_VERSION, confirmation=1), "AUTOPILOT_VERSION")) == 1


def test_set_mode_message_is_executed_and_acknowledged(rig):
    ack = only_ack(rig.send(mavlink.MAVLink_set_mode_message(1, 1, Mode.GUIDED)))
    assert (ack.command, ack.result) == (mavlink.MAVLINK_MSG_ID_SET_MODE, ACCEPTED)
    assert rig.request_handler.intents == [SetMode(Mode.GUIDED)]
    assert rig.send(mavlink.MAVLink_set_mode_message(2, 1, Mode.GUIDED)) == []
