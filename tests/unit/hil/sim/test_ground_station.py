"""The ground station with a vehicle that uses pymavlink."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from hil.sim.goals import parse_goals
from hil.sim.ground_station import READY_TIMEOUT_S, STATUS_REQUEST_S, TIMEOUT_S, GroundStation, disarm
from hil.sim.mavlink_tap import MavlinkTap

ACCEPTED, TEMPORARILY, DENIED = 0, 1, 2
REQUEST_MESSAGE = 512


class Vehicle:
    """Acknowledges commands with the results of `result_of`; it is ready after some requests for SYS_STATUS."""

    def __init__(self, result_of=lambda _message: ACCEPTED, ready_after=0):
        self.requests_left = ready_after
        self.received = []
        self.result_of = result_of
        self.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        self.parser = mavlink.MAVLink(None)

    def heartbeat(self, component=1, autopilot=3):
        self.mav.srcComponent = component
        frame = self.pack(mavlink.MAVLink_heartbeat_message(11, autopilot, 128, 15, 4, 3))
        self.mav.srcComponent = 1
        return frame

    def pack(self, *messages):
        return b"".join(bytes(message.pack(self.mav)) for message in messages)

    def receive(self, data):
        replies = b""
        for message in self.parser.parse_buffer(data) or []:
            self.received.append(message)
            if message.get_type() == "COMMAND_LONG" and message.command == REQUEST_MESSAGE:
                replies += self.status()
            elif message.get_type() == "COMMAND_LONG":
                result = self.result_of(message)
                if result is not None:
                    replies += self.pack(mavlink.MAVLink_command_ack_message(message.command, result))
        return replies

    def status(self):
        health = mavlink.MAV_SYS_STATUS_PREARM_CHECK if self.requests_left <= 0 else 0
        self.requests_left -= 1
        return self.pack(mavlink.MAVLink_sys_status_message(*[health] * 3, *[0] * 10))

    def commands(self):
        commands = [message for message in self.received if message.get_type() == "COMMAND_LONG"]
        return [message for message in commands if message.command != REQUEST_MESSAGE]


def play(station: GroundStation, vehicle: Vehicle, end_s: float, *, start_s: float = 1.0, frames=b"") -> None:
    """Connect the station to the vehicle, whose first bytes are `frames` or a heartbeat."""
    station.receive(start_s, frames or vehicle.heartbeat())
    while (now_s := station.next_output_s()) <= end_s:
        if replies := vehicle.receive(station.take_output(now_s)):
            station.receive(now_s + 0.005, replies)


def test_station_is_silent_until_the_first_heartbeat():
    station = GroundStation(parse_goals("0:10"))
    assert station.next_output_s() == math.inf
    station.receive(0.5, Vehicle().heartbeat(component=158, autopilot=8))  # a gimbal
    assert station.next_output_s() == math.inf
    assert station.final_failure() is not None
    assert station.failure(TIMEOUT_S + 1.0) is not None


def test_orders_are_sent_at_their_times():
    station, vehicle = GroundStation(parse_goals("0:0,20:60,40:-90")), Vehicle()
    play(station, vehicle, 50.0)
    commands = vehicle.commands()
    assert [message.command for message in commands] == [400, 176, 43002, 43002, 43002]
    assert (commands[0].param1, commands[1].param1, commands[1].param2) == (1.0, 1.0, 15.0)
    assert [(message.param1, message.param2) for message in commands[2:]] == [(1.0, 0.0), (1.0, 60.0), (1.0, 270.0)]
    assert all((message.target_system, message.target_component) == (7, 1) for message in commands)
    times = [order.accepted_s for order in station.orders]
    assert times[2] < 1.5
    assert times[3] == pytest.approx(20.0, abs=0.1)
    assert times[4] == pytest.approx(40.0, abs=0.1)
    assert station.final_failure() is None
    assert station.failure(1000.0) is None


def test_arming_waits_until_the_boat_is_ready():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle(ready_after=7)
    play(station, vehicle, 20.0)
    assert [message.command for message in vehicle.commands()] == [400, 176, 43002]
    assert station.orders[0].first_sent_s == pytest.approx(1.0 + 7 * STATUS_REQUEST_S, abs=0.1)


def test_arming_after_the_timeout_reports_the_refusal():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle(lambda _message: TEMPORARILY, ready_after=10_000)
    play(station, vehicle, 100.0)
    assert station.orders[0].first_sent_s == pytest.approx(1.0 + READY_TIMEOUT_S, abs=0.1)
    assert "TEMPORARILY_REJECTED" in station.failure(100.0)


def test_heartbeats_are_sent_once_a_second():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    play(station, vehicle, 11.5)
    heartbeats = [message for message in vehicle.received if message.get_type() == "HEARTBEAT"]
    assert len(heartbeats) == 11
    assert heartbeats[0].get_srcSystem() == 255
    assert len({message.get_seq() for message in vehicle.received}) == len(vehicle.received)


@pytest.mark.parametrize(
    ("results", "confirmations"), [((TEMPORARILY, DENIED, TEMPORARILY), [0, 0, 0, 0]), ((None, None), [0, 1, 2])]
)
def test_order_is_repeated_as_a_new_command_if_it_was_refused(results, confirmations):
    """Without an acknowledgement the confirmation increases."""
    results = iter(results)
    station = GroundStation(parse_goals("0:0"))
    vehicle = Vehicle(lambda message: next(results, ACCEPTED) if message.command == 400 else ACCEPTED)
    play(station, vehicle, 10.0)
    arming = [message for message in vehicle.commands() if message.command == 400]
    assert [message.confirmation for message in arming] == confirmations
    assert station.orders[0].accepted_s == pytest.approx(1.0 + 0.5 * (len(confirmations) - 1), abs=0.1)
    assert station.final_failure() is None


def test_goal_that_is_never_accepted_fails_the_run():
    station = GroundStation(parse_goals("0:0,300:20"))
    vehicle = Vehicle(lambda message: DENIED if message.command == 43002 else ACCEPTED)
    play(station, vehicle, 100.0)
    assert "DENIED" in station.failure(100.0)
    assert "goal 0 deg at 0 s" in station.final_failure()


def test_overdue_goal_is_skipped():
    station = GroundStation(parse_goals("0:10,5:20"))
    vehicle = Vehicle(lambda message: TEMPORARILY if message.param2 == 10.0 else ACCEPTED)
    play(station, vehicle, 10.0)
    assert station.orders[-1].accepted_s == pytest.approx(5.3, abs=0.5)
    assert "goal 10 deg" in station.final_failure()


def test_invalid_bytes_are_ignored():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    noise = bytes(range(256)) * 8 + b"\xfd" * 40
    station.receive(0.5, noise)
    for k in range(400):
        station.receive(0.6, vehicle.heartbeat() + noise[: k % 50])
    assert station.next_output_s() < math.inf


def test_texts_mode_and_named_values_are_stored():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    assert station.mode() == "no heartbeat yet"
    text = mavlink.MAVLink_statustext_message(4, b"No heading")
    named_values = [mavlink.MAVLink_named_value_float_message(0, *v) for v in ((b"RUDDER", -12.5), (b"RUD_CMD", 3.0))]
    station.receive(1.0, vehicle.pack(text, *named_values) + vehicle.heartbeat())
    assert list(station.texts) == [(1.0, 4, "No heading")]
    assert station.named_value("RUDDER") == -12.5
    assert station.named_value("RUD_CMD") == 3.0
    assert station.named_value("SKIPPED") is None
    assert station.mode() == "GUIDED, armed"


def test_tap_decodes_a_signed_stream_in_pieces_and_skips_a_bad_checksum():
    vehicle = Vehicle()
    vehicle.mav.signing.secret_key, vehicle.mav.signing.sign_outgoing = bytes(32), True
    stream = bytearray(vehicle.heartbeat() * 3)
    tap = MavlinkTap([0])
    messages = [message for byte in stream for message in tap.feed(bytes([byte]))]
    assert [message.custom_mode for message in messages] == [15, 15, 15]
    stream[12] ^= 1
    assert len(list(MavlinkTap([0]).feed(bytes(stream)))) == 2


def test_chunks_of_a_text_are_joined():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    for number, chunk in enumerate((b"x" * 50, b"tail")):
        station.receive(1.0, vehicle.pack(mavlink.MAVLink_statustext_message(4, chunk, 9, number)))
    station.receive(2.0, vehicle.pack(mavlink.MAVLink_statustext_message(6, b"next")))
    assert [text for _, _, text in station.texts] == ["x" * 50 + "tail", "next"]


@pytest.mark.parametrize("shared", [True, False])
def test_goals_are_skipped_after_another_station_has_set_a_mode(shared):
    """Only if other stations can steer; otherwise a refused goal fails the run."""
    in_hold = []
    vehicle = Vehicle(lambda message: DENIED if in_hold and message.command == 43002 else ACCEPTED)
    station = GroundStation(parse_goals("0:10,60:20,120:30,180:40"), shared=shared)
    play(station, vehicle, 50.0)
    in_hold.append(True)
    hold = vehicle.pack(mavlink.MAVLink_heartbeat_message(11, 3, 128, 4, 4, 3))
    play(station, vehicle, 150.0, start_s=55.0, frames=hold)
    if not shared:
        assert "DENIED" in station.final_failure()
        assert station.skip_text == ""
        return
    assert station.failure(150.0) is None
    assert station.final_failure() is None
    assert station.skip_text == "goal 20 deg at 60 s skipped: another station has set mode HOLD, armed"
    assert [order.is_skipped for order in station.orders if order.goal] == [False, True, True, False]
    in_hold.clear()
    play(station, vehicle, 200.0, start_s=155.0)  # GUIDED again
    assert station.orders[-1].accepted_s == pytest.approx(180.0, abs=0.1)


def test_order_waits_for_the_heartbeat_of_the_autopilot():
    station = GroundStation((), sends_first=True)
    station.order(disarm(5.0), 5.0)
    assert station.take_output(6.0)  # a heartbeat
    assert station.orders == ()
    vehicle = Vehicle()
    play(station, vehicle, 30.0, start_s=7.0)
    assert [command.command for command in vehicle.commands()] == [mavlink.MAV_CMD_COMPONENT_ARM_DISARM]


def test_reached_items_are_recorded_with_their_times():
    station, vehicle = GroundStation(()), Vehicle()
    for t_s, items in ((1.0, (1, 2)), (7.5, (3,))):
        station.receive(t_s, vehicle.pack(*map(mavlink.MAVLink_mission_item_reached_message, items)))
    assert list(station.reached) == [(1.0, 1), (1.0, 2), (7.5, 3)]
