"""The emulated RION compass against the manuals, without the driver."""

import math

import numpy as np
import pytest

from hil.devices.rion import RionEmulator

ASK, DECLINATION, AUTOMATIC, SAVE = (
    bytes.fromhex(text) for text in ("6804000408", "680400070B", "6805000C0112", "6804000A0E")
)


@pytest.fixture
def make(boat):
    return lambda **options: RionEmulator(
        boat, np.random.default_rng(1), **{"noise_deg": 0.0, "tilt_noise_deg": 0.0} | options
    )


def test_angles_are_those_of_the_manual(boat, make):
    boat.heading = math.radians(104.01)
    device = make()
    device.pitch_deg, device.roll_deg = 10.5, -10.05
    device.receive(1.0, ASK)
    assert device.take_output(1.0 + 0.010 + 14 * 10 / 9600 + 1e-9).hex().upper() == "680D0084001050101005010401" + "1C"


def test_frame_is_complete_after_its_transfer(make):
    device = make()
    device.receive(1.0, ASK)
    assert device.take_output(1.0 + 0.010 + 13.9 * 10 / 9600) == b""
    assert device.next_output_s() == pytest.approx(1.0 + 0.010 + 14 * 10 / 9600)


def test_long_frame_has_the_status(make):
    device = make(with_status=True)
    device.distorted = device.clipped = True
    device.receive(1.0, ASK)
    answer = device.take_output(2.0)
    assert (answer[1], answer[13], len(answer)) == (0x0E, 0x09, 15)


@pytest.mark.parametrize(
    ("set_deg", "answer"), [(20.8, "68060087020897"), (-3.5, "680600871035D2"), (0.0, "6806008700008D")]
)
def test_declination(make, set_deg, answer):
    device = make(set_declination_deg=set_deg)
    device.receive(1.0, DECLINATION)
    assert device.take_output(2.0).hex().upper() == answer


def test_automatic_output_at_5_hz_is_lost_with_the_power_unless_saved(make):
    device = make()
    device.receive(1.0, AUTOMATIC)
    assert device.take_output(1.05).hex().upper() == "6805008C0091"
    assert len(device.take_output(2.05)) == 5 * 14
    device.power_cycle(3.0, off_s=1.0)
    assert math.isinf(device.next_output_s())
    device.receive(4.0, ASK)  # it has not started yet
    assert device.take_output(5.0) == b""
    device.receive(5.0, AUTOMATIC + SAVE)
    device.take_output(5.1)
    device.power_cycle(6.0, off_s=1.0)
    assert len(device.take_output(8.35)) == 5 * 14


@pytest.mark.parametrize("data", [ASK[:4] + b"\x09", b"\x77" + ASK[1:], bytes.fromhex("680401 0409")])
def test_commands_of_other_devices_and_damaged_ones_are_ignored(make, data):
    device = make()
    device.receive(1.0, data)
    assert math.isinf(device.next_output_s())


def test_common_address_and_unknown_command(make):
    device = make(address=7)
    device.receive(1.0, bytes.fromhex("6804FF0407"))
    assert device.take_output(1.2)[2] == 7
    device.receive(2.0, bytes.fromhex("680407434E 6804074E59".replace(" ", "")))
    assert device.take_output(2.2).hex().upper() == "680507C3FFCE" + "680507CEFFD9"
