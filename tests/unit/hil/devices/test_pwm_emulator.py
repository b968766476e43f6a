"""Emulated PWM output: the directory that imitates a chip, and the servo behind it."""

import math

import pytest

from firmware_py.system.pwm_line import PwmLine
from hil.devices.hobby_servo import HobbyServo
from hil.devices.pwm import PwmEmulator
from hil.devices.pwm_channel import PwmChannel
from hil.ship.servo import ServoShaft


@pytest.fixture
def servo():
    return HobbyServo(ServoShaft())


@pytest.fixture
def channel(tmp_path):
    channel = PwmChannel(tmp_path / "rudder")
    yield channel
    channel.close()


@pytest.fixture
def line(channel):
    line = PwmLine(channel.address)
    line.open()
    return line


def test_pulse_widths_reach_the_servo(servo):
    emulator = PwmEmulator(servo)
    emulator.receive(1.0, b"1500000\n17000")
    assert servo.width_us == 1500.0
    emulator.receive(1.1, b"00\n")
    assert servo.width_us == 1700.0
    emulator.receive(1.2, b"x\n\n-5\n")
    assert servo.width_us == 1700.0
    emulator.receive(1.3, b"0\n")
    assert servo.width_us is None
    assert math.isinf(emulator.next_output_s())
    assert emulator.take_output(2.0) == b""


def test_power_cut_releases_the_servo_until_the_next_pulse(servo):
    emulator = PwmEmulator(servo)
    emulator.receive(1.0, b"1500000\n")
    emulator.power_cycle(1.1)
    assert servo.width_us is None
    emulator.receive(1.2, b"1500000\n")
    assert servo.width_us == 1500.0


def test_channel_receives_every_pulse_of_the_line_once(channel, line):
    assert line.write(b"1500000\n")
    assert line.write(b"1600000\n")
    assert channel.read() == b"1500000\n1600000\n"
    assert channel.read() == b""
    assert channel.total_read == line.written == 16
    assert line.write(b"0\n")
    assert channel.read_until_total(17) == b"0"
    assert channel.read_until_total(18) == b"\n"
    assert channel.read_until_total(18) == b""


def test_removed_chip_is_opened_again(channel, line):
    channel.unplug()
    assert (channel.is_plugged, channel.fileno()) == (False, -1)
    assert not line.write(b"1500000\n")
    assert channel.read() == b""
    channel.plug()
    line.reopen(10.0)
    assert line.write(b"1500000\n")
    assert channel.read() == b"1500000\n"
    assert channel.total_read == line.written == 8


def test_channel_has_a_descriptor_and_sends_nothing(channel):
    assert channel.fileno() >= 0
    assert channel.write(b"x") == 0
    assert channel.overrun_bytes == 1
