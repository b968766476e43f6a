"""The emulated WitMotion sensor against the protocol of the maker, without the driver."""

import math
import struct

import numpy as np
import pytest

from hil.devices.witmotion import WitmotionEmulator

READ_RATE, READ_ALGORITHM, UNLOCK, SAVE, SET_20_HZ = (
    bytes.fromhex(text) for text in ("FFAA270300", "FFAA272400", "FFAA6988B5", "FFAA000000", "FFAA030700")
)


def packets(data):
    """Split a stream into {type: numbers} of the last packets and check the sums."""
    found = {}
    assert len(data) % 11 == 0
    for start in range(0, len(data), 11):
        packet = data[start : start + 11]
        assert packet[0] == 0x55
        assert sum(packet[:10]) % 256 == packet[10]
        found[packet[1]] = struct.unpack("<4h", packet[2:10])
    return found


@pytest.fixture
def make(boat):
    quiet = {"noise_deg": 0.0, "tilt_noise_deg": 0.0, "turn_noise_deg_s": 0.0}
    return lambda **options: WitmotionEmulator(boat, np.random.default_rng(1), **quiet | options)


@pytest.fixture
def after():
    """Function that sends a command at a time and returns the packets of 0.09 s."""

    def after(device, now_s, data):
        device.take_output(now_s)
        device.receive(now_s, data)
        return packets(device.take_output(now_s + 0.09))

    return after


def test_factory_settings_send_four_packets_ten_times_per_second(make):
    output = make().take_output(0.99)
    assert packets(output).keys() == {0x51, 0x52, 0x53, 0x54}
    assert len(make().take_output(0.26)) == 2 * 44


def test_numbers_have_the_scale_and_axes_of_the_manual(boat, make):
    boat.heading, boat.rate = math.radians(90.0), math.radians(50.0)
    device = make()
    device.pitch_deg = 10.0
    found = packets(device.take_output(0.2))
    assert found[0x53][:3] == (round(10.0 / 180.0 * 32768.0), 0, -16384)
    assert found[0x52][2] == pytest.approx(-50.0 * math.cos(math.radians(10.0)) / 2000.0 * 32768.0, abs=1)
    assert found[0x51] == (
        0,
        round(math.sin(math.radians(10.0)) * 2048.0),
        round(math.cos(math.radians(10.0)) * 2048.0),
        2000,
    )


def test_field_of_a_level_sensor_to_the_east(boat, make):
    boat.heading = math.radians(90.0)
    assert packets(make().take_output(0.2))[0x54][:3] == (-200, 0, -430)  # north is to the left


def test_read_is_answered_with_four_registers(make, after):
    assert after(make(), 1.0, READ_RATE)[0x5F] == (6, 0, 0, 0)
    assert after(make(registers={0x24: 1}), 1.0, READ_ALGORITHM)[0x5F][0] == 1
    locked = make(locks_reads=True)
    assert 0x5F not in after(locked, 1.0, READ_RATE)
    assert 0x5F in after(locked, 1.5, UNLOCK + READ_RATE)
    assert 0x5F not in after(locked, 12.0, READ_RATE)


def test_write_needs_the_unlocking_and_is_lost_without_saving(make, after):
    device = make()
    after(device, 1.0, SET_20_HZ)
    assert after(device, 1.1, READ_RATE)[0x5F][0] == 6
    after(device, 1.2, UNLOCK + SET_20_HZ)
    assert after(device, 1.3, READ_RATE)[0x5F][0] == 7
    device.power_cycle(2.0, off_s=1.0)
    assert after(device, 4.0, READ_RATE)[0x5F][0] == 6
    after(device, 4.1, UNLOCK + SET_20_HZ + SAVE)
    device.power_cycle(5.0, off_s=1.0)
    assert after(device, 7.0, READ_RATE)[0x5F][0] == 7
    assert device.saves == 1


def test_six_axes_start_with_yaw_0_and_drift(boat, make):
    device = make(registers={0x24: 1}, drift_deg_s=0.1)
    yaw = [packets(device.take_output(now_s))[0x53][2] * 180.0 / 32768.0 for now_s in (0.2, 10.2)]
    assert yaw[0] == pytest.approx(0.0, abs=0.05)
    assert yaw[1] == pytest.approx(1.0, abs=0.05)


def test_broken_magnetometer_and_power_cut(make):
    device = make()
    device.magnetometer_works = False
    assert packets(device.take_output(0.2))[0x54][:3] == (0, 0, 0)
    device.power_cycle(1.0, off_s=math.inf)
    assert math.isinf(device.next_output_s())
    device.receive(2.0, READ_RATE)
    assert device.take_output(3.0) == b""


def test_damaged_command_does_not_block_the_next(make, after):
    assert 0x5F in after(make(), 1.0, b"\xff\x00\xaa" + READ_RATE)
