"""Active and pending peers: admission, eviction, and what each is sent."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.link_status import PeerStatus
from firmware_py.common.parameter_table import TABLE
from firmware_py.link.peers import Peer
from firmware_py.link.wire.frames import Frame
from firmware_py.link.wire.outbox import UnsignedSealer
from firmware_py.link.wire.urls import LinkClass, LinkOptions, parse_options
from support.link import KEY, NOW, MemoryTransport, sign, without_unrequested

FORGET_S = 300.0
MAX_ACTIVE_PEERS = 8
MAX_PENDING_PEERS = 16
QUIET_S = 10.0
UNPROVEN_AFTER_S = 10.0

BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
READ = mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
READ_ALL = mavlink.MAVLink_param_request_list_message(1, 1)


@pytest.fixture
def open_rig(make_rig):
    """A rig on a transport like udpin, where no peer is known at first."""
    return make_rig(addresses=())


@pytest.fixture
def keyed(make_rig):
    """Makes a rig with a key on a link of the given options."""

    def make(options="policy=auto", **more):
        rig = make_rig(options=parse_options(options), addresses=(), **more)
        assert rig.endpoint._signing.set_key(KEY, NOW)
        return rig

    return make


def kinds(messages):
    return [message.get_type() for message in messages]


def active_addresses(rig):
    return {peer.address for peer in rig.endpoint._peers}


def test_noise_of_an_unknown_sender_gets_no_reply(open_rig):
    assert open_rig.give(b"\xfd\x00noise" * 50, "stranger") == []
    assert open_rig.tick() == []
    assert open_rig.endpoint._peers.rejected == 1


def test_sender_of_one_frame_gets_a_few_heartbeats_only(open_rig):
    beats_s = [open_rig.now_s for _ in without_unrequested(open_rig.send(BEAT, address="station"))]
    for _ in range(120):
        replies = open_rig.tick(seconds=0.25, armed=False)
        assert set(kinds(replies)) <= {"HEARTBEAT"}
        beats_s += [open_rig.now_s for _ in replies]
    assert beats_s == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]  # 8 bytes for each byte received
    assert active_addresses(open_rig) == set()


def test_peer_that_sends_again_becomes_active(open_rig):
    assert kinds(open_rig.send(BEAT, address="station")) == ["HEARTBEAT"]
    open_rig.send(BEAT, address="station")
    assert active_addresses(open_rig) == {"station"}
    assert "ATTITUDE" in kinds(open_rig.ticks(5))


def test_pending_peer_that_uploads_is_not_removed(open_rig):
    """Another peer is refused meanwhile."""
    count = mavlink.MAVLink_mission_count_message(1, 1, 3, 0)
    replies = open_rig.send(count, address="first")
    assert "MISSION_REQUEST" in {kind.removesuffix("_INT") for kind in kinds(replies)}
    assert active_addresses(open_rig) == set()
    replies = open_rig.send(count, address="second")
    acks = [message.type for message in replies if message.get_type() == "MISSION_ACK"]
    assert acks == [mavlink.MAV_MISSION_DENIED]


def test_rest_of_a_datagram_does_not_prove_the_peer(open_rig):
    """It is processed in pieces, with replies between them."""
    pings = b"".join(open_rig.frame(mavlink.MAVLink_ping_message(0, number, 0, 0)) for number in range(60))
    open_rig.give(pings, "victim")
    assert active_addresses(open_rig) == set()


def test_long_reply_is_completed_after_the_peer_is_proven(open_rig):
    first = open_rig.send(READ_ALL, address="station")
    second = open_rig.send(BEAT, address="station")
    assert 0 < kinds(first).count("PARAM_VALUE") <= 5
    rows = [message.param_index for message in (*first, *second) if message.get_type() == "PARAM_VALUE"]
    assert rows == list(range(len(TABLE)))


def test_silent_peer_must_prove_its_address_again(open_rig):
    open_rig.prove()
    open_rig.tick_silently(seconds=UNPROVEN_AFTER_S)
    assert "ATTITUDE" in kinds(open_rig.replies())
    open_rig.tick(seconds=0.1)
    assert open_rig.ticks(300) == []
    assert kinds(open_rig.send(READ, address="station")).count("PARAM_VALUE") == 1
    assert "ATTITUDE" not in kinds(open_rig.ticks(20))
    open_rig.send(BEAT, address="station")
    assert "ATTITUDE" in kinds(open_rig.ticks(5))


def test_signing_peer_is_proven_at_once(keyed):
    rig = keyed()
    sign(rig)
    rig.send(BEAT, address="station")
    assert active_addresses(rig) == {"station"}
    rig.tick(seconds=UNPROVEN_AFTER_S + 1.0)
    rig.tick_silently()
    assert rig.transport.sent


@pytest.mark.parametrize(("silence_s", "is_due"), [(3.0, False), (3.1, True)])
def test_silent_peer_may_have_restarted_after_three_seconds(silence_s, is_due):
    peer = Peer(MemoryTransport(), "station", UnsignedSealer(), 0.0)
    assert peer.may_need_introduction(0.0)
    peer.is_introduced = True
    assert peer.may_need_introduction(0.0)  # no frame yet
    peer.register_reception(20, 5.0)
    assert peer.may_need_introduction(5.0 + silence_s) is is_due


@pytest.mark.parametrize(("is_satellite", "sent_bytes"), [(True, 0), (True, 20), (False, 0), (False, 20)])
def test_reply_of_an_unproven_peer_proves_it(is_satellite, sent_bytes):
    link_class = LinkClass.SATELLITE if is_satellite else LinkClass.FAST
    peer = Peer(MemoryTransport(options=LinkOptions(link_class=link_class)), "station", UnsignedSealer(), 0.0)
    peer.outbox.sent_bytes = 100  # from before the peer became unproven
    peer.mark_unproven()
    assert (peer.is_proven, peer.bulk_frames(50, 0.0)) == (False, 0)
    peer.outbox.sent_bytes += sent_bytes
    assert peer.register_reception(20, 0.0) is (is_satellite or sent_bytes > 0)
    if not is_satellite and not sent_bytes:
        assert peer.outbox.credit_bytes == 160
    # A peer that received nothing, or that pays for each message, does not select MAVLink 1.
    peer.outbox.sent_bytes = sent_bytes
    for t_s in (0.0, 3.0, 6.0, 9.0, 10.0):
        peer.update_version([Frame(0, b"\xfe")], t_s)
    assert peer.outbox.is_mavlink1_only is (not is_satellite and sent_bytes > 0)


def test_start_of_a_frame_of_a_new_peer_is_kept(open_rig):
    second = open_rig.frame(BEAT)
    open_rig.give(open_rig.frame(BEAT) + second[:10], "station")
    open_rig.give(second[10:], "station")
    assert active_addresses(open_rig) == {"station"}


@pytest.mark.parametrize(
    ("address", "text"), [(("192.0.2.1", 14550), "192.0.2.1:14550"), ("line", "line"), (7, "memory")]
)
def test_status_of_a_peer_has_its_address_and_counts(address, text):
    peer = Peer(MemoryTransport(), address, UnsignedSealer(), 0.0)
    assert peer.status(12.0, has_place=False) == PeerStatus(text, False, False, False, None, 0, 0, 0)
    peer.register_reception(20, 10.0)
    peer.ground_station_s, peer.is_verified = 9.0, True
    peer.outbox.sent_bytes, peer.outbox.dropped, peer.splitter.rejected = 100, 3, 4
    assert peer.status(12.0, has_place=True) == PeerStatus(text, True, True, True, 2.0, 100, 3, 4)


def test_modem_reduces_the_rate_of_messages_and_transfers_until_it_is_silent():
    def sent_frames(now_s):
        """Return the frames of 10 bytes of a transfer, and the bytes of messages, half a second after an empty line."""
        peer.bulk.spend(10 * peer.bulk.max_frames(10, 0, now_s))
        peer.outbox._bytes.spend(peer.outbox.available_bytes(now_s))
        return peer.bulk.max_frames(10, 0, now_s + 0.25), peer.outbox.available_bytes(now_s + 0.25)

    peer = Peer(MemoryTransport(byte_rate=1600.0), "line", UnsignedSealer(), 0.0)
    assert sent_frames(1.0) == (28, 400.0)
    peer.adapt_to_radio(0, 2.0)
    assert sent_frames(3.0) == (14, 200.0)
    peer.reset_radio_after_silence(12.0)
    assert sent_frames(12.0) == (14, 200.0)
    peer.reset_radio_after_silence(13.0)
    assert sent_frames(14.0) == (28, 400.0)


def test_requests_of_a_peer_that_moves_are_copied():
    old, new = (Peer(MemoryTransport(), address, UnsignedSealer(), 0.0) for address in ("old", "new"))
    old.ground_station_s, old.is_introduced, old.parameter_list_row = 5.0, True, 7
    new.copy_requests(old)
    assert (new.streams, new.ground_station_s, new.is_introduced) == (old.streams, 5.0, True)
    assert new.parameter_list_row == 7
    assert new.parameter_rows_due is old.parameter_rows_due
    assert new.extended_rows_due is old.extended_rows_due


def test_peer_with_the_longest_silence_is_evicted(open_rig, texts):
    for number in range(MAX_ACTIVE_PEERS):
        open_rig.now_s += 1.0
        open_rig.prove(number)
    replies = open_rig.prove("late")
    assert "late" not in active_addresses(open_rig)
    assert "Station late refused: memory is full" in texts(replies)
    assert open_rig.endpoint._peers.rejected == 1
    open_rig.now_s += QUIET_S
    open_rig.prove("late")
    assert active_addresses(open_rig) == {*range(1, MAX_ACTIVE_PEERS), "late"}


def test_capacity_is_shared_between_hosts(open_rig):
    for port in range(2 * MAX_ACTIVE_PEERS):
        open_rig.prove(("crowd", port))
    assert len(active_addresses(open_rig)) == MAX_ACTIVE_PEERS
    for number in range(MAX_ACTIVE_PEERS // 2):
        open_rig.prove((f"host {number}", 1))
    hosts = [host for host, _ in active_addresses(open_rig)]
    assert hosts.count("crowd") == MAX_ACTIVE_PEERS // 2
    assert len(set(hosts)) == 1 + MAX_ACTIVE_PEERS // 2


def test_station_with_the_key_is_always_admitted(keyed):
    rig = keyed()
    for number in range(MAX_ACTIVE_PEERS):
        rig.prove((f"127.0.0.{number}", 1))
    assert len(active_addresses(rig)) == MAX_ACTIVE_PEERS // 2
    sign(rig)
    for number in range(MAX_ACTIVE_PEERS):
        rig.send(BEAT, address=(f"192.0.2.{number}", 1))
    assert {host for host, _ in active_addresses(rig)} == {f"192.0.2.{number}" for number in range(MAX_ACTIVE_PEERS)}


def test_pending_peers_do_not_block_others(open_rig):
    for number in range(10 * MAX_PENDING_PEERS):
        open_rig.send(BEAT, address=(f"host {number}", 1))
    assert len(tuple(open_rig.endpoint._peers.all_peers())) == MAX_PENDING_PEERS
    open_rig.prove("station")
    assert active_addresses(open_rig) == {"station"}


def test_host_does_not_evict_pending_peers_of_another_host(open_rig):
    open_rig.send(BEAT, address=("station", 1))
    for port in range(10 * MAX_PENDING_PEERS):
        open_rig.send(BEAT, address=("crowd", port))
    open_rig.send(BEAT, address=("station", 1))
    assert active_addresses(open_rig) == {("station", 1)}


def test_silent_peer_is_removed(open_rig):
    open_rig.prove("active")
    open_rig.prove("silent")
    open_rig.now_s = 299.0
    open_rig.send(BEAT, address="active")
    open_rig.tick(seconds=1.0)
    assert active_addresses(open_rig) == {"active", "silent"}
    open_rig.tick()
    assert active_addresses(open_rig) == {"active"}


def test_damaged_frames_of_removed_peers_are_counted(connected):
    rig = connected()
    damaged = bytearray(rig.frame(BEAT))
    damaged[12] ^= 1
    for count, address in enumerate((("client", 1), ("client", 2), ("client", 2)), 1):
        rig.transport.connected = (address,)
        rig.tick()
        rig.give(bytes(damaged), address)
        assert rig.endpoint._peers.damaged_frames() == count


def test_permanent_peer_is_not_removed(rig):
    rig.tick(seconds=10 * FORGET_S)
    assert len(rig.endpoint._peers) == 1
    rig.tick_silently(seconds=1.0)
    assert rig.transport.sent


def test_status_contains_the_age_of_the_latest_valid_frame(rig):
    def heard_age_s():
        (link,) = rig.endpoint.status(rig.now_s)
        return link.peers[0].heard_age_s

    rig.give(b"\xfd\x00noise" * 50)
    assert heard_age_s() is None
    rig.send(BEAT)
    assert heard_age_s() == 0.0
    rig.tick(seconds=2.5)
    assert heard_age_s() == 2.5


def test_closed_connection_is_removed_at_once(make_rig):
    rig = make_rig(is_datagram=False)
    rig.tick()
    rig.transport.served = ()
    rig.tick()
    assert len(rig.endpoint._peers) == 0


def test_bytes_of_peers_are_not_mixed(make_rig):
    rig = make_rig(addresses=("one", "two"), options=parse_options("route=0"))
    rig.tick()
    frame = rig.frame(mavlink.MAVLink_ping_message(1, 1, 0, 0))
    assert rig.give(frame[:10], "one") == []
    assert rig.give(frame[10:], "two") == []
    assert [message.get_type() for message in rig.give(frame[10:], "one")] == ["PING"]


# --------------------------------------------------------------------------- connections


@pytest.fixture
def connected(make_rig):
    """Makes a rig on a transport like tcpin with one client that has sent nothing."""

    def make(options="policy=auto", *, key=False):
        rig = make_rig(options=parse_options(options), addresses=(), is_datagram=False)
        if key:
            assert rig.endpoint._signing.set_key(KEY, NOW)
        rig.transport.connected = (("client", 1),)
        rig.tick()
        return rig

    return make


@pytest.mark.parametrize(("policy", "allowed_kinds"), [("open", {"HEARTBEAT"}), ("signed-only", set())])
def test_client_without_a_frame_is_dropped(connected, policy, allowed_kinds):
    rig = connected(f"policy={policy}", key=True)
    assert {kind for _ in range(9) for kind in kinds(without_unrequested(rig.tick(seconds=1.0)))} <= allowed_kinds
    assert rig.transport.dropped == []
    assert active_addresses(rig) == set()
    rig.tick(seconds=2.0)
    assert rig.transport.dropped == [("client", 1)]


def test_dropped_client_is_reported_to_the_stations(connected, texts):
    rig = connected()
    rig.transport.served = ("station",)
    rig.send(BEAT, address="datagram peer")  # has no connection
    assert texts(rig.tick(seconds=10.0)) == []
    assert texts(rig.tick()) == ["client on memory dropped: no valid frame"]


def test_client_with_noise_is_dropped(connected):
    rig = connected()
    for _ in range(11):
        rig.give(b"\xfd\x09noise", ("client", 1))
        rig.tick(seconds=1.0)
    assert rig.transport.dropped == [("client", 1)]


def test_client_is_active_from_its_first_frame_until_it_is_silent(connected):
    rig = connected()
    assert "PARAM_VALUE" in kinds(rig.send(READ, address=("client", 1)))
    assert active_addresses(rig) == {("client", 1)}
    rig.tick(seconds=FORGET_S - 1.0)
    rig.tick_silently(seconds=0.5)
    assert rig.transport.sent
    rig.tick(seconds=1.0)
    assert rig.transport.dropped == [("client", 1)]


def test_silent_connections_do_not_exclude_a_station(connected):
    rig = connected("policy=signed-only", key=True)
    rig.transport.connected += tuple(("crowd", number) for number in range(4 * MAX_PENDING_PEERS))
    rig.tick()
    assert len(rig.transport.connected) == MAX_PENDING_PEERS
    rig.transport.connected += (("station", 1),)
    rig.tick()
    sign(rig)
    assert "PARAM_VALUE" in kinds(rig.send(READ, address=("station", 1)))


def test_station_with_an_old_timestamp_gets_a_signed_heartbeat_on_a_connection(connected):
    rig = connected("policy=signed-only", key=True)
    sign(rig)
    rig.station.signing.timestamp = NOW - 120 * 100_000
    replies = rig.send(BEAT, address=("client", 1))
    assert "HEARTBEAT" in kinds(replies)
    assert active_addresses(rig) == set()


# --------------------------------------------------------------------------- radio status, blocked links


@pytest.mark.parametrize("byte_rate", [None, 5760.0])
def test_radio_status_is_accepted_on_a_line_only(keyed, byte_rate):
    rig = keyed("policy=signed-only", byte_rate=byte_rate)
    rig.transport.served = () if byte_rate is None else ("line",)
    rig.tick()
    before = active_addresses(rig)
    status = mavlink.MAVLink_radio_status_message(1, 1, 100, 0, 0, 0, 0)
    assert rig.send(status, status, address="line") == []
    assert active_addresses(rig) == before
    assert rig.endpoint._gate.refused_frames == 0


def test_blocked_link_is_reported_once_over_the_other_links(rig, texts):
    rig.tick()
    reports = []
    for blocked_reason in ("network is unreachable", "", "network is unreachable"):
        rig.transport.blocked_reason = blocked_reason
        reports += texts(rig.ticks(50))
        assert rig.endpoint.status(rig.now_s)[0].blocked_reason == blocked_reason
    assert reports == []  # for five seconds at a time
    rig.transport.blocked_reason = ""
    rig.tick()
    rig.transport.blocked_reason = "network is unreachable"
    rig.tick()
    assert texts(rig.tick(seconds=9.9)) == []
    assert texts(rig.tick(seconds=0.101)) == ["Link blocked: memory: network is unreachable"]
    assert texts(rig.ticks(600)) == []
    rig.transport.blocked_reason = ""
    rig.tick()
    rig.transport.blocked_reason = "no buffer space available"
    assert texts(rig.ticks(200)) == ["Link blocked: memory: no buffer space available"]
