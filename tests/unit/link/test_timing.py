"""PING and TIMESYNC."""

from pymavlink.dialects.v20 import common as mavlink


def test_a_ping_request_is_answered_to_its_sender(rig):
    (reply,) = rig.tell(mavlink.MAVLink_ping_message(123, 5, 0, 0))
    assert (reply.time_usec, reply.seq, reply.target_system, reply.target_component) == (123, 5, 255, 190)


def test_the_answer_to_a_ping_is_not_answered(rig):
    assert rig.tell(mavlink.MAVLink_ping_message(123, 5, 1, 1)) == []


def test_a_timesync_request_is_answered_with_both_times(rig):
    rig.now_s = 2.5
    (reply,) = rig.tell(mavlink.mavlink_map[111](0, -(2**63), 1, 1))
    assert (reply.tc1, reply.ts1, reply.target_system, reply.target_component) == (2_500_000_000, -(2**63), 255, 190)


def test_timesync_answers_and_requests_to_others_are_left_alone(rig):
    assert rig.tell(mavlink.mavlink_map[111](5, 1, 0, 0), mavlink.mavlink_map[111](0, 1, 2, 1)) == []
