"""What others say to one another over the boat's links: to whom it goes, and what never does."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.crc16 import mcrf4xx
from firmware_py.link import routing
from firmware_py.link.routing import DUPLICATE_S, MAX_BURST, MAX_ROUTES, ROUTE_TIMEOUT_S
from firmware_py.link.wire.frames import Frame
from firmware_py.link.wire.urls import LinkClass, LinkOptions, Policy

BEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)


class Voice:
    """A component of the network that speaks from an address."""

    def __init__(self, rig, address, system, component):
        self.rig, self.address = rig, address
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def frame(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def say(self, *messages):
        """Send messages; return, by address, the frames of others that the boat passed on."""
        return self.send(*map(self.frame, messages))

    def send(self, *frames):
        rig = self.rig
        rig.transport.sent.clear()
        rig.give_silently(b"".join(frames), self.address)
        passed = {}
        for to, data in rig.transport.sent:
            decoder = mavlink.MAVLink(None)
            others = [one for one in decoder.parse_buffer(data) or [] if one.get_srcComponent() != 1]
            passed.setdefault(to, []).extend(others)
        return {to: [bytes(one.get_msgbuf()) for one in frames] for to, frames in passed.items() if frames}


@pytest.fixture
def net(make_rig):
    """A station, a companion and a second station on one boat."""

    def make(**transport):
        rig = make_rig(addresses=("a", "b", "c"), **transport)

        def give_silently(data, address):
            rig.transport.inbox.append((address, data))
            rig.endpoint.service(rig.now_s, [rig.transport.descriptor])
            while rig.endpoint.busy:
                rig.endpoint.service(rig.now_s, [])

        rig.give_silently = give_silently
        rig.tick()
        return rig, Voice(rig, "a", 255, 190), Voice(rig, "b", 1, 191), Voice(rig, "c", 254, 190)

    return make


def command(system, component, number=400):
    return mavlink.MAVLink_command_long_message(system, component, number, 0, 1, 0, 0, 0, 0, 0, 0)


def test_what_is_for_all_goes_to_everybody_else_as_it_came(net):
    _, station, _, _ = net()
    frame = station.frame(BEAT)
    assert station.send(frame) == {"b": [frame], "c": [frame]}


def test_what_is_for_one_goes_where_that_one_was_heard_and_is_not_done_here(net):
    rig, station, companion, _ = net()
    assert station.say(command(1, 191)) == {}  # no peer knows him yet
    companion.say(BEAT)
    frame = station.frame(command(1, 191))
    assert station.send(frame) == {"b": [frame]}
    assert rig.request_handler.intents == []
    frame = companion.frame(mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190))
    assert companion.send(frame) == {"a": [frame]}


def test_what_is_for_the_boat_stays_and_what_is_for_all_of_its_components_goes_on_too(net):
    rig, station, companion, _ = net()
    companion.say(BEAT)
    assert station.say(command(1, 1)) == {}
    assert len(rig.request_handler.intents) == 1
    frame = station.frame(command(1, 0))
    assert station.send(frame) == {"b": [frame]}
    assert len(rig.request_handler.intents) == 2


def test_a_frame_that_comes_round_is_not_passed_on_again(net):
    rig, station, companion, other = net()
    frame = station.frame(BEAT)
    station.send(frame)
    assert other.send(frame) == {}  # by a strange way
    assert station.send(frame) == {}  # by its own: the same bytes
    rig.now_s += DUPLICATE_S + 0.1
    assert other.send(frame) == {}
    assert companion.say(BEAT)
    assert station.say(BEAT)


def test_the_boats_own_frames_that_come_back_go_nowhere(net):
    rig, _, _, _ = net()
    echo = Voice(rig, "c", 1, 1)
    assert echo.say(BEAT) == {}


def test_a_sender_that_has_moved_is_believed_after_a_silence(net):
    rig, station, companion, _ = net()
    companion.say(BEAT)
    moved = Voice(rig, "c", 1, 191)
    moved.mav.seq = 50
    assert moved.say(BEAT) == {}
    rig.now_s += ROUTE_TIMEOUT_S
    assert set(moved.say(BEAT)) == {"a", "b"}
    assert set(station.say(command(1, 191))) == {"c"}


@pytest.mark.parametrize(
    ("options", "routed"),
    [
        (LinkOptions(), True),
        (LinkOptions(route=False), False),
        (LinkOptions(link_class=LinkClass.RADIO), False),
        (LinkOptions(link_class=LinkClass.SATELLITE), False),
        (LinkOptions(link_class=LinkClass.RADIO, route=True), True),
        (LinkOptions(link_class=LinkClass.SATELLITE, route=True), True),
        (LinkOptions(systems=frozenset({7})), False),
        (LinkOptions(policy=Policy.SIGNED_COMMANDS), False),
    ],
)
def test_links_that_route_and_those_who_may_command(net, options, routed):
    _, station, _, _ = net(options=options)
    assert bool(station.say(BEAT)) is routed


def test_a_flood_is_cut_and_reported(net):
    rig, station, _, _ = net()
    passed = station.send(*(station.frame(BEAT) for _ in range(200)))
    assert len(passed["b"]) <= MAX_BURST
    rig.tick()
    rig.now_s += 10.0
    assert len(station.say(BEAT, BEAT)["b"]) == 2


def test_the_table_is_bounded(net):
    rig, _, _, _ = net()
    for number in range(3 * MAX_ROUTES):
        Voice(rig, "a", 2 + number // 200, 1 + number % 200).say(BEAT)
    assert len(rig.endpoint._router._routes) == MAX_ROUTES


def test_where_a_message_has_its_target_is_read_as_pymavlink_does():
    mav = mavlink.MAVLink(None, srcSystem=3, srcComponent=4)
    for number, kind in mavlink.mavlink_map.items():
        payload = bytes(range(1, 256))[: kind.unpacker.size]
        message = mav.decode(bytearray(_frame(number, payload, kind.crc_extra)))
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0) if system else 0
        assert routing._target(Frame(number, bytes(message.get_msgbuf()))) == (system, component), kind.msgname


def _frame(number, payload, seed):
    head = bytes((0xFD, len(payload), 0, 0, 9, 3, 4)) + number.to_bytes(3, "little") + payload
    return head + mcrf4xx(head[1:] + bytes((seed,))).to_bytes(2, "little")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 255), st.integers(0, 255)), max_size=12))
def test_nothing_comes_back_to_its_sender_and_no_frame_goes_twice(net, voices):
    rig, *_ = net()
    for address, system, component in voices:
        voice = Voice(rig, address, system, component)
        frame = voice.frame(BEAT)
        passed = voice.send(frame)
        assert address not in passed
        assert all(frames == [frame] for frames in passed.values())
        assert voice.send(frame) == {}
