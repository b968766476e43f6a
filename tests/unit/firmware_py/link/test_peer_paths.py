"""One station on two paths, or on a path that changes: every frame is processed once."""

import heapq
import math
import random

import pytest
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.common.intents import Arm, SteerHeading
from firmware_py.link.files.payload import Opcode
from firmware_py.link.peers import PeerPath, PeerPaths
from firmware_py.link.signing import timestamp_of
from firmware_py.link.wire.urls import parse_options
from firmware_py.plans.items import Command

DUPLICATE_S = 10.0
MIN_IDENTICAL_FRAMES = 3

BEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
RADIO, OTHER = ("10.0.0.1", 1), ("10.0.0.2", 2)  # a router's two sockets
ITEMS = 30
KEY = bytes(range(100, 132))


def yaw(angle_deg):
    return mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_CONDITION_YAW, 0, angle_deg, 0, 1, 1, 0, 0, 0)


def arm(value):
    return mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, value, 0, 0, 0, 0, 0, 0)


def parameter(value):
    return mavlink.MAVLink_param_set_message(1, 1, b"CTL_K1", value, mavlink.MAV_PARAM_TYPE_REAL32)


class TwoPaths:
    """A rig behind a router that sends each frame on two paths; `by`: pairs of address and delay in seconds."""

    def __init__(self, rig):
        self.rig = rig
        self.in_transit = []
        for _ in range(2 + MIN_IDENTICAL_FRAMES):
            self.send(BEAT)
            self.pass_time(1.0)

    def send(self, message, by=((RADIO, 0.0), (OTHER, 0.0))):
        data = self.rig.frame(message)
        for address, delay_s in by:
            heapq.heappush(self.in_transit, (self.rig.now_s + delay_s, len(self.in_transit), address, data))

    def pass_time(self, seconds):
        """Deliver the due frames; return the messages that the boat sends meanwhile, each with its address."""
        replies = []
        end_s = self.rig.now_s + seconds
        while self.rig.now_s < end_s:
            while self.in_transit and self.in_transit[0][0] <= self.rig.now_s:
                *_, address, data = heapq.heappop(self.in_transit)
                self.rig.transport.inbox.append((address, data))
                self.rig.endpoint.service(self.rig.now_s, [self.rig.transport.descriptor])
                self.rig.finish()
            self.rig.tick_silently()
            replies += self.receive()
        return replies

    def receive(self):
        sent, self.rig.transport.sent = self.rig.transport.sent, []
        parser = mavlink.MAVLink(None)
        return [(address, message) for address, data in sent for message in parser.parse_buffer(data) or []]


@pytest.fixture(params=["open", "signed"])
def router(make_rig, request):
    rig = make_rig(addresses=(), options=parse_options("policy=auto"))
    if request.param == "signed":
        now = timestamp_of(rig.utc_s)
        assert rig.endpoint._signing.set_key(KEY, now)
        signing = rig.station.signing
        signing.secret_key, signing.timestamp, signing.sign_outgoing = KEY, now, True
    return TwoPaths(rig)


def turns(rig):
    return [intent for intent in rig.request_handler.intents if isinstance(intent, SteerHeading)]


def test_command_on_two_paths_is_executed_once(router):
    router.send(yaw(10.0), [(RADIO, 0.0), (OTHER, 2.5)])
    router.pass_time(1.0)
    assert len(turns(router.rig)) == 1
    router.send(yaw(10.0), [(OTHER, 0.0), (RADIO, 2.5)])
    router.pass_time(5.0)
    assert [round(math.degrees(turn.heading_rad)) for turn in turns(router.rig)] == [10, 10]


def test_two_ports_of_one_computer_that_send_at_the_same_time_are_both_served(make_rig):
    rig = make_rig(addresses=())
    ports = {("10.0.0.1", 1), ("10.0.0.1", 2)}
    for _ in range(10):
        frame = rig.frame(BEAT)
        for address in sorted(ports):
            rig.give(frame, address)
            rig.now_s += 0.5
    assert {peer.address for peer in rig.endpoint._peers} == ports


def test_late_duplicate_does_not_undo_a_later_command(router):
    for first, then in ((arm(1.0), arm(0.0)), (parameter(0.5), parameter(0.7))):
        router.send(first, [(RADIO, 0.0), (OTHER, 3.0)])
        router.pass_time(1.0)
        router.send(then, [(RADIO, 0.0), (OTHER, 3.0)])
        router.pass_time(5.0)
    assert [intent.armed for intent in router.rig.request_handler.intents if isinstance(intent, Arm)] == [True, False]
    assert router.rig.request_handler.parameters()["CTL_K1"] == pytest.approx(0.7)


