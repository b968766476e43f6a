"""Replies in MAVLink 1 to a station that supports MAVLink 1 only."""

import pytest
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.cli.link_page import list_replies
from firmware_py.link.telemetry.table import TABLE
from firmware_py.link.wire.frames import Codec, Frame, VersionDetector, stamp, to_mavlink1
from support.link import of_type

HEARTBEAT, RADIO_STATUS = mavlink.MAVLINK_MSG_ID_HEARTBEAT, mavlink.MAVLINK_MSG_ID_RADIO_STATUS
BEAT = mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)  # of a ground station
READ = mavlink1.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
GET_HOME = mavlink1.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_GET_HOME_POSITION, 0, 0, 0, 0, 0, 0, 0, 0)
NUMBERS = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}


@pytest.fixture(scope="module")
def sent_numbers():
    """Numbers of all messages that the boat sends, from the sources of the link."""
    return sorted({row.number for row in TABLE} | {NUMBERS[name] for name in list_replies()})


class Mavlink1Station:
    """Ground station that packs and decodes MAVLink 1 only."""

    def __init__(self, rig):
        self.rig = rig
        self.rig.endpoint.service(0.0, [])
        self.protocol = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
        self.protocol.robust_parsing = True

    def send(self, *messages):
        """Send messages; return the replies in MAVLink 1."""
        self.rig.transport.inbox.append(("station", b"".join(message.pack(self.protocol) for message in messages)))
        self.rig.endpoint.service(self.rig.now_s, [self.rig.transport.descriptor])
        self.rig.finish()
        return self.receive()

    def receive(self):
        sent, self.rig.transport.sent = self.rig.transport.sent, []
        messages = self.protocol.parse_buffer(b"".join(data for _, data in sent)) or []
        return [message for message in messages if message.get_msgbuf()[0] == 0xFE]  # pymavlink decodes both versions

    def run(self, seconds):
        """Send a heartbeat each second; return the replies."""
        replies = []
        for _ in range(seconds):
            replies += self.send(BEAT)
            for _ in range(10):
                self.rig.tick_silently()
            replies += self.receive()
        return replies


@pytest.fixture
def station(rig):
    return Mavlink1Station(rig)


def test_converted_messages_have_the_length_of_mavlink1(sent_numbers):
    numbers = [number for number in sent_numbers if number in mavlink1.mavlink_map]
    assert len(numbers) > 30
    for number in numbers:
        size = mavlink1.mavlink_map[number].unpacker.size
        frame = stamp(to_mavlink1(Codec(1, 1).pack_payload(number, bytes(range(1, 256))[:size])), 7)
        assert len(frame) == 6 + size + 2
        decoded = mavlink1.MAVLink(None).decode(bytearray(frame))
        assert (decoded.get_msgId(), decoded.get_seq(), decoded.get_srcSystem()) == (number, 7, 1)


def test_station_receives_replies_and_telemetry_in_mavlink1(station):
    reports = "".join(message.text for message in of_type(station.run(15), "STATUSTEXT"))
    assert reports.count("MAVLink 1 in use: fence, rally and signing need MAVLink 2") == 1
    replies = station.run(5)
    assert len(of_type(replies, "HEARTBEAT")) == 5
    assert len(of_type(replies, "ATTITUDE")) > 5
    (value,) = of_type(station.send(READ), "PARAM_VALUE")
    assert value.param_id == "CTL_K1"
    (ack,) = of_type(station.send(GET_HOME), "COMMAND_ACK")
    assert ack.command == mavlink.MAV_CMD_GET_HOME_POSITION


