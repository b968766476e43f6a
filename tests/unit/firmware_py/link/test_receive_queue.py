"""Fair sharing of the receive queue between peers."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.endpoint import ReceiveQueue

MAX_SHARE_BYTES = 16_384


@pytest.fixture
def queue():
    return ReceiveQueue(lambda _index, address: address in ("one", "two"))


def pop_all(queue):
    found = []
    while queue:
        found.append(queue.pop())
    return found


def test_peers_are_processed_in_turn(queue):
    for number in range(3):
        queue.offer(0, "one", b"a%d" % number)
    queue.offer(0, "two", b"b")
    queue.offer(1, "one", b"c")
    assert pop_all(queue) == [
        (0, "one", b"a0"),
        (0, "two", b"b"),
        (1, "one", b"c"),
        (0, "one", b"a1"),
        (0, "one", b"a2"),
    ]
    with pytest.raises(KeyError):
        queue.pop()


def test_transport_has_bytes_while_those_of_a_peer_are_queued(queue):
    queue.offer(0, "stranger", b"a")
    assert [queue.has_bytes_of(index) for index in (-2, 0, 1)] == [False] * 3
    queue.offer(1, "one", b"a")
    assert [queue.has_bytes_of(index) for index in (0, 1)] == [False, True]


def test_bytes_beyond_a_share_are_dropped(queue):
    for _ in range(1000):
        queue.offer(0, "one", bytes(1000))
    queue.offer(0, "two", b"b")
    found = pop_all(queue)
    assert sum(len(data) for _, address, data in found if address == "one") == 16_000
    assert (0, "two", b"b") in found[:2]
    assert queue.dropped == 1001 - len(found)
    queue.offer(0, "one", bytes(3 * MAX_SHARE_BYTES))  # one piece is queued in any case
    queue.offer(0, "one", b"a")
    assert len(pop_all(queue)) == 1
    for size in (MAX_SHARE_BYTES - 1, 1, 1):
        queue.offer(0, "one", bytes(size))
    assert [len(data) for *_, data in pop_all(queue)] == [MAX_SHARE_BYTES - 1, 1]
    for size in (MAX_SHARE_BYTES - 2, 1):
        queue.offer(0, "one", bytes(size))
    queue.put_back(*queue.pop())
    assert len(queue.pop()[2]) == MAX_SHARE_BYTES - 2
    for size in (MAX_SHARE_BYTES - 1, 1):  # one byte is queued
        queue.offer(0, "one", bytes(size))
    assert [len(data) for *_, data in pop_all(queue)] == [1, MAX_SHARE_BYTES - 1]


def test_rest_of_a_piece_is_processed_before_later_bytes(queue):
    queue.offer(0, "one", b"whole")
    queue.offer(0, "one", b"later")
    index, address, data = queue.pop()
    queue.put_back(index, address, data[2:])
    assert pop_all(queue) == [(0, "one", b"ole"), (0, "one", b"later")]
    queue.put_back(0, "two", b"alone")
    assert pop_all(queue) == [(0, "two", b"alone")]


@pytest.mark.parametrize("address", ["station", "a stranger"])
def test_long_datagram_is_processed_in_pieces(make_rig, of, address):
    rig = make_rig(addresses=("station",))
    rig.endpoint.service(0.0, [])
    pings = b"".join(rig.frame(mavlink.MAVLink_ping_message(0, number, 0, 0)) for number in range(60))
    assert 1000 < len(pings) < 2048
    rig.transport.inbox.append((address, pings))
    calls, received = 0, []
    rig.endpoint.service(rig.now_s, [100])
    while rig.endpoint.busy:
        calls += 1
        received += [message.seq for message in of(rig.replies(address), "PING")]
        rig.endpoint.service(rig.now_s, [])
    received += [message.seq for message in of(rig.replies(address), "PING")]
    assert received == list(range(60))
    assert calls >= 60 // 4 - 1


def test_bytes_after_noise_of_an_unknown_sender_are_ignored(make_rig, of):
    rig = make_rig(addresses=("station",))
    rig.endpoint.service(0.0, [])
    rig.transport.inbox.append(("a stranger", bytes(400) + rig.frame(mavlink.MAVLink_ping_message(0, 1, 0, 0))))
    rig.endpoint.service(rig.now_s, [100])
    assert not rig.endpoint.busy
    assert of(rig.replies("a stranger"), "PING") == []


def test_unknown_senders_have_one_common_share(queue):
    for number in range(1000):
        queue.offer(0, number, bytes(1000))
    queue.offer(0, "one", b"a")
    found = pop_all(queue)
    assert len(found) == 16 + 1
    assert (0, "one", b"a") in found[:2]


def test_station_gets_replies_during_a_flood(make_rig):
    """The boat replies soon to a ping while all other peers flood."""
    rig = make_rig(addresses=())
    rig.prove()
    request = rig.frame(mavlink.MAVLink_param_request_list_message(1, 1))
    for flooder in range(7):
        rig.prove(flooder)
    for turn in range(20):
        for flooder in range(7):
            rig.transport.inbox += [(flooder, request * 60)] * 6
        rig.transport.inbox.append(("station", rig.frame(mavlink.MAVLink_ping_message(0, turn, 0, 0))))
        calls = 0
        rig.endpoint.service(rig.now_s, [100])
        while not any(message.get_type() == "PING" and message.seq == turn for message in rig.replies("station")):
            calls += 1
            assert calls < 200
            rig.endpoint.service(rig.now_s, [])
    assert len(rig.endpoint._unread) < 200


def test_one_call_sends_at_most_32_parameters_to_all_peers(make_rig):
    rig = make_rig(addresses=tuple(range(8)))
    rig.endpoint.service(0.0, [])
    rig.tick()
    for address in range(8):
        rig.transport.inbox.append((address, rig.frame(mavlink.MAVLink_param_request_list_message(1, 1))))
    max_count = 0
    rig.endpoint.service(0.0, [100])
    while rig.endpoint.busy:
        max_count = max(max_count, sum(message.get_type() == "PARAM_VALUE" for message in rig.replies()))
        rig.endpoint.service(0.0, [])
    assert 0 < max_count <= 32
