"""Routing of messages between the links: destinations, and messages that are never forwarded."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.crc16 import mcrf4xx
from firmware_py.link import routing
from firmware_py.link.peers import Peer
from firmware_py.link.wire.frames import Frame
from firmware_py.link.wire.outbox import UnsignedSealer
from firmware_py.link.wire.urls import LinkClass, LinkOptions, Policy
from support.link import MemoryTransport

DUPLICATE_S = 3.0
MAX_BURST = 100
MAX_ROUTES = 64
ROUTE_TIMEOUT_S = 10.0

BEAT = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)  # of an onboard controller


class NetworkComponent:
    """A component of the network, which sends from an address."""

    def __init__(self, rig, address, system, component):
        self.rig, self.address = rig, address
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def frame(self, message):
        data = message.pack(self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    def send(self, *messages):
        """Send messages; return the frames that the boat forwarded, by address."""
        return self.send_frames(*map(self.frame, messages))

    def send_frames(self, *frames):
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
            rig.finish()

        rig.give_silently = give_silently
        rig.tick()
        return (
            rig,
            NetworkComponent(rig, "a", 255, 190),
            NetworkComponent(rig, "b", 1, 191),
            NetworkComponent(rig, "c", 254, 190),
        )

    return make


def command(system, component, number=mavlink.MAV_CMD_COMPONENT_ARM_DISARM):
    return mavlink.MAVLink_command_long_message(system, component, number, 0, 1, 0, 0, 0, 0, 0, 0)


def test_broadcast_is_forwarded_unchanged_to_all_other_peers(net):
    _, station, _, _ = net()
    frame = station.frame(BEAT)
    assert station.send_frames(frame) == {"b": [frame], "c": [frame]}


def test_addressed_message_is_forwarded_on_its_route_and_not_executed(net):
    rig, station, companion, _ = net()
    assert station.send(command(1, 191)) == {}  # there is no route to it yet
    companion.send(BEAT)
    assert station.send(command(1, 192), command(2, 191)) == {}
    frame = station.frame(command(1, 191))
    assert station.send_frames(frame) == {"b": [frame]}
    assert rig.request_handler.intents == []
    frame = companion.frame(
        mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 255, 190)
    )
    assert companion.send_frames(frame) == {"a": [frame]}


def test_message_to_the_boat_is_not_forwarded_unless_to_all_components(net):
    rig, station, companion, _ = net()
    companion.send(BEAT)
    assert station.send(command(1, 1)) == {}
    assert len(rig.request_handler.intents) == 1
    frame = station.frame(command(1, 0))
    assert station.send_frames(frame) == {"b": [frame]}
    assert len(rig.request_handler.intents) == 2


def test_looped_frame_is_not_forwarded_again(net):
    rig, station, companion, other = net()
    frame = station.frame(BEAT)
    station.send_frames(frame)
    assert other.send_frames(frame) == {}  # from another peer than the route to the sender
    assert station.send_frames(frame) == {}  # from its own peer, but the same bytes
    rig.now_s += DUPLICATE_S
    assert station.send_frames(frame) == {}
    rig.now_s += 0.1
    assert other.send_frames(frame) == {}
    assert station.send_frames(frame) == {"b": [frame], "c": [frame]}
    assert companion.send(BEAT)
    assert station.send(BEAT)


def test_own_looped_frame_is_not_forwarded(net):
    rig, _, _, _ = net()
    echo = NetworkComponent(rig, "c", 1, 1)
    assert echo.send(BEAT) == {}


def test_route_changes_after_silence_of_the_sender(net):
    rig, station, companion, _ = net()
    companion.send(BEAT)
    moved = NetworkComponent(rig, "c", 1, 191)
    moved.mav.seq = 50
    assert moved.send(BEAT) == {}
    rig.now_s += ROUTE_TIMEOUT_S
    assert set(moved.send(BEAT)) == {"a", "b"}
    assert set(station.send(command(1, 191))) == {"c"}


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
def test_only_routed_links_and_commanders_are_forwarded(net, options, routed):
    _, station, _, _ = net(options=options)
    assert bool(station.send(BEAT)) is routed


def test_routing_overload_is_limited_and_reported(net):
    rig, station, _, _ = net()

    def send(count, address="b"):
        return len(station.send(*[BEAT] * count).get(address, ()))

    assert send(150) == MAX_BURST
    rig.now_s += 0.1
    assert send(150) == 20
    rig.now_s += 10.0
    assert (send(2), send(2, "c")) == (2, 2)
    for component in range(8):
        NetworkComponent(rig, "a", 255, component).send(*[BEAT] * 150)
    assert len(rig.endpoint._router._recent_frames) == 1024


def test_blocked_peer_gets_the_first_32_routed_messages(net):
    rig, station, companion, _ = net()
    companion.send(BEAT)
    rig.transport.is_writable = False
    frames = [station.frame(command(1, 191)) for _ in range(40)]
    assert station.send_frames(*frames) == {}
    rig.transport.is_writable = True
    rig.endpoint.service(rig.now_s, [])
    sent = b"".join(data for to, data in rig.transport.sent if to == "b")
    assert [frame for frame in frames if frame in sent] == frames[:32]


def test_frames_of_an_unproven_peer_are_not_routed(net):
    rig, _, _, other = net()
    other.address = "stranger"
    assert set(other.send(BEAT)) <= {"stranger"}
    assert set(other.send(BEAT)) >= {"a", "b", "c"}  # it is proven by its second frame
    rig.tick(seconds=10.1)
    passed = NetworkComponent(rig, "a", 255, 190).send(BEAT)
    assert "stranger" not in passed  # it must prove its address again
    assert set(passed) == {"b", "c"}


def test_number_of_routes_is_limited(net):
    rig, _, _, _ = net()
    for number in range(3 * MAX_ROUTES):
        NetworkComponent(rig, "a", 2 + number // 200, 1 + number % 200).send(BEAT)
    assert len(rig.endpoint._router._routes) == MAX_ROUTES


def test_target_address_equals_that_of_pymavlink():
    mav = mavlink.MAVLink(None, srcSystem=3, srcComponent=4)
    for number, kind in mavlink.mavlink_map.items():
        payload = bytes(range(1, 256))[: kind.unpacker.size]
        message = mav.decode(bytearray(_frame(number, payload, kind.crc_extra)))
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0) if system else 0
        assert routing._target(Frame(number, bytes(message.get_msgbuf()))) == (system, component), kind.msgname
        targets = [payload[offset] for offset in routing._target_offsets(kind)]
        assert (*targets, 0, 0)[:2] == (system, component), kind.msgname


def test_target_in_omitted_zeros_is_all_systems():
    ping = mavlink.MAVLink_ping_message(1, 0x01000000, 0, 0).pack(mavlink.MAVLink(None))
    assert ping[1] == 12  # the target would be the next byte
    assert routing._target(Frame(mavlink.MAVLINK_MSG_ID_PING, ping)) == (0, 0)


def _frame(number, payload, seed):
    head = bytes((0xFD, len(payload), 0, 0, 9, 3, 4)) + number.to_bytes(3, "little") + payload
    return head + mcrf4xx(head[1:] + bytes((seed,))).to_bytes(2, "little")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 255), st.integers(0, 255)), max_size=12))
def test_no_frame_returns_to_its_sender_or_is_forwarded_twice(net, senders):
    rig, *_ = net()
    for address, system, component in senders:
        sender = NetworkComponent(rig, address, system, component)
        frame = sender.frame(BEAT)
        passed = sender.send_frames(frame)
        assert address not in passed
        assert all(frames == [frame] for frames in passed.values())
        assert sender.send_frames(frame) == {}


@pytest.mark.parametrize(
    ("link_class", "route", "is_routed"),
    [
        (LinkClass.FAST, None, True),
        (LinkClass.FAST, False, False),
        (LinkClass.RADIO, None, False),
        (LinkClass.RADIO, True, True),
        (LinkClass.SATELLITE, None, False),
        (LinkClass.MESSAGES, True, False),
    ],
)
def test_fast_links_are_routed_unless_an_option_decides(link_class, route, is_routed):
    transport = MemoryTransport(options=LinkOptions(link_class=link_class, route=route))
    assert Peer(transport, "station", UnsignedSealer(), 0.0).is_routed is is_routed
