"""Selection of a flight controller, requests of its messages, and the closed list of messages that leave."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.mavlink_board import FlightController, Wanted
from firmware_py.sensors.mavlink_frames import Message, Stream
from support.flight_controller import ARDUPILOT, INVALID, PX4, Board, decode_all, kinds, requested

COMPONENT = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
WANTED = (
    Wanted(Message.ATTITUDE, 10, Stream.EXTRA1),
    Wanted(Message.EKF_STATUS_REPORT, 2, Stream.EXTRA3, ARDUPILOT),
    Wanted(Message.ESTIMATOR_STATUS, 2, Stream.EXTRA3, PX4),
)
BOTH = [(Message.ATTITUDE, 100_000), (Message.EKF_STATUS_REPORT, 500_000)]  # message, interval in microseconds
REQUEST, GROUP = "COMMAND_LONG", "REQUEST_DATA_STREAM"
SET_INTERVAL = dialect.MAV_CMD_SET_MESSAGE_INTERVAL


class Rig:
    """A connection and its line."""

    def __init__(self, line, address=(0, 1)):
        self.line = line
        self.monitor = DeviceMonitor(line, DeviceRole.COMPASS)
        self.connection = FlightController(line, self.monitor, address, COMPONENT, WANTED)
        self.frames = []

    def receive(self, now_s, *data):
        """Deliver data and return the bytes written."""
        count = len(self.line.written)
        self.line.inbox += b"".join(data)
        self.frames = list(self.connection.receive(now_s))
        return self.line.written[count:]

    def select(self, board, now_s=0.0):
        """Let the connection select a board; return the bytes written."""
        return self.receive(now_s, board.heartbeat(), board.heartbeat())


@pytest.fixture
def rig(line):
    return Rig(line)


@pytest.fixture
def board():
    return Board()


def test_board_is_selected_at_its_second_heartbeat(rig, board):
    assert kinds(rig.receive(0.0, board.heartbeat(), board.attitude())) == ["HEARTBEAT"]
    assert rig.frames == []
    assert requested(rig.receive(0.5, board.heartbeat())) == BOTH
    rig.receive(0.6, board.attitude())
    assert [frame.message for frame in rig.frames] == [Message.ATTITUDE]


def test_only_the_first_of_two_autopilots_is_read_and_the_other_is_reported(rig, board):
    other = Board(system=2)
    rig.receive(0.0, other.heartbeat(), board.heartbeat(), board.heartbeat(), other.heartbeat())
    rig.receive(0.1, other.attitude(), board.attitude())
    assert [(frame.system, frame.message) for frame in rig.frames] == [(1, Message.ATTITUDE)]
    assert rig.connection.other_text == "autopilot 2/1 ignored: set system and component"


@pytest.mark.parametrize(
    ("system", "component", "autopilot", "kind"),
    [
        (255, 190, INVALID, dialect.MAV_TYPE_GCS),
        (255, 190, ARDUPILOT, dialect.MAV_TYPE_GCS),
        (1, 154, INVALID, dialect.MAV_TYPE_GIMBAL),
        (1, COMPONENT, INVALID, dialect.MAV_TYPE_ONBOARD_CONTROLLER),
    ],
)
def test_other_components_are_neither_selected_nor_reported(rig, system, component, autopilot, kind):
    other = Board(system, component, autopilot, kind)
    rig.connection = FlightController(rig.line, rig.monitor, (0, component), COMPONENT, WANTED)
    rig.select(other)
    assert requested(rig.receive(1.0, other.heartbeat(), other.attitude())) == []
    assert (rig.frames, rig.connection.other_text) == ([], "")


@pytest.mark.parametrize(("address", "is_read"), [((3, 1), True), ((4, 1), False), ((3, 2), False), ((0, 1), True)])
def test_board_is_that_of_the_vehicle_file(line, address, is_read):
    rig, board = Rig(line, address), Board(system=3)
    rig.select(board)
    rig.receive(0.1, board.attitude())
    assert bool(rig.frames) == is_read
    assert bool(rig.connection.other_text) != is_read
    ignored = "autopilot 3/1 ignored: set system and component"
    assert (rig.monitor.health(0.1).text == ignored) != is_read
    line.plug()
    rig.receive(0.2)
    assert rig.connection.other_text == ""


def test_single_heartbeats_of_many_other_systems_do_not_prevent_the_selection(rig, board):
    for system in range(2, 60):
        rig.receive(0.0, Board(system).heartbeat())
    rig.receive(0.1, board.heartbeat(), Board(2).heartbeat(), board.heartbeat())
    rig.receive(0.2, board.attitude())
    assert len(rig.frames) == 1
    assert len(rig.connection._candidates) <= 8


def test_selection_is_repeated_after_reopening(rig, board):
    first, second = board.heartbeat(), board.heartbeat()
    rig.select(board)
    rig.receive(0.5, first[:8])
    rig.line.unplug()
    assert rig.receive(1.0) == []
    rig.line.plug()
    assert kinds(rig.receive(2.0, first[8:], second, board.attitude())) == ["HEARTBEAT"]
    assert rig.frames == []
    assert requested(rig.receive(2.5, board.heartbeat())) == BOTH


def test_heartbeat_once_a_second_with_the_system_id_of_the_board(rig):
    sent = [(tenth, message) for tenth in range(30) for message in decode_all(rig.receive(tenth / 10))]
    expected = [(tenth, "HEARTBEAT", 1) for tenth in (0, 10, 20)]
    assert [(tenth, message.get_type(), message.get_srcSystem()) for tenth, message in sent] == expected
    rig.select(Board(system=9), 3.0)
    (heartbeat,) = [row for row in decode_all(rig.receive(4.0)) if row.get_type() == "HEARTBEAT"]
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (9, COMPONENT)


def test_own_system_is_that_of_the_vehicle_file_before_the_board_is_known(line):
    (heartbeat,) = decode_all(Rig(line, (42, 1)).receive(0.0))
    assert heartbeat.get_srcSystem() == 42


def test_requests_are_addressed_to_the_board(rig):
    (request, *_) = [row for row in decode_all(rig.select(Board(system=9))) if row.get_type() == REQUEST]
    assert (request.command, request.target_system, request.target_component) == (SET_INTERVAL, 9, 1)


def requests_over_time(rig, seconds, *data, from_s=0.0):
    """Deliver data ten times a second; return the times and kinds of the requests."""
    requests = []
    for tenth in range(round(10 * seconds)):
        now_s = from_s + tenth / 10
        requests += [(now_s, kind) for kind in kinds(rig.receive(now_s, *data)) if kind != "HEARTBEAT"]
    return requests


def test_all_messages_are_requested_twice_and_not_again_while_they_arrive(rig, board):
    rig.select(board)
    requests = requests_over_time(rig, 20.0, board.heartbeat(), board.attitude(), board.ekf(), from_s=0.1)
    assert requests == [(1.0, REQUEST)] * 2


def test_missing_message_is_requested_each_second_then_each_five_and_as_a_group(rig, board):
    rig.select(board)
    requests = requests_over_time(rig, 15.0, board.heartbeat(), board.attitude(), from_s=0.1)
    # Both in the second round; then EKF_STATUS_REPORT alone, from the fourth round on with its group.
    times_s = [1.0, 1.0, 2.0, 3.0, 3.0, 4.0, 4.0, 9.0, 9.0, 14.0, 14.0]
    expected = [REQUEST, REQUEST, REQUEST, *[REQUEST, GROUP] * 4]
    assert requests == [(pytest.approx(t_s), kind) for t_s, kind in zip(times_s, expected, strict=True)]


@pytest.mark.parametrize(("last_s", "requested_s"), [(8.9, 11.0), (9.0, 12.0)])
def test_message_is_missing_after_two_seconds(rig, board, last_s, requested_s):
    rig.select(board)
    requests_over_time(rig, last_s, board.heartbeat(), board.attitude(), board.ekf(), from_s=0.1)
    requests = requests_over_time(rig, 3.5, board.heartbeat(), board.ekf(), from_s=last_s + 0.1)
    assert requests[0] == (pytest.approx(requested_s), REQUEST)


@pytest.mark.parametrize(("last_s", "requested_s"), [(8.9, 12.0), (9.0, 13.0)])
def test_slow_message_is_missing_after_three_intervals(line, board, last_s, requested_s):
    rig = Rig(line)
    rig.connection = FlightController(
        line, rig.monitor, (0, 1), COMPONENT, [Wanted(Message.SYSTEM_TIME, 1, Stream.EXTRA3)]
    )
    rig.select(board)
    time = board.pack(dialect.MAVLink_system_time_message(0, 10_000))
    requests_over_time(rig, last_s, board.heartbeat(), time, from_s=0.1)
    requests = requests_over_time(rig, 5.0, board.heartbeat(), from_s=last_s + 0.1)
    assert requests[0] == (pytest.approx(requested_s), REQUEST)


@pytest.mark.parametrize(
    ("result", "is_refused"),
    [
        (dialect.MAV_RESULT_ACCEPTED, False),
        (dialect.MAV_RESULT_TEMPORARILY_REJECTED, False),
        (dialect.MAV_RESULT_DENIED, True),
        (dialect.MAV_RESULT_UNSUPPORTED, True),
        (dialect.MAV_RESULT_FAILED, True),
        (dialect.MAV_RESULT_IN_PROGRESS, False),
    ],
)
def test_group_is_requested_after_a_refusal(rig, board, result, is_refused):
    rig.select(board)
    rig.receive(0.5, board.acknowledgement(result))
    groups = [row for row in decode_all(rig.receive(1.0)) if row.get_type() == GROUP]
    expected = [(dialect.MAV_DATA_STREAM_EXTRA1, 10), (dialect.MAV_DATA_STREAM_EXTRA3, 2)] if is_refused else []
    assert [(row.req_stream_id, row.req_message_rate) for row in groups] == expected


def test_acknowledgement_of_another_command_is_no_refusal(rig, board):
    rig.select(board)
    rig.receive(0.5, board.acknowledgement(dialect.MAV_RESULT_UNSUPPORTED, dialect.MAV_CMD_COMPONENT_ARM_DISARM))
    assert GROUP not in kinds(rig.receive(1.0))


def test_status_message_is_that_of_the_software(rig):
    assert requested(rig.select(Board(autopilot=PX4))) == [
        (Message.ATTITUDE, 100_000),
        (Message.ESTIMATOR_STATUS, 500_000),
    ]


def test_all_messages_are_requested_again_after_a_restart_of_the_board(rig, board):
    rig.select(board)
    requests_over_time(rig, 5.0, board.heartbeat(), board.attitude(boot_ms=60_000), board.ekf(), from_s=0.1)
    restarts = rig.connection.restarts
    assert requested(rig.receive(5.2, board.attitude(boot_ms=59_000))) == []
    assert rig.connection.restarts == restarts
    assert requested(rig.receive(5.3, board.attitude(boot_ms=57_999))) == BOTH
    assert rig.connection.restarts == restarts + 1


def test_time_since_boot_of_system_time_runs_back(rig, board):
    rig.select(board)
    for boot_ms in (60_000, 59_000, 57_999):
        rig.receive(0.5, board.pack(dialect.MAVLink_system_time_message(0, boot_ms)))
        assert rig.connection.restarts == (3 if boot_ms == 57_999 else 2)


def test_old_position_is_no_restart(rig, board):
    """Older ArduPilots send the time of the last fix, which stays behind while the receiver is silent."""
    rig.select(board)
    rig.receive(0.5, board.attitude(boot_ms=60_000))
    rig.receive(0.6, board.pack(dialect.MAVLink_global_position_int_message(1000, 1, 2, 3, 4, 5, 6, 7, 8)))
    rig.receive(0.7, board.attitude(boot_ms=60_200))
    assert rig.connection.restarts == 2


@pytest.mark.parametrize(("gap_s", "is_requested"), [(2.5, False), (2.6, True)])
def test_all_messages_are_requested_again_after_a_gap_of_the_heartbeats(rig, board, gap_s, is_requested):
    rig.select(board)
    requests_over_time(rig, 5.0, board.heartbeat(), board.attitude(), board.ekf(), from_s=0.1)
    requests_over_time(rig, gap_s - 0.1, board.attitude(), board.ekf(), from_s=5.1)
    assert requested(rig.receive(5.0 + gap_s, board.heartbeat())) == (BOTH if is_requested else [])


def test_refusal_is_forgotten_after_a_restart(rig, board):
    rig.select(board)
    rig.receive(0.5, board.attitude(boot_ms=60_000), board.acknowledgement(dialect.MAV_RESULT_UNSUPPORTED))
    rig.receive(0.6, board.attitude(boot_ms=1000))
    assert kinds(rig.receive(1.7)) == ["HEARTBEAT", REQUEST, REQUEST]


def test_only_heartbeats_and_requests_leave_whatever_arrives(rig):
    """No message that arms, moves or configures the flight controller leaves."""
    boards = [Board(), Board(2), Board(1, 1, PX4), Board(255, 190, INVALID, dialect.MAV_TYPE_GCS)]
    for tenth in range(300):
        data = b"".join(
            board.heartbeat() + board.attitude(boot_ms=tenth % 37 * 1000) + board.acknowledgement(tenth % 6)
            for board in boards
        )
        if tenth % 50 == 49:
            rig.line.plug()
        rig.receive(tenth / 10, data)
    sent = decode_all(rig.line.written)
    assert {message.get_type() for message in sent} == {"HEARTBEAT", REQUEST, GROUP}
    assert {message.command for message in sent if message.get_type() == REQUEST} == {SET_INTERVAL}
    assert {int(message.param1) for message in sent if message.get_type() == REQUEST} <= {row.message for row in WANTED}
    assert {message.type for message in sent if message.get_type() == "HEARTBEAT"} == {
        dialect.MAV_TYPE_ONBOARD_CONTROLLER
    }
    assert all(message.param2 > 0 for message in sent if message.get_type() == REQUEST)
    assert len(sent) < 300  # bounded: at most ten messages a second


def test_nothing_is_sent_on_a_closed_line(rig):
    rig.line.unplug()
    assert rig.receive(0.0) == []
