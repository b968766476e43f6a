"""Who is on the roster."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.link.peer import FORGET_S, MAX_PEERS, QUIET_S

BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)


@pytest.fixture
def open_rig(make_rig):
    """A rig on a transport like udpin, where nobody is known at first."""
    return make_rig(addresses=())


def test_noise_from_a_stranger_draws_nothing(open_rig):
    open_rig.give(b"\xfd\x00noise" * 50, "stranger")
    assert open_rig.tick() == []
    assert open_rig.endpoint._peers.rejected == 1


def test_a_stranger_with_a_frame_is_greeted_and_served(open_rig):
    said = open_rig.tell(BEAT, address="station")
    assert [message.get_type() for message in said] == ["HEARTBEAT"]
    assert open_rig.tick()


def test_the_roster_is_bounded_and_the_longest_silent_makes_room(open_rig):
    for number in range(MAX_PEERS):
        open_rig.now_s += 1.0
        open_rig.tell(BEAT, address=number)
    assert open_rig.tell(BEAT, address="late") == []
    open_rig.now_s += QUIET_S
    assert open_rig.tell(BEAT, address="late") != []
    addresses = {peer.address for peer in open_rig.endpoint._peers}
    assert addresses == {*range(1, MAX_PEERS), "late"}


def test_a_peer_that_speaks_stays_and_a_silent_one_is_forgotten(open_rig):
    open_rig.tell(BEAT, address="speaks")
    open_rig.tell(BEAT, address="silent")
    open_rig.now_s += FORGET_S - 1.0
    open_rig.tell(BEAT, address="speaks")
    open_rig.tick(seconds=2.0)
    assert [peer.address for peer in open_rig.endpoint._peers] == ["speaks"]


def test_a_permanent_peer_stays_however_silent(rig):
    rig.tick(seconds=10 * FORGET_S)
    assert len(rig.endpoint._peers) == 1


def test_a_connection_that_is_lost_goes_at_once(make_rig):
    rig = make_rig(datagrams=False)
    rig.tick()
    rig.transport.served = ()
    rig.tick()
    assert len(rig.endpoint._peers) == 0


def test_parsers_do_not_mix_peers(make_rig):
    rig = make_rig(addresses=("one", "two"))
    rig.tick()
    frame = rig.frame(mavlink.MAVLink_ping_message(1, 1, 0, 0))
    assert rig.give(frame[:10], "one") == []
    assert rig.give(frame[10:], "two") == []
    assert [message.get_type() for message in rig.give(frame[10:], "one")] == ["PING"]
