"""The ground station against a vehicle made with pymavlink."""

import math

import pytest
from pymavlink.dialects.v20 import common as mavlink

from hil.sim.goals import parse_goals
from hil.sim.ground_station import PATIENCE_S, READY_PATIENCE_S, READY_S, GroundStation, disarm
from hil.sim.mavlink_tap import MavlinkTap

ACCEPTED, TEMPORARILY, DENIED = 0, 1, 2
REQUEST_MESSAGE = 512


class Vehicle:
    """Acknowledges commands with the results of `judge`; it is ready after some requests for SYS_STATUS."""

    def __init__(self, judge=lambda _message: ACCEPTED, ready_after=0):
        self.requests_left = ready_after
        self.received = []
        self.judge = judge
        self.mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        self.parser = mavlink.MAVLink(None)

    def heartbeat(self, component=1, autopilot=3):
        self.mav.srcComponent = component
        frame = mavlink.MAVLink_heartbeat_message(11, autopilot, 128, 15, 4, 3).pack(self.mav)
        self.mav.srcComponent = 1
        return bytes(frame)

    def receive(self, data):
        answers = b""
        for message in self.parser.parse_buffer(data) or []:
            self.received.append(message)
            if message.get_type() == "COMMAND_LONG" and message.command == REQUEST_MESSAGE:
                answers += self.status()
            elif message.get_type() == "COMMAND_LONG":
                result = self.judge(message)
                if result is not None:
                    answers += bytes(mavlink.MAVLink_command_ack_message(message.command, result).pack(self.mav))
        return answers

    def status(self):
        health = mavlink.MAV_SYS_STATUS_PREARM_CHECK if self.requests_left <= 0 else 0
        self.requests_left -= 1
        return bytes(
            mavlink.MAVLink_sys_status_message(health, health, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0).pack(self.mav)
        )

    def commands(self):
        commands = [message for message in self.received if message.get_type() == "COMMAND_LONG"]
        return [message for message in commands if message.command != REQUEST_MESSAGE]


def play(station: GroundStation, vehicle: Vehicle, end_s: float, *, start_s: float = 1.0) -> None:
    station.receive(start_s, vehicle.heartbeat())
    while (now_s := station.next_output_s()) <= end_s:
        if answers := vehicle.receive(station.take_output(now_s)):
            station.receive(now_s + 0.005, answers)


def test_silent_until_the_first_heartbeat():
    station = GroundStation(parse_goals("0:10"))
    assert station.next_output_s() == math.inf
    station.receive(0.5, Vehicle().heartbeat(component=158, autopilot=8))  # a gimbal
    assert station.next_output_s() == math.inf
    assert station.verdict() is not None
    assert station.failure(PATIENCE_S + 1.0) is not None


def test_orders_and_their_times():
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
    assert station.verdict() is None
    assert station.failure(1000.0) is None


def test_arming_waits_until_the_boat_is_ready():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle(ready_after=7)
    play(station, vehicle, 20.0)
    assert [message.command for message in vehicle.commands()] == [400, 176, 43002]
    assert station.orders[0].first_sent_s == pytest.approx(1.0 + 7 * READY_S, abs=0.1)


def test_arming_after_the_timeout_reports_the_refusal():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle(lambda _message: TEMPORARILY, ready_after=10_000)
    play(station, vehicle, 100.0)
    assert station.orders[0].first_sent_s == pytest.approx(1.0 + READY_PATIENCE_S, abs=0.1)
    assert "TEMPORARILY_REJECTED" in station.failure(100.0)


def test_heartbeats_once_a_second():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    play(station, vehicle, 11.5)
    beats = [message for message in vehicle.received if message.get_type() == "HEARTBEAT"]
    assert len(beats) == 11
    assert beats[0].get_srcSystem() == 255
    assert len({message.get_seq() for message in vehicle.received}) == len(vehicle.received)


def test_a_refused_order_is_repeated_as_a_new_command():
    refusals = iter([TEMPORARILY, DENIED, TEMPORARILY])
    station = GroundStation(parse_goals("0:0"))
    vehicle = Vehicle(lambda message: next(refusals, ACCEPTED) if message.command == 400 else ACCEPTED)
    play(station, vehicle, 10.0)
    arming = [message for message in vehicle.commands() if message.command == 400]
    assert [message.confirmation for message in arming] == [0, 0, 0, 0]
    assert station.orders[0].accepted_s == pytest.approx(2.5, abs=0.1)
    assert station.verdict() is None


def test_an_unacknowledged_command_is_repeated_with_a_higher_confirmation():
    silent = iter([None, None])
    station = GroundStation(parse_goals("0:0"))
    vehicle = Vehicle(lambda _message: next(silent, ACCEPTED))
    play(station, vehicle, 5.0)
    assert [message.confirmation for message in vehicle.commands()[:3]] == [0, 1, 2]


def test_a_goal_that_is_never_accepted_fails_the_run():
    station = GroundStation(parse_goals("0:0,300:20"))
    vehicle = Vehicle(lambda message: DENIED if message.command == 43002 else ACCEPTED)
    play(station, vehicle, 100.0)
    assert "DENIED" in station.failure(100.0)
    assert "goal 0 deg at 0 s" in station.verdict()


