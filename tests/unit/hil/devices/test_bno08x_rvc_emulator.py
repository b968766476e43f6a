"""Emulated BNO08x in UART-RVC mode: documented frame, rate of the frames, drift, restart; read by the driver."""

import math

import numpy as np
import pytest

from firmware_py.sensors.bno08x_rvc import Bno08xRvc, Bno08xRvcOptions, create_framer, read_frame
from hil.devices.bno08x_rvc import Bno08xRvcEmulator, gravity_mg, pack_frame
from support.line import FakeLine

EXAMPLE = bytes.fromhex("AAAADE010092FF25088DFEECFFD103000000E7")
EXACT = {"drift_deg_min": 0.0, "walk_deg_sqrt_s": 0.0, "tilt_noise_deg": 0.0}


@pytest.fixture
def make(boat):
    return lambda **options: Bno08xRvcEmulator(boat, np.random.default_rng(1), **EXACT | options)


def readings(output):
    packets = create_framer().feed(b"".join(data for _, data in output))
    assert all(not packet.fault for packet in packets)
    return [read_frame(packet.data) for packet in packets]


def test_frame_of_the_data_sheet():
    assert pack_frame(222, 0.01, -1.10, 20.85, (-371, -20, 977)) == EXAMPLE


@pytest.mark.parametrize(
    ("yaw_deg", "wrapped_deg"), [(179.99, 179.99), (180.0, -180.0), (-180.01, 179.99), (725.0, 5.0)]
)
def test_yaw_is_wrapped(yaw_deg, wrapped_deg):
    assert read_frame(pack_frame(0, yaw_deg, 0.0, 0.0, (0, 0, 0))).yaw_deg == pytest.approx(wrapped_deg)


def test_gravity_has_the_axes_of_the_example():
    x_mg, y_mg, z_mg = gravity_mg(-1.10, 20.85)
    assert (x_mg, z_mg) == pytest.approx((-371, 977), abs=50)
    assert y_mg == pytest.approx(-20, abs=5)


def test_hundred_frames_a_second_with_an_index(make, run):
    output = run(make(), 3.0)
    values = readings(output)
    assert 299 <= len(values) <= 301
    assert [value.index for value in values] == [number % 256 for number in range(len(values))]
    assert output[0][0] == pytest.approx(19 * 10 / 115200)


@pytest.mark.parametrize("clockwise", [True, False])
def test_yaw_is_the_turn_since_power_on(make, run, boat, clockwise):
    emulator = make(clockwise=clockwise)
    assert readings(run(emulator, 0.5))[-1].yaw_deg == 0.0
    boat.heading += math.radians(30.0)
    sign = 1.0 if clockwise else -1.0
    assert readings(run(emulator, 1.0))[-1].yaw_deg == pytest.approx(sign * 30.0)
    emulator.power_cycle(1.0, off_s=0.5)
    output = run(emulator, 3.0)
    assert output[0][0] == pytest.approx(1.8, abs=0.01)
    values = readings(output)
    assert (values[0].index, values[0].yaw_deg) == (0, 0.0)


def test_drift(make, run):
    values = readings(run(make(drift_deg_min=6.0), 60.0))
    assert values[-1].yaw_deg == pytest.approx(6.0, abs=0.02)


def test_noise_of_the_gyroscope_grows_with_the_square_root_of_time(boat, run):
    ends_deg = [
        readings(run(Bno08xRvcEmulator(boat, np.random.default_rng(seed), drift_deg_min=0.0), 10.0))[-1].yaw_deg
        for seed in range(40)
    ]
    assert np.std(ends_deg) == pytest.approx(0.014 * math.sqrt(10.0), rel=0.4)


def test_tilt(make, run):
    emulator = make()
    emulator.pitch_deg, emulator.roll_deg = 5.0, -12.0
    value = readings(run(emulator, 0.1))[-1]
    assert (value.pitch_deg, value.roll_deg) == pytest.approx((5.0, -12.0))
    assert value.acceleration_mg == gravity_mg(5.0, -12.0)


def test_driver_measures_the_rate_and_survives_a_power_cut(make, run, boat):
    line = FakeLine()
    emulator, gyro = make(), Bno08xRvc(line, Bno08xRvcOptions())
    rates_deg_s = []
    for tick in range(100):
        now_s = 0.1 * tick
        boat.heading += math.radians(0.3)
        if tick == 50:
            emulator.power_cycle(now_s)
        emulator.receive(now_s, b"?")
        for _, data in run(emulator, now_s):
            line.inbox += data
        gyro.receive(now_s)
        rates_deg_s += [math.degrees(sample.yaw_rate_rad_s) for sample in gyro.poll()]
    assert len(rates_deg_s) > 70
    assert all(0.0 <= rate <= 6.1 for rate in rates_deg_s)  # the boat turns by steps of 0.3 degrees
