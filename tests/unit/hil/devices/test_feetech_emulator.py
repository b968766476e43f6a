"""Emulated STS3215, by the examples of the maker's protocol description and the memory table."""

import math

import numpy as np
import pytest

from hil.devices.feetech import FeetechEmulator
from hil.ship.servo import ServoShaft

COUNT_RAD = math.tau / 4096
ACK = (1, 0, b"")


def frame(code, *parameters, device_id=1):
    body = bytes((device_id, len(parameters) + 2, code, *parameters))
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))


def replies(data):
    """Split a stream into (id, status, data), and check the sums."""
    parsed = []
    while data:
        assert data[:2] == b"\xff\xff"
        end = 4 + data[3]
        assert sum(data[2:end]) % 256 == 255
        parsed.append((data[2], data[4], data[5 : end - 1]))
        data = data[end:]
    return parsed


class Bench:
    """A servo with its shaft and a clock."""

    def __init__(self, **options):
        self.shaft = ServoShaft(high_stop_rad=math.pi, low_stop_rad=-math.pi)
        self.servo = FeetechEmulator(self.shaft, np.random.default_rng(1), **options)
        self.now_s = 1.0

    def wait(self, seconds):
        """Advance the clock; poll the servo at its due times and every 10 ms. Return the output."""
        end_s, output = self.now_s + seconds, b""
        while self.now_s < end_s:
            self.now_s = min(end_s, self.now_s + 0.01, max(self.now_s, self.servo.next_output_s()))
            self.shaft.advance(self.now_s)
            output += self.servo.take_output(self.now_s)
        return output

    def send(self, data, seconds=0.02):
        self.servo.receive(self.now_s, data)
        return replies(self.wait(seconds))

    def write(self, address, *values):
        return self.send(frame(3, address, *values))

    def read(self, address, count):
        ((_, _, data),) = self.send(frame(2, address, count))
        return int.from_bytes(data, "little")

    def go_to(self, counts):
        assert self.write(40, 1, 0, *counts.to_bytes(2, "little")) == [ACK]


@pytest.fixture
def bench():
    return Bench()


def test_examples_of_the_manual(bench):
    assert bench.send(bytes.fromhex("FFFF010201FB")) == [ACK]  # ping
    assert bench.send(bytes.fromhex("FFFF0109032A00080000E803D5")) == [ACK]  # goal 2048, speed 1000
    assert (bench.read(42, 2), bench.read(44, 2), bench.read(46, 2)) == (2048, 0, 1000)
    assert bench.send(bytes.fromhex("FFFF0104023802BE")) == [(1, 0, b"\x00\x08")]  # position
    sync_write = "FFFFFE20832A06010008 0000E803020008 0000E803030008 0000E803040008 0000E80358"
    assert bench.send(bytes.fromhex(sync_write)) == []
    ((_, _, data),) = bench.send(bytes.fromhex("FFFFFE0682380801 0236"))  # sync read of position to temperature
    assert (len(data), data[:2]) == (8, b"\x00\x08")
    assert bench.send(bytes.fromhex("FFFF0109042A00080000E803D4")) == [ACK]  # registered write
    assert bench.read(64, 1) == 1
    assert bench.send(bytes.fromhex("FFFFFE0205FA")) == []  # action
    assert bench.read(64, 1) == 0


def test_sync_write_is_for_the_blocks_of_the_own_id(bench):
    bench.send(frame(0x83, 42, 2, 5, 0, 1, 1, 0, 4, 7, 0, 6, device_id=254))
    assert bench.read(42, 2) == 1024
    bench.send(frame(0x83, 42, 2, 5, 1, 1, device_id=254))
    assert bench.read(42, 2) == 1024


def test_bit_15_is_the_sign_of_a_goal(bench):
    bench.write(9, 0, 0, 0, 0)  # several turns
    bench.write(42, 100, 0x80)
    assert bench.read(67, 2) == 0x8064


def test_registered_write_waits_for_the_action(bench):
    bench.send(frame(4, 42, 0x00, 0x04))
    assert bench.read(42, 2) == 2048
    assert bench.send(frame(5)) == [ACK]
    assert bench.read(42, 2) == 1024


@pytest.mark.parametrize(
    "data",
    [frame(1)[:-1] + b"\0", frame(1, device_id=2), frame(0x77), frame(2, 0, 251), frame(2, 0), frame(3, 40), bytes(9)],
)
def test_invalid_instructions_have_no_reply(bench, data):
    assert bench.send(data) == []
    assert bench.send(frame(1)) == [ACK]


