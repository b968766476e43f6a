"""Emulated Maestro with its hobby servo, against the user's guide."""

import math

import pytest

from hil.devices.hobby_servo import HobbyServo
from hil.devices.maestro import MaestroEmulator, divide
from hil.ship.servo import ServoShaft

DEG = math.pi / 180.0
SET_1500_US = bytes.fromhex("84 00 70 2E")  # section 5.c
GET_POSITION, GET_ERRORS = b"\x90\x00", b"\xa1"


@pytest.fixture
def shaft():
    return ServoShaft(low_stop_rad=-2.0, high_stop_rad=2.0)


@pytest.fixture
def servo(shaft):
    return HobbyServo(shaft)


@pytest.fixture
def make(servo):
    return lambda **options: MaestroEmulator(servo, **options)


@pytest.fixture
def ask(run):
    """Function that sends a command and returns the numbers in the replies."""

    def ask(maestro, data, now_s=1.0):
        maestro.receive(now_s, data)
        return [int.from_bytes(output, "little") for _, output in run(maestro, now_s + 0.01)]

    return ask


def set_target(channel, us, command=0x84):
    quarters = round(4 * us)
    return bytes([command, channel, quarters & 0x7F, quarters >> 7])


def test_commands_of_the_manual(make, servo, ask):
    maestro = make()
    assert ask(maestro, GET_POSITION) == [0]
    assert ask(maestro, SET_1500_US + GET_POSITION) == [6000]
    assert servo.width_us == 1500.0
    assert ask(maestro, bytes.fromhex("AA 0C 04 00 70 2E")) == []  # the same in Pololu protocol
    assert ask(maestro, bytes.fromhex("AA 0C 10 00")) == [6000]
    assert ask(maestro, bytes.fromhex("AA 0D 04 00 00 00") + GET_POSITION) == [6000]  # for another device
    assert ask(maestro, GET_ERRORS) == [0]


def test_crc_of_the_manual(make, ask):
    assert divide([0x83, 0x01]) == 0x17
    maestro = make(crc=True)
    for data in (SET_1500_US, GET_POSITION):
        assert ask(maestro, data + bytes([divide(list(data))])) == ([] if data is SET_1500_US else [6000])
    wrong = SET_1500_US + bytes([divide(list(SET_1500_US)) ^ 1])
    assert ask(maestro, wrong) == []
    assert maestro.errors == 1 << 3


@pytest.mark.parametrize(
    "data",
    [b"\x00", b"\x84\x00\x84\x00\x70\x2e", b"\x85\x00\x00\x00", b"\x84\x18\x70\x2e"],
    ids=["data without a command", "unfinished", "unknown", "channel 24"],
)
def test_protocol_error_sends_the_servo_home_and_is_read_once(make, servo, ask, data):
    maestro = make()
    ask(maestro, SET_1500_US)
    ask(maestro, data)
    assert servo.width_us is None or data.endswith(b"\x70\x2e")
    assert ask(maestro, GET_ERRORS, 2.0)[-1:] == [1 << 4]
    assert ask(maestro, GET_ERRORS, 3.0) == [0]


def test_target_is_limited_by_the_settings_of_the_channel(make, ask):
    maestro = make(limits_us=(992.0, 2000.0))
    assert ask(maestro, set_target(0, 2400.0) + GET_POSITION) == [8000]
    assert ask(maestro, set_target(0, 500.0) + GET_POSITION) == [3968]
    assert ask(maestro, set_target(0, 0.0) + GET_POSITION) == [0]


def test_speed_limit_of_the_manual(make, servo, ask):
    """Speed 140 is 3.5 us/ms: from 1000 to 1350 us in 100 ms."""
    maestro = make()
    ask(maestro, set_target(0, 1000.0) + bytes.fromhex("87 00 0C 01"), 0.0)
    ask(maestro, set_target(0, 1350.0), 1.0)
    widths = []
    while maestro.next_output_s() < 2.0:
        now_s = maestro.next_output_s()
        maestro.take_output(now_s)
        widths.append((round(now_s - 1.0, 3), servo.width_us))
    assert widths == [(0.02, 1070.0), (0.04, 1140.0), (0.06, 1210.0), (0.08, 1280.0), (0.1, 1350.0)]


def test_power_cut_releases_the_servo_and_forgets_the_limits(make, servo, ask):
    maestro = make(detects_baud=True)
    assert ask(maestro, SET_1500_US + GET_POSITION) == []
    assert ask(maestro, bytes.fromhex("AA 0C 21") + SET_1500_US + bytes.fromhex("87 00 0C 01")) == [0]
    maestro.power_cycle(2.0, off_s=1.0)
    assert servo.width_us is None
    assert ask(maestro, GET_POSITION, 3.2) == []  # boots until 3.3 s
    assert ask(maestro, GET_POSITION, 3.4) == []  # waits for AA
    assert ask(maestro, bytes.fromhex("AA 0C 21"), 3.5) == [0]
    assert ask(maestro, SET_1500_US + set_target(0, 2000.0) + GET_POSITION, 3.6) == [8000]  # no speed limit


def test_invalid_channel_is_refused(make):
    with pytest.raises(ValueError, match="channel 24: a Maestro has 0 to 23"):
        make(channel=24)


def test_hobby_servo_moves_without_reports(shaft, servo):
    servo.set_pulse(2000.0)
    shaft.advance(0.5)
    assert shaft.angle_rad() == pytest.approx(15.0 * DEG)  # 30 deg/s
    shaft.advance(9.0)
    assert shaft.angle_rad() == pytest.approx(500.0 / 636.6)


@pytest.mark.parametrize("step_us", [4.0, -4.0])
def test_deadband_of_the_hobby_servo(shaft, servo, step_us):
    servo.set_pulse(1600.0)
    shaft.advance(9.0)
    angle_rad = shaft.angle_rad()
    servo.set_pulse(1600.0 + step_us)
    shaft.advance(19.0)
    assert shaft.angle_rad() == angle_rad
    servo.set_pulse(1600.0 + 2.0 * step_us)
    shaft.advance(29.0)
    assert shaft.angle_rad() == pytest.approx((100.0 + 2.0 * step_us) / 636.6)


@pytest.mark.parametrize("width_us", [None, 499.0, 2501.0])
def test_hobby_servo_without_usable_pulses_is_free(shaft, servo, width_us):
    servo.set_pulse(1600.0)
    shaft.advance(0.05)
    angle_rad = shaft.angle_rad()
    servo.set_pulse(width_us)
    shaft.advance(9.0)
    assert (servo.width_us, shaft.angle_rad()) == (None, angle_rad)
    servo.set_pulse(1600.0)
    shaft.advance(19.0)
    assert shaft.angle_rad() == pytest.approx(100.0 / 636.6)