def test_an_overdue_goal_is_skipped():
    station = GroundStation(parse_goals("0:10,5:20"))
    vehicle = Vehicle(lambda message: TEMPORARILY if message.param2 == 10.0 else ACCEPTED)
    play(station, vehicle, 10.0)
    assert station.orders[-1].accepted_s == pytest.approx(5.3, abs=0.5)
    assert "goal 10 deg" in station.verdict()


def test_invalid_bytes_are_ignored():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    noise = bytes(range(256)) * 8 + b"\xfd" * 40
    station.receive(0.5, noise)
    for k in range(400):
        station.receive(0.6, vehicle.heartbeat() + noise[: k % 50])
    assert station.next_output_s() < math.inf


def test_texts_and_named_values_for_the_display():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    assert station.mode() == "no heartbeat yet"
    text = mavlink.MAVLink_statustext_message(4, b"No heading").pack(vehicle.mav)
    named = mavlink.MAVLink_named_value_float_message(0, b"RUDDER", -12.5).pack(vehicle.mav)
    other = mavlink.MAVLink_named_value_float_message(0, b"RUD_CMD", 3.0).pack(vehicle.mav)
    station.receive(1.0, bytes(text) + bytes(named) + bytes(other) + vehicle.heartbeat())
    assert list(station.texts) == [(1.0, 4, "No heading")]
    assert station.named_value("RUDDER") == -12.5
    assert station.named_value("RUD_CMD") == 3.0
    assert station.named_value("SKIPPED") is None
    assert station.mode() == "GUIDED, armed"


def test_the_tap_accepts_a_stream_in_any_pieces():
    vehicle = Vehicle()
    stream = vehicle.heartbeat() * 3
    tap = MavlinkTap([0])
    found = [message for k in range(len(stream)) for message in tap.feed(stream[k : k + 1])]
    assert [message.custom_mode for message in found] == [15, 15, 15]


def test_the_tap_rejects_a_bad_checksum():
    frame = bytearray(Vehicle().heartbeat())
    frame[12] ^= 1
    assert list(MavlinkTap([0]).feed(bytes(frame))) == []


def test_a_text_cut_into_pieces_is_joined():
    station, vehicle = GroundStation(parse_goals("0:0")), Vehicle()
    for number, piece in enumerate((b"x" * 50, b"tail")):
        station.receive(1.0, bytes(mavlink.MAVLink_statustext_message(4, piece, 9, number).pack(vehicle.mav)))
    station.receive(2.0, bytes(mavlink.MAVLink_statustext_message(6, b"next").pack(vehicle.mav)))
    assert [text for _, _, text in station.texts] == ["x" * 50 + "tail", "next"]


@pytest.mark.parametrize("shared", [True, False])
def test_goals_are_skipped_after_another_station_has_set_a_mode(shared):
    """Only where other stations can steer; otherwise a refused goal fails the run."""
    in_hold = []
    vehicle = Vehicle(lambda message: DENIED if in_hold and message.command == 43002 else ACCEPTED)
    station = GroundStation(parse_goals("0:10,60:20,120:30,180:40"), shared=shared)
    play(station, vehicle, 50.0)
    in_hold.append(True)
    station.receive(55.0, bytes(mavlink.MAVLink_heartbeat_message(11, 3, 128, 4, 4, 3).pack(vehicle.mav)))
    while (now_s := station.next_output_s()) <= 150.0:
        if answers := vehicle.receive(station.take_output(now_s)):
            station.receive(now_s + 0.005, answers)
    if not shared:
        assert "DENIED" in station.verdict()
        assert station.skip_text == ""
        return
    assert station.failure(150.0) is None
    assert station.verdict() is None
    assert station.skip_text == "goal 20 deg at 60 s skipped: another station has set mode HOLD, armed"
    assert [order.skipped for order in station.orders if order.goal] == [False, True, True, False]
    in_hold.clear()
    play(station, vehicle, 200.0, start_s=155.0)  # back in GUIDED
    assert station.orders[-1].accepted_s == pytest.approx(180.0, abs=0.1)


def test_an_order_waits_for_the_autopilot():
    station = GroundStation((), sends_first=True)
    station.order(disarm(5.0), 5.0)
    assert station.take_output(6.0)  # a heartbeat
    assert station.orders == ()
    vehicle = Vehicle()
    play(station, vehicle, 30.0, start_s=7.0)
    assert [command.command for command in vehicle.commands()] == [mavlink.MAV_CMD_COMPONENT_ARM_DISARM]


def test_reached_items_are_recorded_with_their_times():
    station, vehicle = GroundStation(()), Vehicle()
    for t_s, items in ((1.0, (1, 2)), (7.5, (3,))):  # a command takes no time: two in one tick
        frames = b"".join(mavlink.MAVLink_mission_item_reached_message(item).pack(vehicle.mav) for item in items)
        station.receive(t_s, frames)
    assert list(station.reached) == [(1.0, 1), (1.0, 2), (7.5, 3)]