def test_mission_is_uploaded_and_downloaded_in_mavlink1(station):
    station.run(15)
    make_item = mavlink1.MAVLink_mission_item_int_message
    replies = station.send(mavlink1.MAVLink_mission_count_message(1, 1, 2))
    (request,) = [message for message in replies if "REQUEST" in message.get_type()]
    assert request.seq == 0
    for sequence in range(2):
        position = (360_000_000 + sequence, 1_210_000_000, 0.0)
        replies = station.send(make_item(1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, *position))
    (ack,) = of_type(replies, "MISSION_ACK")
    assert ack.type == 0
    (count,) = of_type(station.send(mavlink1.MAVLink_mission_request_list_message(1, 1)), "MISSION_COUNT")
    assert count.count == 2
    (item,) = of_type(station.send(mavlink1.MAVLink_mission_request_int_message(1, 1, 1)), "MISSION_ITEM_INT")
    assert item.x == 360_000_001


def test_station_that_changes_to_mavlink2_early_receives_mavlink2(rig, station):
    station.run(5)
    for _ in range(30):
        rig.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        rig.tick(seconds=1.0)
    rig.send(mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1))
    assert station.run(5) == []


def test_some_heartbeats_offer_mavlink2_and_one_frame_in_it_is_sufficient(rig, station):
    station.run(15)
    offers = 0
    for _ in range(20):
        station.run(1)
        for _ in range(10):
            rig.tick_silently()
        offers += sum(data.count(b"\xfd\x09\x00\x00") for _, data in rig.transport.sent)
    assert offers >= 1
    rig.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    rig.tick_silently()
    assert {data[0] for _, data in rig.transport.sent} == {0xFD}


@pytest.mark.parametrize(
    ("times_s", "frame", "is_mavlink1_only"),
    [
        ((0.0, 3.0, 6.0, 9.0, 9.9), Frame(HEARTBEAT, b"\xfe"), False),
        ((0.0, 3.0, 6.0, 9.0, 10.0), Frame(HEARTBEAT, b"\xfe"), True),
        ((0.0, 3.0, 6.0, 30.0), Frame(HEARTBEAT, b"\xfe"), False),
        ((0.0, 3.0, 6.0, 9.0, 10.0), Frame(RADIO_STATUS, b"\xfe"), False),
        ((0.0, 3.0, 6.0, 9.0, 10.0), Frame(HEARTBEAT, b"\xfd"), False),
    ],
    ids=["too early", "five frames in 10 s", "four frames", "of the modem", "in MAVLink 2"],
)
def test_peer_uses_only_mavlink1_after_five_frames_in_ten_seconds(times_s, frame, is_mavlink1_only):
    detector = VersionDetector()
    for t_s in times_s:
        detector.update([frame], 100.0 + t_s)
    assert detector.is_mavlink1_only is is_mavlink1_only
    detector.update([Frame(HEARTBEAT, b"\xfe")], 100.0 + times_s[-1])
    assert detector.is_mavlink1_only is (is_mavlink1_only or len(times_s) == 4)
    detector.update([Frame(HEARTBEAT, b"\xfd")] + [Frame(HEARTBEAT, b"\xfe")] * 4, 200.0)
    detector.update([], 300.0)
    assert not detector.is_mavlink1_only


def test_radio_status_of_the_modem_does_not_select_mavlink1(make_rig):
    rig = make_rig(byte_rate=5760.0, has_radio_rates=True, is_datagram=False)
    station = Mavlink1Station(rig)
    for _ in range(30):
        station.send(mavlink1.MAVLink_radio_status_message(150, 150, 100, 40, 40, 0, 0))
        rig.tick_silently(seconds=1.0)
    assert {data[0] for _, data in rig.transport.sent} == {0xFD}


def test_parameter_disables_mavlink1(rig, station):
    rig.request_handler.values = rig.request_handler.values.replaced("LNK_MAVLINK1", 0.0)
    rig.tick()
    assert station.run(20) == []


def test_messages_that_mavlink1_lacks_are_not_converted(sent_numbers):
    numbers = [number for number in sent_numbers if number > 255]
    assert numbers
    for number in numbers:
        assert to_mavlink1(Codec(1, 1).pack_payload(number, b"x")) is None, number
