"""Messages of the emulated flight controller, decoded with pymavlink."""

import math
import re

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from hil.devices.mavlink_board import MavlinkBoardEmulator, Software
from hil.ship.disturbances import Supply
from hil.ship.power_plant import Place, PowerPlant


class Boat:
    """A boat that turns to starboard and makes way to the north-west."""

    def heading_rad(self):
        return 7.0

    def yaw_rate_rad_s(self):
        return 0.2

    def latitude_deg(self):
        return -36.5

    def longitude_deg(self):
        return 179.99999

    def speed_over_ground_m_s(self):
        return 0.5

    def course_over_ground_rad(self):
        return math.radians(315.0)

    def utc_s(self):
        return 1_767_225_600.0


class Station:
    """The far end of the line, with the address of a companion computer."""

    def __init__(self, **options):
        self.board = MavlinkBoardEmulator(Boat(), np.random.default_rng(1), whereabouts=Boat(), **options)
        self.mav = dialect.MAVLink(None, srcSystem=1, srcComponent=191)
        self.now_s = 0.0

    def send(self, message):
        self.board.receive(self.now_s, bytes(message.pack(self.mav)))

    def request(self, number, interval_us=100_000):
        self.send(dialect.MAVLink_command_long_message(1, 1, 511, 0, number, interval_us, 0, 0, 0, 0, 0))

    def run(self, until_s):
        """Return the messages until a time."""
        data = b""
        while (due_s := self.board.next_output_s()) <= until_s:
            self.now_s = due_s
            data += self.board.take_output(due_s)
        self.now_s = until_s
        return dialect.MAVLink(None).parse_buffer(data) or []


@pytest.fixture
def station():
    return Station()


def kinds(messages):
    return [message.get_type() for message in messages]


def test_only_heartbeats_come_before_a_request(station):
    messages = station.run(3.5)
    assert kinds(messages) == ["HEARTBEAT"] * 4
    assert (messages[0].type, messages[0].autopilot, messages[0].get_srcSystem()) == (11, 3, 1)


@pytest.mark.parametrize(
    ("software", "number", "result"),
    [
        (Software.ARDUPILOT, 30, 0), (Software.ARDUPILOT, 193, 0), (Software.ARDUPILOT, 230, 2), (Software.PX4, 230, 0),
        (Software.PX4, 193, 2), (Software.OLD_ARDUPILOT, 30, 3),
    ],
)  # fmt: skip
def test_interval_is_acknowledged_and_set(software, number, result):
    station = Station(software=software)
    station.run(1.5)
    station.request(number)
    messages = station.run(2.56)
    (acknowledgement,) = [message for message in messages if message.get_type() == "COMMAND_ACK"]
    assert (acknowledgement.command, acknowledgement.result) == (511, result)
    count = sum(message.get_msgId() == number for message in messages)
    assert count == (10 if result == 0 else 0)


def test_group_is_set(station):
    station.run(1.5)
    station.send(dialect.MAVLink_request_data_stream_message(1, 1, 12, 2, 1))
    assert set(kinds(station.run(4.0))) == {"HEARTBEAT", "SYSTEM_TIME", "BATTERY_STATUS", "EKF_STATUS_REPORT"}


def one(station, number):
    """Request a message and return the first one."""
    station.run(station.now_s + 2.0)
    station.request(number)
    return next(row for row in station.run(station.now_s + 1.0) if row.get_msgId() == number)


def test_attitude(station):
    station.board.roll_deg, station.board.pitch_deg = 30.0, -20.0
    attitude = one(station, 30)
    assert math.degrees(attitude.yaw) == pytest.approx(math.degrees(7.0 - math.tau), abs=3.0)
    assert (math.degrees(attitude.roll), math.degrees(attitude.pitch)) == (pytest.approx(30.0), pytest.approx(-20.0))
    # 0.2 rad/s about the vertical: sin 20, cos 20 sin 30, cos 20 cos 30.
    rates = (attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed)
    assert rates == (pytest.approx(0.0684, abs=4e-3), pytest.approx(0.0940, abs=4e-3), pytest.approx(0.1628, abs=4e-3))
    assert attitude.time_boot_ms == pytest.approx(2100, abs=2)


