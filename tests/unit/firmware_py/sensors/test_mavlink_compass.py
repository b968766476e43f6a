"""Headings of a flight controller and their validity."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.sensors.mavlink_compass import MavlinkCompass, MavlinkCompassOptions
from firmware_py.sensors.mavlink_frames import Message
from hil.devices.mavlink_board import MavlinkBoardEmulator, Software
from support.flight_controller import PX4, Board, decode_all, requested

# Flags of EKF_STATUS_REPORT: without a valid attitude; with one, but not initialised.
NOT_READY, UNINITIALIZED = 0x033E, 0x0401


class Rig:
    """A compass, its line, and a board that it has selected."""

    def __init__(self, line, board=None, **options):
        self.line, self.board = line, Board() if board is None else board
        self.compass = MavlinkCompass(line, MavlinkCompassOptions(**options))
        self.headings(0.0, self.board.heartbeat(), self.board.heartbeat())

    def samples(self, now_s, *data):
        self.line.inbox += b"".join(data)
        self.compass.receive(now_s)
        return self.compass.poll()

    def headings(self, now_s, *data):
        return [round(math.degrees(sample.heading_rad), 3) for sample in self.samples(now_s, *data)]

    def health(self, now_s):
        health = self.compass.health(now_s)
        return health.state, health.text


@pytest.fixture
def rig(line):
    return Rig(line)


def test_heading_yaw_rate_and_tilt(rig):
    attitude = rig.board.attitude(350.0, roll_deg=10.0, pitch_deg=-20.0, rates=(0.5, 0.2, 0.3))
    (sample,) = rig.samples(1.0, rig.board.ekf(), attitude)
    assert math.degrees(sample.heading_rad) == pytest.approx(350.0, abs=1e-4)
    assert (sample.t_s, sample.reference, sample.variation_rad) == (1.0, NorthReference.TRUE, None)
    assert math.degrees(sample.roll_rad) == pytest.approx(10.0, abs=1e-4)
    assert math.degrees(sample.pitch_rad) == pytest.approx(-20.0, abs=1e-4)
    # (0.2 sin 10 deg + 0.3 cos 10 deg) / cos 20 deg
    assert sample.yaw_rate_rad_s == pytest.approx(0.35136, abs=1e-4)
    assert rig.health(1.0) == (DeviceState.RUNNING, "")


@pytest.mark.parametrize(("pitch_deg", "is_used"), [(79.0, True), (-79.0, True), (81.0, False), (-81.0, False)])
def test_nearly_vertical_board_has_no_heading(rig, pitch_deg, is_used):
    samples = rig.samples(1.0, rig.board.ekf(), rig.board.attitude(pitch_deg=pitch_deg))
    assert bool(samples) is is_used
    vertical = (DeviceState.FAULTY, "attitude near vertical: check the mounting")
    assert rig.health(1.0) == ((DeviceState.RUNNING, "") if is_used else vertical)
    assert rig.headings(1.1, rig.board.attitude()) == [98.5]
    assert rig.health(1.1) == (DeviceState.RUNNING, "")


def test_reference_may_be_magnetic(line):
    rig = Rig(line, reference="magnetic")
    (sample,) = rig.samples(1.0, rig.board.ekf(), rig.board.attitude())
    assert sample.reference is NorthReference.MAGNETIC


def test_options_are_checked():
    for options, problem in (({"reference": "grid"}, "reference: 'grid'"), ({"rate_hz": 51}, "rate_hz: .* 1 to 50$")):
        with pytest.raises(ValueError, match=problem):
            MavlinkCompassOptions(**options)


@pytest.mark.parametrize(
    ("status", "text"),
    [
        ({"flags": NOT_READY}, "heading not valid: estimator not ready"),
        ({"flags": UNINITIALIZED}, "heading not valid: estimator not ready"),
        ({"flags": 0xFFFF - (1 << 10)}, ""),
        ({"ratio": 1.01}, "heading not valid: magnetometer rejected"),
        ({"ratio": 1.0}, ""),
        ({"ratio": math.nan}, ""),
    ],
)
def test_heading_is_valid_while_the_estimator_says_so(rig, status, text):
    assert rig.headings(1.0, rig.board.ekf(**status), rig.board.attitude()) == ([] if text else [98.5])
    assert rig.health(1.0) == ((DeviceState.FAULTY, text) if text else (DeviceState.RUNNING, ""))
    assert rig.headings(1.1, rig.board.ekf(), rig.board.attitude()) == [98.5]
    assert rig.health(1.1) == (DeviceState.RUNNING, "")


@pytest.mark.parametrize(
    ("status", "is_valid"),
    [({}, True), ({"flags": NOT_READY}, False), ({"ratio": 1.01}, False), ({"flags": UNINITIALIZED}, True)],
)
def test_status_of_px4(line, status, is_valid):
    """Bit 10 of ESTIMATOR_STATUS is a GNSS glitch, which does not concern the heading."""
    rig = Rig(line, Board(autopilot=PX4))
    assert bool(rig.headings(1.0, rig.board.estimator(**status), rig.board.attitude())) == is_valid


def test_no_heading_before_the_first_status_and_after_a_silent_one(rig):
    assert rig.headings(1.0, rig.board.attitude()) == []
    assert rig.health(1.0) == (DeviceState.RUNNING, "")
    assert rig.headings(4.0, rig.board.attitude()) == []
    assert rig.health(4.0) == (DeviceState.RUNNING, "")
    assert rig.headings(4.01, rig.board.attitude()) == []
    assert rig.health(4.01) == (DeviceState.FAULTY, "heading not valid: no estimator status")
    assert rig.headings(5.0, rig.board.ekf(), rig.board.attitude()) == [98.5]
    assert rig.headings(8.0, rig.board.attitude()) == [98.5]
    assert rig.headings(8.01, rig.board.attitude()) == []


def test_status_may_be_waived(line):
    rig = Rig(line, require_status=False)
    assert rig.headings(1.0, rig.board.attitude()) == [98.5]
    assert rig.headings(20.0, rig.board.attitude()) == [98.5]
    assert rig.headings(21.0, rig.board.ekf(NOT_READY), rig.board.attitude()) == []


@pytest.mark.parametrize("is_reopened", [True, False])
def test_no_heading_after_a_restart_until_the_next_status(rig, is_reopened):
    board = rig.board
    assert rig.headings(1.0, board.ekf(), board.attitude(boot_ms=60_000)) == [98.5]
    if is_reopened:
        rig.line.plug()
        assert rig.headings(1.1, board.heartbeat(), board.heartbeat(), board.attitude(boot_ms=60_100)) == []
    assert rig.headings(1.2, board.attitude(boot_ms=500)) == []
    assert rig.headings(1.3, board.ekf(), board.attitude(boot_ms=600)) == [98.5]


def test_board_that_was_started_while_the_line_was_closed_is_one_restart(rig):
    board = rig.board
    assert rig.headings(1.0, board.ekf(), board.attitude(boot_ms=60_000)) == [98.5]
    rig.line.plug()
    messages = board.heartbeat(), board.heartbeat(), board.ekf(), board.attitude(boot_ms=500)
    assert rig.headings(1.1, *messages) == [98.5]


def test_wait_for_a_status_begins_again_after_a_reopened_line(rig):
    board = rig.board
    assert rig.headings(1.0, board.ekf(flags=NOT_READY), board.attitude()) == []
    rig.line.plug()
    assert rig.headings(20.0, board.heartbeat(), board.heartbeat(), board.attitude()) == []
    assert rig.health(20.0) == (DeviceState.RUNNING, "")


@pytest.mark.parametrize(
    "values",
    [
        (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, math.inf, 0.0, 0.0, 0.0, 0.0),
        (0.0, math.pi / 2 + 1.05e-4, 0.0, 0.0, 0.0, 0.0),
        (0.0, -math.pi / 2 - 1.05e-4, 0.0, 0.0, 0.0, 0.0),
        (math.pi + 1.05e-4, 0.0, 0.0, 0.0, 0.0, 0.0),
        (-math.pi - 1.05e-4, 0.0, 0.0, 0.0, 0.0, 0.0),
        (0.0, 0.0, math.nan, 0.0, 0.0, 0.0),
        (0.0, 0.0, math.tau + 1.05e-4, 0.0, 0.0, 0.0),
        (0.0, 0.0, -math.pi - 1.05e-4, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 0.0, 0.0, 40.1),
        (0.0, 0.0, 0.0, -40.1, 0.0, 0.0),
    ],
)
def test_impossible_attitude_is_rejected(rig, values):
    bad = rig.board.pack(dialect.MAVLink_attitude_message(1, *values))
    assert rig.headings(1.0, rig.board.ekf(), bad) == []
    assert rig.compass.health(1.0).rejected == 1


@pytest.mark.parametrize(
    ("yaw_rad", "heading_rad"), [(6.28, 6.28), (-math.pi, math.pi), (3.0, 3.0), (-0.1, math.tau - 0.1)]
)
def test_yaw_of_either_range_is_read(rig, yaw_rad, heading_rad):
    attitude = rig.board.pack(dialect.MAVLink_attitude_message(1, 0.0, 0.0, yaw_rad, 0.0, 0.0, 0.0))
    (sample,) = rig.samples(1.0, rig.board.ekf(), attitude)
    assert sample.heading_rad == pytest.approx(heading_rad, abs=1e-6)


@pytest.mark.parametrize("angles", [(math.pi, math.pi / 2, math.tau), (-math.pi, -math.pi / 2, -math.pi)])
def test_limits_in_single_precision_are_accepted(rig, angles):
    """Single precision rounds all these limits outwards."""
    attitude = rig.board.pack(dialect.MAVLink_attitude_message(1, *angles, 40.0, -40.0, 0.0))
    assert list(rig.samples(1.0, rig.board.ekf(), attitude)) == []  # it is vertical
    health = rig.compass.health(1.0)
    assert (health.accepted, health.rejected) == (1, 0)


def test_second_autopilot_is_ignored_and_reported(rig):
    other = Board(system=2)
    assert rig.headings(1.0, rig.board.ekf(), rig.board.attitude(), other.heartbeat(), other.attitude(10.0)) == [98.5]
    assert rig.health(1.0) == (DeviceState.RUNNING, "autopilot 2/1 ignored: set system and component")


def test_states_without_headings(line):
    rig = Rig(line)
    assert rig.health(0.5) == (DeviceState.STARTING, "connected, no heading yet")
    rig.samples(1.0, rig.board.ekf(), rig.board.attitude())
    assert rig.health(7.0)[0] is DeviceState.SILENT
    line.plug()
    rig.samples(8.0, bytes(range(256)))
    assert rig.health(8.0) == (DeviceState.STARTING, "data not understood: wrong baud rate?")
    line.plug()
    rig.samples(8.1, rig.board.heartbeat())
    assert rig.health(8.1) == (DeviceState.STARTING, "one heartbeat: waiting for the next")
    line.unplug()
    rig.samples(9.0)
    assert rig.health(9.0) == (DeviceState.ABSENT, "no port /dev/fake")


def test_defaults_are_ten_headings_a_second_of_any_system(line):
    rig = Rig(line, Board(system=3))
    assert requested(line.written) == [(Message.ATTITUDE, 100_000), (Message.EKF_STATUS_REPORT, 500_000)]
    assert rig.headings(1.0, rig.board.ekf(), rig.board.attitude()) == [98.5]


def test_messages_are_requested_at_the_rate_of_the_vehicle_file(line):
    Rig(line, rate_hz=20)
    assert requested(line.written) == [(Message.ATTITUDE, 50_000), (Message.EKF_STATUS_REPORT, 500_000)]
    assert {message.get_srcComponent() for message in decode_all(line.written)} == {
        dialect.MAV_COMP_ID_ONBOARD_COMPUTER
    }


class Turning:
    """A boat that turns at a constant rate."""

    def heading_rad(self):
        return 1.0

    def yaw_rate_rad_s(self):
        return 0.1


@pytest.mark.parametrize("is_mavlink1", [False, True])
@pytest.mark.parametrize("software", Software)
def test_driver_and_emulator(line, software, is_mavlink1):
    emulator = MavlinkBoardEmulator(Turning(), np.random.default_rng(1), software=software, boot_s=0.3)
    emulator.is_mavlink1 = is_mavlink1
    emulator.roll_deg, emulator.pitch_deg = 20.0, -30.0
    compass = MavlinkCompass(line, MavlinkCompassOptions())
    samples, now_s, times_s = [], 0.0, []

    def run(until_s):
        nonlocal now_s
        while now_s < until_s:
            now_s += 0.02
            line.inbox += emulator.take_output(now_s)
            count = len(line.written)
            compass.receive(now_s)
            for data in line.written[count:]:
                emulator.receive(now_s, data)
            new = compass.poll()
            samples.extend(new)
            times_s.extend(sample.t_s for sample in new)

    run(10.0)
    assert times_s[0] < 4.0
    assert len([t_s for t_s in times_s if t_s > 5.0]) == pytest.approx(50, abs=2)
    assert np.mean([sample.heading_rad for sample in samples]) == pytest.approx(1.0, abs=math.radians(2.0))
    assert np.mean([sample.yaw_rate_rad_s for sample in samples]) == pytest.approx(0.1, abs=1e-3)
    emulator.power_cycle(now_s, off_s=1.0)
    times_s.clear()
    run(20.0)
    assert 11.0 < times_s[0] < 15.0
    emulator.is_ready = False
    run(20.6)
    times_s.clear()
    run(22.0)
    assert times_s == []
    assert compass.health(now_s).state is DeviceState.FAULTY
    assert emulator.unexpected == []
