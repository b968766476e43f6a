"""The satellite gateway: messages and commands, one by one."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from hil.shore.gateway import REPEAT_S, Gateway, parse
from support.satellite import KEY, SatelliteBoat, set_mode

IMEI = "300234010753370"
UTC_S = 1_793_491_200.0


class Desk:
    """A gateway, the messages to its station and those to the boat."""

    def __init__(self, **more):
        self.received, self.messages, self.log = [], [], []
        self.gateway = Gateway(
            self, lambda imei, message: self.messages.append((imei, message)), self.log.append, **more
        )

    def send(self, message, system, component):
        self.received.append((message, system, component))

    def order(self, message, now_s=0.0, utc_s=UTC_S):
        """Receive a message of the station over its link."""
        (message,) = parse(message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190)))
        self.gateway.receive_order(message, now_s, utc_s)

    def results(self):
        return [message.result for message, _, _ in self.received if message.get_type() == "COMMAND_ACK"]

    def texts(self):
        return [message.text for message, _, _ in self.received if message.get_type() == "STATUSTEXT"]


@pytest.fixture
def desk():
    return Desk(key=KEY, imei=IMEI)


def test_messages_of_the_boat_reach_the_station():
    boat, desk = SatelliteBoat(), Desk()
    boat.run(60)
    ((_, _, content),) = boat.network.delivered
    assert desk.gateway.receive_message(boat.modem.imei, content + b"noise") == 1
    ((message, system, component),) = desk.received
    assert (message.get_type(), message.custom_mode, system, component) == ("HIGH_LATENCY2", 15, 1, 1)
    assert desk.gateway.imei == boat.modem.imei
    desk.gateway.greet()
    assert len(desk.received) == 2


def test_a_repeated_command_is_executed_once_and_acknowledged():
    boat, desk = SatelliteBoat(key=KEY), Desk(key=KEY, imei=IMEI)
    for second in range(4):  # as stations do
        desk.order(set_mode(4), now_s=second, utc_s=boat.start_utc_s)
    ((imei, message),) = desk.messages
    assert (imei, len(message)) == (IMEI, 50)
    assert desk.results() == [5, 5, 5, 5]  # in progress
    boat.network.send(message)
    boat.run(120)
    assert [intent.mode for intent in boat.intents] == [4]
    for _, _, content in boat.network.delivered:
        desk.gateway.receive_message(IMEI, content)
    assert desk.results()[-1] == 0
    desk.order(set_mode(4), now_s=9.0)
    assert len(desk.messages) == 2  # a new command after the acknowledgement


def test_numbers_increase_when_the_clock_goes_back(desk):
    for count in range(3):
        desk.order(set_mode(4 + count), utc_s=UTC_S - 100.0 * count)
    numbers = [int.from_bytes(message[1:6], "little") for _, message in desk.messages]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == 3


def test_a_command_repeated_later_is_sent_again(desk):
    desk.order(set_mode(4), now_s=0.0)
    desk.order(set_mode(4), now_s=REPEAT_S + 1.0)
    assert len(desk.messages) == 2


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
        mavlink.MAVLink_param_request_list_message(1, 1),
        mavlink.MAVLink_mission_request_list_message(1, 1),
        mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0),
        set_mode(4, target=2),
    ],
)
def test_messages_that_are_not_sent_by_satellite(desk, message):
    desk.order(message)
    desk.order(message)
    assert desk.messages == []
    assert len(desk.texts()) <= 1


def test_unknown_modem():
    desk = Desk(key=KEY)
    desk.order(set_mode(4))
    assert desk.results() == [1]  # temporarily rejected
    assert desk.texts() == ["Not sent: modem unknown; give --imei"]


def test_message_of_another_modem(desk):
    assert desk.gateway.receive_message("300234010753371", b"x") == 0
    assert "dropped" in desk.log[0]


def test_commands_without_a_key_are_plain_frames():
    desk = Desk(imei=IMEI)
    desk.order(set_mode(4))
    ((_, message),) = desk.messages
    (frame,) = parse(message)
    assert (frame.get_type(), frame.get_srcSystem()) == ("COMMAND_LONG", 255)


def frame(message, system=1):
    return message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1))


def unknown():
    """Return a frame of an unknown message kind."""
    data = bytearray(frame(mavlink.MAVLink_ping_message(1, 2, 3, 4)))
    data[7:10] = (12_345).to_bytes(3, "little")
    return bytes(data)


PING = mavlink.MAVLink_ping_message(1, 2, 3, 4)


def test_a_frame_of_an_unknown_kind_is_dropped_and_counted(desk):
    assert desk.gateway.receive_message(IMEI, frame(PING) + unknown() + frame(PING)) == 2
    assert [message.get_type() for message, _, _ in desk.received] == ["PING", "PING"]
    assert desk.gateway.dropped == {"frame of unknown kind": 1}
    desk.gateway.receive_message(IMEI, unknown())
    assert desk.log[-2:] == [
        "frame of unknown kind 12345: dropped (2 so far)",
        f"message of {len(unknown())} bytes: nothing",
    ]
    (message,) = parse(unknown())
    desk.gateway.receive_order(message, 0.0, UTC_S)
    assert (desk.messages, desk.texts()) == ([], [])


@pytest.mark.parametrize("boat", [1, 7])
def test_frames_of_another_system_do_not_block_commands(desk, boat):
    desk.gateway.receive_message(IMEI, frame(PING, boat))
    desk.gateway.receive_message(IMEI, frame(PING, 9) + frame(PING, boat))
    assert [system for _, system, _ in desk.received] == [boat, boat]
    assert "frame of another system 9; the boat is system" in desk.log[-2]
    desk.order(set_mode(4, target=boat))
    desk.order(set_mode(4, target=9))
    assert len(desk.messages) == 1


def test_an_acknowledgement_of_another_system_is_ignored(desk):
    desk.gateway.receive_message(IMEI, frame(PING))
    desk.order(set_mode(4))
    desk.gateway.receive_message(IMEI, frame(mavlink.MAVLink_command_ack_message(176, 0), 9))
    desk.order(set_mode(4))
    assert len(desk.messages) == 1


def test_a_message_without_a_frame_does_not_set_the_modem():
    desk = Desk()
    desk.gateway.receive_message("300234010753371", b"junk")
    desk.gateway.receive_message(IMEI, frame(PING))
    assert desk.gateway.imei == IMEI
    desk.gateway.receive_message("300234010753371", frame(PING))
    assert desk.gateway.dropped == {"message of another modem": 1}