def test_position_and_time(station):
    fix = one(station, 24)
    assert (fix.fix_type, fix.satellites_visible, fix.eph) == (3, 14, 80)
    assert fix.lat * 1e-7 == pytest.approx(-36.5, abs=1e-4)
    assert abs(fix.lon * 1e-7) == pytest.approx(180.0, abs=1e-4)
    assert fix.vel == pytest.approx(50, abs=15)
    assert fix.cog == pytest.approx(31_500, abs=2000)
    estimate = one(station, 33)
    assert (estimate.vx, estimate.vy) == (pytest.approx(35, abs=12), pytest.approx(-35, abs=12))
    assert one(station, 2).time_unix_usec == 1_767_225_600_000_000
    station.board.fix = False
    messages = station.run(station.now_s + 1.5)
    assert [row.fix_type for row in messages if row.get_msgId() == 24][-1] == 1
    assert [row.time_unix_usec for row in messages if row.get_msgId() == 2][-1] == 0


def test_errors_of_heading_and_position_are_slow(station):
    station.run(1.0)
    station.request(30)
    station.request(33)
    messages = station.run(600.0)
    yaw_deg = np.degrees([row.yaw for row in messages if row.get_msgId() == 30]) - math.degrees(7.0 - math.tau)
    assert np.std(yaw_deg) == pytest.approx(0.5, abs=0.2)
    assert np.std(np.diff(yaw_deg)) == pytest.approx(0.08, abs=0.02)
    north_m = 111_194.93 * (np.array([row.lat for row in messages if row.get_msgId() == 33]) * 1e-7 + 36.5)
    assert np.std(north_m) == pytest.approx(1.5, abs=0.7)


def test_status_of_the_estimator(station):
    status = one(station, 193)
    assert (status.flags & 0x401, status.compass_variance) == (1, pytest.approx(0.1))
    station.board.is_ready, station.board.test_ratio = False, 2.0
    last = [row for row in station.run(station.now_s + 1.0) if row.get_msgId() == 193][-1]
    assert (last.flags, last.compass_variance) == (0x400, 2.0)


def test_power_cut_forgets_the_requests_and_restarts_the_clock_and_the_estimator(station):
    one(station, 30)
    station.board.power_cycle(station.now_s, off_s=1.0)
    off_s = station.now_s
    assert station.run(off_s + 1.4) == []
    assert kinds(station.run(off_s + 2.0)) == ["HEARTBEAT"]
    station.request(193)
    station.request(30)
    messages = station.run(off_s + 3.0)
    attitude = next(row for row in messages if row.get_msgId() == 30)
    assert attitude.time_boot_ms == pytest.approx(1100, abs=10)
    flags = [row.flags for row in messages if row.get_msgId() == 193]
    assert flags[-1] & 1


def test_second_autopilot_has_another_heading(station):
    station.board.second_system = 2
    one(station, 30)
    messages = [row for row in station.run(station.now_s + 0.55) if row.get_msgId() == 30]
    systems = {row.get_srcSystem(): math.degrees(row.yaw) for row in messages}
    assert systems[2] - systems[1] == pytest.approx(90.0, abs=3.0)


def test_mavlink_1_has_no_extension_fields(station):
    station.board.is_mavlink1 = True
    station.run(1.0)
    for number in (1, 24, 147, 193):
        station.request(number, 1_000_000)
    data = b""
    while (due_s := station.board.next_output_s()) < 2.5:
        data += station.board.take_output(due_s)
    assert set(data[:2]) == {0xFE, 9}
    for number, size in ((1, 31), (24, 30), (147, 36), (193, 22), (77, 3)):
        start = re.search(re.escape(bytes((0xFE, size))) + rb".\x01\x01" + bytes((number,)), data, re.DOTALL).start()
        covered = data[start + 1 : start + 6 + size]
        checksum = dialect.x25crc(covered + bytes((dialect.mavlink_map[number].crc_extra,))).crc
        assert data[start + 6 + size : start + 8 + size] == checksum.to_bytes(2, "little")


def test_battery_of_a_power_plant(station):
    assert (one(station, 147).voltages[0], one(station, 1).current_battery) == (12_800, 40)
    place = Place(36.0, 0.0, 1_782_000_000.0 - 1_782_000_000.0 % 86_400.0)  # at midnight
    station.board.battery = PowerPlant(Supply(clouds=0.0, charge=0.5), place, np.random.default_rng(1), lambda: 0.0)
    station.request(147, 1_000_000)
    battery = [row for row in station.run(30.0) if row.get_msgId() == 147][-1]
    assert battery.battery_remaining == 50
    assert battery.current_battery * battery.voltages[0] * 1e-5 == pytest.approx(4.0, abs=0.2)


def test_commands_that_a_sensor_board_must_not_be_sent_are_listed(station):
    station.run(1.5)
    station.send(dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    station.request(30)
    assert station.board.unexpected == []
    station.send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    station.send(dialect.MAVLink_param_set_message(1, 1, b"ARMING_CHECK", 0, 9))
    station.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    assert station.board.unexpected == ["COMMAND_LONG", "PARAM_SET", "HEARTBEAT"]
