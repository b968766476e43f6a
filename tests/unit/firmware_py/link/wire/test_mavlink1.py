"""A station that speaks MAVLink 1 only is answered in it; one that knows more, never."""

import pytest
from pymavlink.dialects.v10 import common as mavlink1
from pymavlink.dialects.v20 import common as mavlink

from firmware_py.cli.link_page import list_replies
from firmware_py.link.telemetry.table import TABLE
from firmware_py.link.wire.frames import Codec, stamp, to_mavlink1
from support.link import of_type

BEAT = mavlink1.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
READ = mavlink1.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1)
HOME = mavlink1.MAVLink_command_long_message(1, 1, 410, 0, 0, 0, 0, 0, 0, 0, 0)
NUMBERS = {kind.msgname: number for number, kind in mavlink.mavlink_map.items()}


@pytest.fixture(scope="module")
def sent_numbers():
    """Numbers of all messages that the boat sends; a fixture, since the sources of the link are parsed for them."""
    return sorted({row.number for row in TABLE} | {NUMBERS[name] for name in list_replies()})


class OldStation:
    """Packs and understands MAVLink 1 alone."""

    def __init__(self, rig):
        self.rig = rig
        self.rig.endpoint.service(0.0, [])
        self.protocol = mavlink1.MAVLink(None, srcSystem=255, srcComponent=190)
        self.protocol.robust_parsing = True

    def tell(self, *messages):
        self.rig.transport.inbox.append(("station", b"".join(message.pack(self.protocol) for message in messages)))
        self.rig.endpoint.service(self.rig.now_s, [self.rig.transport.descriptor])
        while self.rig.endpoint.busy:
            self.rig.endpoint.service(self.rig.now_s, [])
        return self.understood()

    def understood(self):
        sent, self.rig.transport.sent = self.rig.transport.sent, []
        messages = self.protocol.parse_buffer(b"".join(data for _, data in sent)) or []
        return [message for message in messages if message.get_msgbuf()[0] == 0xFE]  # it knows the other, too

    def seconds(self, count):
        replies = []
        for _ in range(count):
            replies += self.tell(BEAT)
            for _ in range(10):
                self.rig.tick_silently()
            replies += self.understood()
        return replies


@pytest.fixture
def old(rig):
    return OldStation(rig)


def test_it_is_answered_in_what_it_understands(old):
    reports = "".join(message.text for message in of_type(old.seconds(15), "STATUSTEXT"))
    assert reports.count("MAVLink 1 in use: fence, rally and signing need MAVLink 2") == 1
    replies = old.seconds(5)
    assert len(of_type(replies, "HEARTBEAT")) == 5
    assert len(of_type(replies, "ATTITUDE")) > 5
    (value,) = of_type(old.tell(READ), "PARAM_VALUE")
    assert value.param_id == "CTL_K1"
    (ack,) = of_type(old.tell(HOME), "COMMAND_ACK")
    assert ack.command == 410


def test_a_mission_comes_down_and_goes_up(old):
    old.seconds(15)
    count = mavlink1.MAVLink_mission_count_message(1, 1, 2)
    item = mavlink1.MAVLink_mission_item_int_message
    (request,) = [each for each in old.tell(count) if "REQUEST" in each.get_type()]
    assert request.seq == 0
    for sequence in range(2):
        place = (360_000_000 + sequence, 1_210_000_000, 0.0)
        replies = old.tell(item(1, 1, sequence, 6, 16, 0, 1, 0, 0, 0, 0, *place))
    (ack,) = of_type(replies, "MISSION_ACK")
    assert ack.type == 0
    (count,) = of_type(old.tell(mavlink1.MAVLink_mission_request_list_message(1, 1)), "MISSION_COUNT")
    assert count.count == 2
    (item,) = of_type(old.tell(mavlink1.MAVLink_mission_request_int_message(1, 1, 1)), "MISSION_ITEM_INT")
    assert item.x == 360_000_001


def test_who_begins_in_it_until_it_has_heard_it_is_answered_in_mavlink_2(rig, old):
    old.seconds(5)
    for _ in range(30):
        rig.tell(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        rig.tick(seconds=1.0)
    rig.tell(mavlink.MAVLink_param_request_read_message(1, 1, b"CTL_K1", -1))
    assert old.seconds(5) == []


def test_one_frame_in_mavlink_2_is_enough_and_it_offers_it_now_and_then(rig, old):
    old.seconds(15)
    offered = []
    for _ in range(20):
        old.seconds(1)  # takes what was sent
        for _ in range(10):
            rig.tick_silently()
        data = b"".join(data for _, data in rig.transport.sent)
        offered.append(data.count(b"\xfd\x09\x00\x00"))
    assert sum(offered) >= 1
    rig.tell(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    rig.tick_silently()
    assert {data[0] for _, data in rig.transport.sent} == {0xFD}


def test_radio_status_of_a_modem_says_nothing_of_who_is_behind_it(make_rig):
    rig = make_rig(byte_rate=5760.0, radio=True, datagrams=False)
    old = OldStation(rig)
    status = mavlink1.MAVLink_radio_status_message(150, 150, 100, 40, 40, 0, 0)
    for _ in range(30):
        old.tell(status)
        rig.tick_silently(seconds=1.0)
    assert {data[0] for _, data in rig.transport.sent} == {0xFD}


def test_shut_out_by_a_parameter_it_is_answered_nothing(rig, old):
    rig.request_handler.values = rig.request_handler.values.replaced("LNK_MAVLINK1", 0.0)
    rig.tick()
    assert old.seconds(20) == []


def test_each_message_of_the_boat_has_the_length_that_mavlink_1_gives_it(sent_numbers):
    known = [number for number in sent_numbers if number in mavlink1.mavlink_map]
    assert len(known) > 30
    for number in known:
        size = mavlink1.mavlink_map[number].unpacker.size
        frame = stamp(to_mavlink1(Codec(1, 1).pack_payload(number, bytes(range(1, 256))[:size])), 7)
        decoded = mavlink1.MAVLink(None).decode(bytearray(frame))
        assert (decoded.get_msgId(), decoded.get_seq(), decoded.get_srcSystem()) == (number, 7, 1)


def test_a_message_without_a_number_in_mavlink_1_is_left_out(sent_numbers):
    later = [number for number in sent_numbers if number > 255]
    assert later
    for number in later:
        assert to_mavlink1(Codec(1, 1).pack_payload(number, b"x")) is None, number