def test_both_paths_are_served_and_duplicates_are_not_reported(router, texts):
    replies = []
    for number in range(20):
        router.send(BEAT, [(RADIO, 0.3 * (number % 2)), (OTHER, 0.3 * (1 - number % 2))])
        replies += router.pass_time(1.0)
    assert {address for address, message in replies if message.get_type() == "ATTITUDE"} == {RADIO, OTHER}
    assert texts([message for _, message in replies]) == []


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(1, 20))])
def test_mission_is_uploaded_over_two_lossy_paths(router, seed):
    chances = random.Random(seed)

    def send(message):
        paths = [(address, chances.uniform(0.0, 2.0)) for address in (RADIO, OTHER) if chances.random() > 0.3]
        router.send(message, paths)

    items = [
        mavlink.MAVLink_mission_item_int_message(
            1, 1, n, 6, Command.WAYPOINT, 0, 1, 0, 0, 0, 0, 36_000_000 + n, 12_000_000, 0, 0
        )
        for n in range(ITEMS)
    ]
    last = mavlink.MAVLink_mission_count_message(1, 1, ITEMS, 0)
    send(last)
    sent_s, acks = router.rig.now_s, []
    while not acks and router.rig.now_s < 900.0:
        for _, message in router.pass_time(0.1):
            if message.get_type() == "MISSION_REQUEST_INT" and chances.random() > 0.3:
                last, sent_s = items[message.seq], router.rig.now_s
                send(last)
            elif message.get_type() == "MISSION_ACK":
                acks.append(message.type)
        if router.rig.now_s - sent_s > 5.0:
            sent_s = router.rig.now_s
            send(last)
    assert acks == [0]
    places = [item.x for item in router.rig.request_handler.plans().mission.items]
    assert places == [36_000_000 + n for n in range(1, ITEMS)]


def test_file_whose_end_came_on_one_path_is_stored_completely(stored, tmp_path):
    rig, client = stored(addresses=())
    router = TwoPaths(rig)
    content = bytes(range(200)) * 3
    router.send(client.request(Opcode.CREATE, "/uploads/up.bin"))
    for start in range(0, len(content), 200):
        last = start + 200 >= len(content)
        router.send(
            client.request(Opcode.WRITE, content[start : start + 200], offset=start),
            [(RADIO, 0.0)] + [(OTHER, 0.3)] * (not last),
        )
        router.pass_time(0.5)
    router.send(client.request(Opcode.TERMINATE), [(RADIO, 0.0), (OTHER, 1.0)])
    router.pass_time(3.0)
    assert (tmp_path / "uploads" / "up.bin").read_bytes() == content


# ---------------------------------------------------------------- another port


def test_station_with_a_new_nat_port_continues(make_rig):
    rig = make_rig(addresses=())
    ports = [("198.51.100.7", 40_000 + number) for number in range(8)]
    rig.prove(ports[0])
    items = [
        mavlink.MAVLink_mission_item_int_message(1, 1, n, 6, Command.WAYPOINT, 0, 1, 0, 0, 0, 0, n, n, 0, 0)
        for n in range(40)
    ]
    replies = rig.send(mavlink.MAVLink_mission_count_message(1, 1, 40, 0), address=ports[0])
    while (query := replies[-1]).get_type() == "MISSION_REQUEST_INT":
        rig.tick()
        replies = rig.send(items[query.seq], address=ports[query.seq // 5])
        replies = [message for message in replies if message.get_type() in ("MISSION_REQUEST_INT", "MISSION_ACK")]
    assert (replies[-1].get_type(), replies[-1].type) == ("MISSION_ACK", 0)
    assert len(rig.request_handler.plans().mission.items) == 39
    # Telemetry is sent to its present port only.
    assert {peer.address for peer in rig.endpoint._peers} == {ports[-1]}


def test_rates_and_pending_requests_move_to_the_new_port(make_rig, of):
    rig = make_rig(addresses=())
    old, new = ("198.51.100.7", 1), ("198.51.100.7", 2)
    rig.prove(old)
    set_interval, attitude = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE
    rig.command(set_interval, attitude, 1e6)  # of the peer "station"
    rig.send(mavlink.MAVLink_command_long_message(1, 1, set_interval, 0, attitude, -1, 0, 0, 0, 0, 0), address=old)
    rig.ticks(3)
    rig.prove(new)
    rig.replies()
    assert of(rig.ticks(30), "ATTITUDE") == []


@pytest.mark.parametrize("other", ["another computer", "another id", "a new program"])
def test_another_station_remains_a_separate_peer(make_rig, other):
    rig = make_rig(addresses=())
    rig.station.seq = 250
    rig.prove(("198.51.100.7", 1))
    rig.ticks(5)
    if other == "a new program":
        rig.station.seq = 0
    elif other == "another id":
        rig.station.srcSystem = 254
    rig.prove(("198.51.100.8" if other == "another computer" else "198.51.100.7", 2))
    assert len({peer.path.station for peer in rig.endpoint._peers}) == 2


# ---------------------------------------------------------------- assignment of paths to stations


def beat(number, sender=255, base_mode=0):
    station = mavlink.MAVLink(None, srcSystem=sender, srcComponent=190)
    station.seq = number
    return mavlink.MAVLink_heartbeat_message(6, 8, base_mode, 0, 0, 3).pack(station)


def receive(paths, path, frame, now_s):
    """Process a frame; return whether it is a duplicate."""
    is_duplicate = paths.is_duplicate(path, frame, now_s)
    if not is_duplicate:
        paths.add(path, frame, now_s)
    return is_duplicate


def send_on_both_paths(paths, one, other, count=MIN_IDENTICAL_FRAMES + 1):
    for number in range(count):
        receive(paths, one, beat(number), number)
        receive(paths, other, beat(number), number + 0.5)


def test_paths_belong_to_one_station_after_several_identical_frames():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other, MIN_IDENTICAL_FRAMES)
    assert one.station is not other.station
    send_on_both_paths(paths, one, other)
    assert one.station is other.station


def test_different_frames_with_one_number_separate_two_stations():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    assert not receive(paths, one, beat(9), 9.0)
    assert not receive(paths, other, beat(9, base_mode=1), 9.5)
    assert one.station is not other.station
    assert not receive(paths, other, beat(10), 10.0)
    assert not receive(paths, one, beat(10), 10.5)


def test_frames_of_a_restarted_program_are_accepted():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 5.0)
    for number in range(20):
        assert not receive(paths, one, beat(number), 0.01 * number)
    for number in range(20):
        assert not receive(paths, other, beat(number), 5.0 + 0.01 * number)