def test_instruction_within_garbage_has_a_reply(bench):
    assert bench.send(b"\xff\xff\x01\x03\x00" + frame(1) + b"\0\xff" + frame(1)) == [ACK, ACK]


def test_broadcast_has_a_reply_only_for_a_ping(bench):
    assert bench.send(frame(1, device_id=254)) == [ACK]
    assert bench.send(frame(3, 42, 0, 4, device_id=254)) == []
    assert bench.read(42, 2) == 1024
    assert bench.send(frame(2, 42, 2, device_id=254)) == []


def test_exchange_takes_the_transfer_and_the_return_delay():
    bench = Bench(baud=115_200)
    bench.servo.receive(1.0, frame(2, 40, 31))
    assert bench.servo.next_output_s() == pytest.approx(1.0 + 20e-6 + 37 * 10 / 115_200)


def test_torque_moves_the_shaft_to_the_goal(bench):
    bench.write(42, *(2389).to_bytes(2, "little"))
    bench.wait(2.0)
    assert bench.shaft.angle_rad() == 0.0
    bench.write(40, 1)
    assert bench.read(66, 1) == 1
    bench.wait(2.0)
    assert bench.shaft.angle_rad() == pytest.approx(341 * COUNT_RAD)
    assert (bench.read(56, 2), bench.read(66, 1), bench.read(67, 2)) == (2389, 0, 2389)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_goal_has_no_effect_in_other_modes(bench, mode):
    bench.write(33, mode)
    bench.go_to(2389)
    bench.wait(2.0)
    assert bench.shaft.angle_rad() == 0.0


def test_goal_is_limited(bench):
    bench.write(9, *(2000).to_bytes(2, "little"), *(2100).to_bytes(2, "little"))
    for goal, counts in ((2389, 2100), (1000, 2000)):
        bench.go_to(goal)
        bench.wait(3.0)
        assert bench.read(56, 2) == counts


def test_feedback_registers(bench):
    bench.servo.voltage_v, bench.servo.temperature_c, bench.servo.load_a = 11.1, -3.0, 0.5
    bench.go_to(2048)
    assert bench.read(62, 1) == pytest.approx(111, abs=1)
    assert bench.read(63, 1) == 253
    assert bench.read(69, 2) == pytest.approx(0.52 / 0.0065, abs=4)


def test_unlocked_values_are_kept_over_a_power_loss_and_locked_ones_are_not(bench):
    assert bench.read(55, 1) == 1
    bench.write(33, 1)
    bench.write(55, 0)
    bench.write(26, 5)
    bench.write(41, 7)
    assert (bench.read(33, 1), bench.read(26, 1), bench.read(41, 1)) == (1, 5, 7)
    bench.servo.power_cycle(bench.now_s)
    assert bench.send(frame(1), 0.5) == []
    bench.wait(1.0)
    assert (bench.read(33, 1), bench.read(26, 1), bench.read(41, 1), bench.read(55, 1)) == (0, 5, 0, 1)


def test_power_loss_releases_the_shaft(bench):
    bench.go_to(2389)
    bench.wait(0.3)
    bench.servo.power_cycle(bench.now_s, off_s=0.5)
    angle_rad = bench.shaft.angle_rad()
    bench.wait(2.0)
    assert bench.shaft.angle_rad() == angle_rad != 0.0
    assert bench.read(40, 1) == 0
    assert bench.read(42, 2) == bench.read(56, 2)


def test_servo_replies_after_the_power_loss_and_its_start(bench):
    bench.servo.power_cycle(bench.now_s, off_s=1.0)
    bench.wait(1.37)
    assert bench.send(frame(1), 0.02) == []
    bench.wait(0.02)
    assert bench.send(frame(1)) == [ACK]


def test_action_without_a_registered_write_has_no_effect(bench):
    bench.write(42, 0, 4)
    assert bench.send(frame(5)) == [ACK]
    assert (bench.read(42, 2), bench.read(64, 1)) == (1024, 0)
    bench.send(frame(4, 42, 0, 8))
    bench.send(frame(5))
    bench.write(42, 0, 4)
    bench.send(frame(5))
    assert bench.read(42, 2) == 1024


def test_response_level_0_has_replies_only_to_reads_and_pings(bench):
    assert bench.write(8, 0) == [ACK]
    assert bench.write(8, 0) == []
    assert bench.send(frame(1)) == [ACK]
    assert bench.read(8, 1) == 0
    assert bench.write(8, 1) == []
    assert bench.write(8, 1) == [ACK]


