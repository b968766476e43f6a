"""The satellite gateway: messages of the boat and commands to it."""

import pytest
from pymavlink.dialects.v20 import common as mavlink

from hil.shore.gateway import REPEAT_S, Gateway, parse
from support.satellite import KEY, SatelliteBoat, set_mode

IMEI = "300234010753370"
UTC_S = 1_793_491_200.0
PING = mavlink.MAVLink_ping_message(1, 2, 3, 4)


class Bench:
    """A gateway, the messages to its station and those to the boat."""

    def __init__(self, **options):
        self.received, self.messages, self.log = [], [], []
        self.gateway = Gateway(
            self, lambda imei, message: self.messages.append((imei, message)), self.log.append, **options
        )

    def send(self, message, system, component):
        self.received.append((message, system, component))

    def command(self, message, now_s=0.0, utc_s=UTC_S):
        """Receive a message of the station over its link."""
        (message,) = parse(message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190)))
        self.gateway.receive_command(message, now_s, utc_s)

    def results(self):
        return [message.result for message, _, _ in self.received if message.get_type() == "COMMAND_ACK"]

    def texts(self):
        return [message.text for message, _, _ in self.received if message.get_type() == "STATUSTEXT"]


@pytest.fixture
def bench():
    return Bench(key=KEY, imei=IMEI)


def test_messages_of_the_boat_reach_the_station():
    boat, bench = SatelliteBoat(), Bench()
    boat.run(60)
    ((_, _, content),) = boat.network.delivered
    assert bench.gateway.receive_message(boat.modem.imei, content + b"noise") == 1
    ((message, system, component),) = bench.received
    assert (message.get_type(), message.custom_mode, system, component) == ("HIGH_LATENCY2", 15, 1, 1)
    assert bench.gateway.imei == boat.modem.imei
    bench.gateway.send_last_report()
    assert len(bench.received) == 2


def test_repeated_command_is_executed_once_and_acknowledged():
    boat, bench = SatelliteBoat(key=KEY), Bench(key=KEY, imei=IMEI)
    for second in range(4):  # a station repeats it
        bench.command(set_mode(4), now_s=second, utc_s=boat.start_utc_s)
    ((imei, message),) = bench.messages
    assert (imei, len(message)) == (IMEI, 50)
    assert bench.results() == [5, 5, 5, 5]  # in progress
    boat.network.send(message)
    boat.run(120)
    assert [intent.mode for intent in boat.intents] == [4]
    for _, _, content in boat.network.delivered:
        bench.gateway.receive_message(IMEI, content)
    assert bench.results()[-1] == 0
    bench.command(set_mode(4), now_s=9.0)
    assert len(bench.messages) == 2  # a new command after the acknowledgement


def test_numbers_increase_if_the_clock_is_set_back(bench):
    for count in range(3):
        bench.command(set_mode(4 + count), utc_s=UTC_S - 100.0 * count)
    numbers = [int.from_bytes(message[1:6], "little") for _, message in bench.messages]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == 3


def test_command_repeated_later_is_sent_again(bench):
    bench.command(set_mode(4), now_s=0.0)
    bench.command(set_mode(4), now_s=REPEAT_S + 1.0)
    assert len(bench.messages) == 2


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
def test_unsupported_message_is_reported_at_most_once(bench, message):
    bench.command(message)
    bench.command(message)
    assert bench.messages == []
    assert len(bench.texts()) <= 1


def test_command_for_an_unknown_modem_is_rejected():
    bench = Bench(key=KEY)
    bench.command(set_mode(4))
    assert bench.results() == [1]  # temporarily rejected
    assert bench.texts() == ["Not sent: modem unknown; give --imei"]


def test_message_of_another_modem_is_dropped(bench):
    assert bench.gateway.receive_message("300234010753371", b"x") == 0
    assert "dropped" in bench.log[0]


def test_commands_without_a_key_are_plain_frames():
    bench = Bench(imei=IMEI)
    bench.command(set_mode(4))
    ((_, message),) = bench.messages
    (frame,) = parse(message)
    assert (frame.get_type(), frame.get_srcSystem()) == ("COMMAND_LONG", 255)


def frame(message, system=1):
    return message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=1))


def unknown_frame():
    data = bytearray(frame(PING))
    data[7:10] = (12_345).to_bytes(3, "little")
    return bytes(data)


def test_frame_of_an_unknown_kind_is_dropped_and_counted(bench):
    assert bench.gateway.receive_message(IMEI, frame(PING) + unknown_frame() + frame(PING)) == 2
    assert [message.get_type() for message, _, _ in bench.received] == ["PING", "PING"]
    assert bench.gateway.dropped == {"frame of unknown kind": 1}
    bench.gateway.receive_message(IMEI, unknown_frame())
    assert bench.log[-2:] == [
        "frame of unknown kind 12345: dropped (2 so far)",
        f"message of {len(unknown_frame())} bytes: nothing",
    ]
    (message,) = parse(unknown_frame())
    bench.gateway.receive_command(message, 0.0, UTC_S)
    assert (bench.messages, bench.texts()) == ([], [])


@pytest.mark.parametrize("boat", [1, 7])
def test_frames_of_another_system_do_not_block_commands(bench, boat):
    bench.gateway.receive_message(IMEI, frame(PING, boat))
    bench.gateway.receive_message(IMEI, frame(PING, 9) + frame(PING, boat))
    assert [system for _, system, _ in bench.received] == [boat, boat]
    assert "frame of another system 9; the boat is system" in bench.log[-2]
    bench.command(set_mode(4, target=boat))
    bench.command(set_mode(4, target=9))
    assert len(bench.messages) == 1


def test_acknowledgement_of_another_system_is_ignored(bench):
    bench.gateway.receive_message(IMEI, frame(PING))
    bench.command(set_mode(4))
    bench.gateway.receive_message(IMEI, frame(mavlink.MAVLink_command_ack_message(176, 0), 9))
    bench.command(set_mode(4))
    assert len(bench.messages) == 1


def test_message_without_a_frame_does_not_set_the_modem():
    bench = Bench()
    bench.gateway.receive_message("300234010753371", b"junk")
    bench.gateway.receive_message(IMEI, frame(PING))
    assert bench.gateway.imei == IMEI
    bench.gateway.receive_message("300234010753371", frame(PING))
    assert bench.gateway.dropped == {"message of another modem": 1}