def test_frame_number_wraps():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    assert receive(paths, other, beat(3), 3.0 + DUPLICATE_S) is True
    assert receive(paths, one, beat(3), 3.0 + DUPLICATE_S) is False  # the copy on its own path
    assert receive(paths, other, beat(3), 3.0 + 2.0 * DUPLICATE_S + 0.1) is False


@pytest.mark.parametrize(("late_s", "stations"), [(10.0, 2), (10.1, 1)])
def test_different_frame_with_an_old_number_separates_no_paths(late_s, stations):
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    receive(paths, one, beat(9), 9.0)
    receive(paths, other, beat(9, base_mode=1), 9.0 + late_s)
    assert len({one.station, other.station}) == stations


def test_separated_paths_belong_together_after_ten_more_identical_frames():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    receive(paths, one, beat(9), 9.0)
    receive(paths, other, beat(9, base_mode=1), 9.5)
    for count in range(1, 14):
        assert one.station is not other.station
        receive(paths, one, beat(20 + count), 20.0 + count)
        receive(paths, other, beat(20 + count), 20.5 + count)
    assert one.station is other.station


def test_frames_of_the_latest_eight_senders_are_stored():
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    for later_senders, is_known in ((7, True), (8, False)):
        receive(paths, one, beat(50, sender=100), 10.0)
        for sender in range(later_senders):
            receive(paths, one, beat(1, sender=1 + sender), 10.0)
        assert receive(paths, other, beat(50, sender=100), 10.5) is is_known


@pytest.mark.parametrize(
    ("frames", "late_s", "origin", "is_verified", "is_same"),
    [
        (1, 0.0, "a", False, True),
        (16, 10.0, "a", False, True),
        (17, 0.0, "a", False, False),
        (256, 0.0, "a", False, False),
        (1, 10.1, "a", False, False),
        (1, 0.0, "b", False, False),
        (1, 0.0, "b", True, True),
        (2, 0.0, "a", True, False),  # number 0
    ],
)
def test_station_that_moves_continues_its_frame_numbers(frames, late_s, origin, is_verified, is_same):
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath(origin, 20.0)
    first = 254 if frames == 2 else 100
    receive(paths, one, beat(first), 20.0)
    paths.assign_moved(other, beat((first + frames) % 256), 20.0 + late_s, is_verified=is_verified)
    assert (one.station is other.station) is is_same


@pytest.mark.parametrize(("later_frames", "stations"), [(127, 2), (128, 1)])
def test_wrapped_frame_number_separates_no_paths(later_frames, stations):
    """A path may be late by less than half of the sequence numbers; beyond that, an equal number is another frame."""
    paths, one, other = PeerPaths(), PeerPath("a", 0.0), PeerPath("b", 0.0)
    send_on_both_paths(paths, one, other)
    for number in range(later_frames + 1):
        receive(paths, one, beat((9 + number) % 256), 9.0)
    assert not receive(paths, other, beat(9, base_mode=1), 9.5)
    assert len({one.station, other.station}) == stations