def test_new_id_and_baud_rate_apply_after_the_reply(bench):
    assert bench.write(5, 9) == [ACK]
    assert bench.send(frame(1)) == []
    assert bench.send(frame(3, 6, 4, device_id=9)) == [(9, 0, b"")]
    assert bench.servo.transmitter.baud == 115_200


def test_value_128_calibrates_the_present_position(bench):
    for counts in (2389, 1500):  # the second angle is negative
        bench.go_to(counts)
        bench.wait(3.0)
        bench.write(40, 0)
        assert bench.write(40, 128) == [ACK]
        assert (bench.read(56, 2), bench.read(40, 1)) == (2048, 0)
    offset = round(bench.shaft.angle_rad() / COUNT_RAD)
    assert bench.read(31, 2) == (offset if offset >= 0 else 0x800 - offset)
    bench.go_to(2148)
    bench.wait(3.0)
    assert bench.shaft.angle_rad() == pytest.approx((offset + 100) * COUNT_RAD)


def test_stall_becomes_an_overload_that_a_torque_write_ends(bench):
    bench.shaft.jam()
    bench.go_to(2389)
    bench.wait(1.5)
    assert bench.read(69, 2) == pytest.approx(2.7 / 0.0065, abs=4)
    assert bench.read(65, 1) == 0
    bench.wait(1.0)
    assert bench.send(frame(1)) == [(1, 32, b"")]
    assert bench.read(69, 2) == pytest.approx(0.54 / 0.0065, abs=4)
    bench.shaft.free()
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == 0.0
    bench.write(40, 1)
    bench.wait(2.0)
    assert bench.shaft.angle_rad() == pytest.approx(341 * COUNT_RAD)
    assert bench.read(65, 1) == 0


def test_overload_without_its_protection_is_no_error(bench):
    bench.write(19, 0)
    bench.shaft.jam()
    bench.go_to(2389)
    bench.wait(3.0)
    assert bench.read(65, 1) == 0


@pytest.mark.parametrize(
    ("name", "value", "status", "torque"),
    [
        ("voltage_v", 14.1, 1, 1),
        ("voltage_v", 14.0, 0, 1),
        ("voltage_v", 4.0, 0, 1),
        ("voltage_v", 3.9, 1, 1),
        ("temperature_c", 71.0, 4, 0),
        ("temperature_c", 70.0, 0, 1),
    ],
)
def test_status_and_unloading(bench, name, value, status, torque):
    bench.go_to(2048)
    setattr(bench.servo, name, value)
    assert bench.send(frame(2, 40, 1)) == [(1, status, bytes((torque,)))]
    setattr(bench.servo, name, {"voltage_v": 12.0, "temperature_c": 25.0}[name])
    assert bench.send(frame(1)) == [ACK]


def test_restart_loads_the_stored_values(bench):
    bench.write(33, 1)
    bench.go_to(2048)
    assert bench.send(frame(8)) == []
    bench.wait(1.0)
    assert (bench.read(33, 1), bench.read(40, 1)) == (0, 0)


def test_read_only_registers_keep_their_values(bench):
    bench.write(0, 9, 9, 9, 9, 9)
    bench.write(56, 1, 1)
    assert (bench.read(0, 1), bench.read(3, 2), bench.read(56, 2)) == (3, 777, 2048)


def test_instruction_during_a_reply_destroys_both():
    bench = Bench(collisions=True, baud=115_200)
    bench.servo.receive(1.0, frame(2, 0, 40))
    bench.servo.receive(1.001, frame(1))
    assert (bench.wait(0.1), bench.servo.collision_count) == (b"", 1)
    assert bench.send(frame(1)) == [ACK]


def test_energy_is_that_of_the_measured_currents(bench):
    bench.go_to(2048)
    bench.read(56, 2)
    start_j = bench.servo.energy_j
    for _ in range(10):
        bench.wait(0.98)
        bench.read(56, 2)
    assert bench.servo.energy_j - start_j == pytest.approx(10.0 * 12.0 * 0.02, rel=0.05)


@pytest.mark.parametrize("options", [{"device_id": 254}, {"device_id": -1}, {"baud": 9600}])
def test_invalid_options_are_rejected(options):
    with pytest.raises(ValueError, match="out of range"):
        Bench(**options)
