"""The services of the link: order of sending, time (PING, TIMESYNC) and console (SERIAL_CONTROL)."""

from itertools import chain

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.parameter_table import TABLE

SYSTEM_AND_COMPONENT = (1, 1)
TIMESYNC = mavlink.mavlink_map[mavlink.MAVLINK_MSG_ID_TIMESYNC]
SHELL = mavlink.SERIAL_CONTROL_DEV_SHELL


def test_no_message_is_handled_by_two_services(rig):
    numbers = list(chain.from_iterable(service.handlers() for service in rig.endpoint._services._all))
    assert len(numbers) == len(set(numbers))
    assert set(numbers) <= set(rig.endpoint.handlers)


def test_long_replies_to_several_peers_are_sent_in_turn(make_rig, of):
    names = ("first", "second", "third")
    rig = make_rig(addresses=names)
    rig.tick()
    request = mavlink.MAVLink_param_request_list_message(*SYSTEM_AND_COMPONENT)
    rig.transport.inbox += [(name, rig.frame(request)) for name in names]
    rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
    rig.finish()
    turns = [address for address, _ in rig.transport.sent]
    assert turns == [names[number % 3] for number in range(len(turns))]
    for name in names:
        indices = [value.param_index for value in of(decoded(rig, name), "PARAM_VALUE")]
        assert indices == list(range(len(TABLE)))


def decoded(rig, address):
    data = b"".join(data for to, data in rig.transport.sent if to == address)
    return mavlink.MAVLink(None).parse_buffer(data)


def test_ping_gets_a_reply(rig):
    (reply,) = rig.send(mavlink.MAVLink_ping_message(123, 5, 0, 0))
    assert (reply.time_usec, reply.seq, reply.target_system, reply.target_component) == (123, 5, 255, 190)


def test_addressed_ping_gets_one_reply(rig):
    (reply,) = rig.send(mavlink.MAVLink_ping_message(123, 5, 1, 1))
    assert (reply.time_usec, reply.seq, reply.target_system, reply.target_component) == (123, 5, 255, 190)
    assert rig.send(mavlink.MAVLink_ping_message(123, 5, 1, 1)) == []
    assert len(rig.send(mavlink.MAVLink_ping_message(123, 6, 1, 1))) == 1
    assert rig.send(mavlink.MAVLink_ping_message(123, 7, 2, 1)) == []
    for system in range(1, 251):
        rig.station.srcSystem = system
        rig.send(mavlink.MAVLink_ping_message(1, 1, 1, 1))
    assert len(rig.endpoint._handlers[mavlink.MAVLINK_MSG_ID_PING].__self__._latest_pings) == 32


def test_two_stations_with_equal_ping_numbers_get_replies(make_rig):
    rig = make_rig(addresses=("one", "other"))
    rig.tick()
    ping = rig.frame(mavlink.MAVLink_ping_message(123, 5, 1, 1))
    assert len(rig.give(ping, "one")) == 1
    assert len(rig.give(ping, "other")) == 1
    assert rig.give(ping, "one") == []


def test_only_the_time_of_a_ground_station_is_offered(rig):
    time = mavlink.MAVLink_system_time_message(1_800_000_000_000_000, 0)
    rig.send(time)
    assert rig.offered_utc == []
    rig.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3), time)
    rig.send(mavlink.MAVLink_system_time_message(0, 0), mavlink.MAVLink_system_time_message(2**64 - 1, 0))
    assert rig.offered_utc == [(1.8e9, rig.now_s)]


def test_timesync_reply_contains_both_times(rig):
    rig.now_s = 2.5
    (reply,) = rig.send(TIMESYNC(0, -(2**63), 1, 1))
    assert (reply.tc1, reply.ts1, reply.target_system, reply.target_component) == (2_500_000_000, -(2**63), 255, 190)


def test_timesync_replies_and_foreign_requests_are_ignored(rig):
    assert rig.send(TIMESYNC(5, 1, 0, 0), TIMESYNC(0, 1, 2, 1)) == []


@pytest.mark.parametrize(("utc_s", "is_offered"), [(0.0, False), (1.0, True), (9.99e10, True), (1.01e11, False)])
def test_impossible_time_of_a_ground_station_is_not_offered(rig, utc_s, is_offered):
    rig.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    rig.send(mavlink.MAVLink_system_time_message(int(utc_s * 1e6), 0))
    assert bool(rig.offered_utc) is is_offered


def shell_input(device=SHELL, flags=mavlink.SERIAL_CONTROL_FLAG_RESPOND, text=b"help\n"):
    return mavlink.MAVLink_serial_control_message(device, flags, 0, 0, len(text), list(text.ljust(70, b"\0")))


def test_console_input_gets_the_reply_that_there_is_no_shell(rig):
    (reply,) = rig.send(shell_input())
    assert (reply.device, reply.flags, reply.timeout, reply.baudrate) == (
        SHELL,
        mavlink.SERIAL_CONTROL_FLAG_REPLY,
        0,
        0,
    )
    assert bytes(reply.data[: reply.count]) == b"no shell over MAVLink; log in by ssh\r\n"


@pytest.mark.parametrize(
    "changes",
    [{"device": mavlink.SERIAL_CONTROL_DEV_GPS1}, {"flags": mavlink.SERIAL_CONTROL_FLAG_REPLY}, {"text": b""}],
)
def test_other_serial_control_messages_get_no_reply(rig, changes):
    assert rig.send(shell_input(**changes)) == []
