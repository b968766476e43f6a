import math

import fastcrc
import numpy as np
import pytest

from hil.devices.volz import VolzEmulator
from hil.ship.servo import ServoShaft

DEG = math.pi / 180.0


def command(code, argument=0, device_id=1):
    body = bytes([code, device_id]) + argument.to_bytes(2, "big")
    return body + fastcrc.crc16.cms(body).to_bytes(2, "big")


@pytest.fixture
def shaft():
    return ServoShaft(low_stop_rad=-2.0, high_stop_rad=2.0)


@pytest.fixture
def servo(shaft):
    return VolzEmulator(shaft, np.random.default_rng(1))


@pytest.fixture
def ask(shaft, run):
    """Send bytes; return code, id and value of the replies."""

    def exchange(servo, data, now_s=1.0):
        shaft.advance(now_s)
        servo.receive(now_s, data)
        replies = [output for _, output in run(servo, now_s + 0.01)]
        for reply in replies:
            assert len(reply) == 6
            assert fastcrc.crc16.cms(reply[:4]) == int.from_bytes(reply[4:], "big")
        return [(reply[0], reply[1], int.from_bytes(reply[2:4], "big")) for reply in replies]

    return exchange


def test_frames_of_the_specification_move_and_measure(servo, ask, shaft):
    assert ask(servo, bytes.fromhex("DC010F809114")) == [(0x2C, 1, 0x0800)]
    shaft.advance(10.0)
    assert shaft.angle_rad() == pytest.approx(100 * DEG)
    assert ask(servo, bytes.fromhex("DC0108008014"), now_s=11.0) == [(0x2C, 1, 0x0F80)]
    ((code, _, value),) = ask(servo, bytes.fromhex("B0010000C006"), now_s=12.0)
    assert (code, value >> 8) == (0x30, pytest.approx(0.8 / 0.02, abs=5))


def test_reply_to_position_is_the_measured_angle(servo, ask, shaft):
    ask(servo, command(0xDC, 0x0800 - 192), now_s=0.0)
    ((_, _, counts),) = ask(servo, command(0xDC, 0x0800 - 192), now_s=0.1)
    assert (counts - 0x0800) / 19.2 == pytest.approx(-3.0, abs=0.05)
    shaft.advance(9.0)
    assert shaft.angle_rad() == pytest.approx(-10 * DEG)


@pytest.mark.parametrize(("argument", "degrees"), [(0xFFFF, 30.0), (0x0FFF, 30.0), (0x0000, -20.0), (0x0080, -20.0)])
def test_target_is_clipped_to_the_limits(shaft, ask, argument, degrees):
    servo = VolzEmulator(shaft, np.random.default_rng(1), limits_deg=(-20.0, 30.0))
    ask(servo, command(0xDC, argument), now_s=0.0)
    shaft.advance(60.0)
    assert shaft.angle_rad() == pytest.approx(degrees * DEG)


def test_voltage_and_temperature_replies(servo, ask):
    servo.voltage_v, servo.temperature_c = 27.0, -12.0
    ((code, _, value),) = ask(servo, command(0xB1))
    assert (code, (value >> 8) * 0.2) == (0x31, pytest.approx(27.0, abs=0.4))
    ((code, _, value),) = ask(servo, command(0xC0), now_s=2.0)
    assert (code, (value >> 8) - 50) == (0x10, -12)


@pytest.mark.parametrize("data", [bytes.fromhex("DC0108008015"), command(0xDC, 0x0F80, device_id=2), command(0x99)])
def test_invalid_commands_have_no_reply(servo, ask, shaft, data):
    assert ask(servo, data) == []
    shaft.advance(5.0)
    assert shaft.angle_rad() == 0.0


def test_commands_within_garbage_have_replies(servo, ask):
    assert len(ask(servo, b"\xdc\x01\x08" + command(0xC0) + b"\x00" + command(0xC0))) == 2


def test_exchange_takes_the_specified_time(servo, run):
    request_s = 6 * 10 / 115_200
    servo.receive(1.0 + request_s, command(0xC0))
    ((due_s, _),) = run(servo, 2.0)
    assert due_s - 1.0 == pytest.approx(1.56e-3, rel=0.01)


def test_power_cycle_releases_and_engages_at_the_present_angle(servo, ask, shaft):
    ask(servo, command(0xDC, 0x0F80), now_s=0.0)
    shaft.advance(1.0)
    servo.power_cycle(1.0, off_s=1.0)
    assert servo.next_output_s() == pytest.approx(2.3)
    assert ask(servo, command(0xC0), now_s=1.5) == []
    shaft.advance(2.5)
    assert servo.take_output(2.5) == b""
    shaft.advance(9.0)
    assert shaft.angle_rad() == pytest.approx(30 * DEG)
    assert ask(servo, command(0xDC, 0x0800), now_s=10.0) == [(0x2C, 1, 0x0800 + 576)]
