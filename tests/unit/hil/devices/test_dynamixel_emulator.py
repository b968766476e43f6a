import math

import fastcrc
import numpy as np
import pytest

from hil.devices.dynamixel import DynamixelEmulator
from hil.ship.servo import ServoShaft

DEG = math.pi / 180.0
COUNT_RAD = math.tau / 4096
PING = bytes.fromhex("FFFFFD0001030001194E")
OK, FAIL, INSTRUCTION, CRC, RANGE, LENGTH, LIMIT, ACCESS, ALERT = 0, 1, 2, 3, 4, 5, 6, 7, 0x80


def packet(instruction, parameters=b"", device_id=1):
    """Encode a packet with another CRC implementation than the emulator's."""
    body = (bytes([instruction]) + parameters).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    data = b"\xff\xff\xfd\x00" + bytes([device_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return data + fastcrc.crc16.umts(data).to_bytes(2, "little")


def statuses(data):
    """Split a stream into (id, error, parameters) and check the CRCs."""
    parsed = []
    while data:
        assert data[:4] == b"\xff\xff\xfd\x00"
        end = 7 + int.from_bytes(data[5:7], "little")
        assert fastcrc.crc16.umts(data[: end - 2]) == int.from_bytes(data[end - 2 : end], "little")
        body = data[7 : end - 2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        assert body[0] == 0x55
        parsed.append((data[4], body[1], body[2:]))
        data = data[end:]
    return parsed


class Bench:
    """A servo with its shaft and a clock."""

    def __init__(self, **options):
        self.shaft = ServoShaft(high_stop_rad=math.pi, low_stop_rad=-math.pi)
        self.servo = DynamixelEmulator(self.shaft, np.random.default_rng(1), **options)
        self.now_s = 1.0

    def wait(self, seconds):
        """Advance the clock; poll the servo at its due times and every 10 ms. Return the output."""
        end_s, output = self.now_s + seconds, b""
        while self.now_s < end_s:
            self.now_s = min(end_s, self.now_s + 0.01, max(self.now_s, self.servo.next_output_s()))
            self.shaft.advance(self.now_s)
            output += self.servo.take_output(self.now_s)
            if self.servo.next_output_s() <= self.now_s:
                output += self.servo.take_output(self.now_s)
        return output

    def send(self, data, seconds=0.02):
        self.servo.receive(self.now_s, data)
        return statuses(self.wait(seconds))

    def write(self, address, value, size):
        data = value.to_bytes(size, "little", signed=value < 0)
        ((_, error, _),) = self.send(packet(3, address.to_bytes(2, "little") + data))
        return error

    def read(self, address, size, signed=False):
        request = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        ((_, error, data),) = self.send(packet(2, request))
        return int.from_bytes(data, "little", signed=signed) if error in (OK, ALERT) else (error & 0x7F,)

    def engage(self):
        assert self.write(64, 1, 1) == OK


@pytest.fixture
def bench():
    return Bench()


def test_examples_of_the_manual_have_their_replies(bench):
    assert bench.send(bytes.fromhex("FFFFFD000109000374000002 0000CA89")) == [(1, OK, b"")]
    assert bench.read(116, 4) == 512
    assert bench.send(bytes.fromhex("FFFFFD0001070002840004001D15")) == [(1, OK, (2048).to_bytes(4, "little"))]


def test_present_registers_follow_the_motion(bench):
    bench.engage()
    assert bench.write(116, 2048 + 341, 4) == OK
    bench.wait(0.5)
    assert bench.read(122, 1) == 1
    assert bench.read(128, 4, signed=True) == pytest.approx(30 / 6 / 0.229, abs=1)
    assert bench.read(126, 2, signed=True) == pytest.approx(250 / 2.69, abs=10)
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == pytest.approx(341 * COUNT_RAD)
    assert bench.read(132, 4) == 2048 + 341
    bench.read(132, 4)
    assert bench.read(122, 1) == 0
    assert bench.read(123, 1) & 1 == 1
    assert bench.read(126, 2, signed=True) == pytest.approx(0, abs=15)


def test_position_is_rounded_to_counts(bench):
    bench.shaft.jam(0.4 * COUNT_RAD)
    assert bench.read(132, 4) == 2048
    bench.shaft.jam(-1.6 * COUNT_RAD)
    assert bench.read(132, 4) == 2046


def test_goal_without_torque_is_discarded(bench):
    assert bench.write(116, 3000, 4) == OK
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == 0.0
    bench.engage()
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == 0.0
    assert bench.read(116, 4) == 2048


def test_present_registers_are_read_in_one_block(bench):
    bench.servo.motor.temperature_c = 41.0
    bench.servo.motor.voltage_v = 12.4
    ((_, error, data),) = bench.send(packet(2, bytes([126, 0, 21, 0])))
    assert error == OK
    assert int.from_bytes(data[6:10], "little") == 2048
    assert int.from_bytes(data[18:20], "little") == pytest.approx(124, abs=1)
    assert data[20] == 41


def test_eeprom_is_locked_while_torque_is_on(bench):
    assert bench.write(9, 0, 1) == OK
    bench.engage()
    assert bench.write(9, 100, 1) == ACCESS
    assert bench.read(9, 1) == 0
    assert bench.write(64, 0, 1) == OK
    assert bench.write(9, 100, 1) == OK


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (packet(0x77), INSTRUCTION),
        (packet(5), INSTRUCTION),  # action without reg write
        (packet(3, bytes([132, 0]) + bytes(4)), ACCESS),  # read only
        (packet(3, bytes([160, 0, 1])), ACCESS),  # undefined
        (packet(3, bytes([117, 0, 1])), LENGTH),  # within a register
        (packet(3, bytes([116, 0, 0, 8])), LENGTH),  # too short
        (packet(3, bytes([116, 0])), LENGTH),
        (packet(3), LENGTH),
        (packet(3, bytes([64, 0, 2])), RANGE),
        (packet(3, bytes([11, 0, 2])), RANGE),  # no such mode
        (packet(3, bytes([98, 0, 0xFF])), RANGE),
        (packet(3, bytes([116, 0]) + (5000).to_bytes(4, "little")), LIMIT),
        (packet(3, bytes([104, 0]) + (-200).to_bytes(4, "little", signed=True)), LIMIT),
        (packet(2, bytes([132, 0, 4])), LENGTH),
        (packet(2, bytes([0, 9, 4, 0])), ACCESS),
        (packet(2, bytes([132, 0, 0xFF, 0xFF])), ACCESS),
        (packet(2, bytes([132, 0, 0, 0])), ACCESS),
        (PING[:-1] + b"\x00", CRC),
    ],
)
def test_invalid_instruction_returns_its_error(bench, message, error):
    assert bench.send(message) == [(1, error, b"")]


def test_a_block_is_written_completely_or_not_at_all(bench):
    valid = (5).to_bytes(4, "little") * 2 + (2100).to_bytes(4, "little")
    assert bench.send(packet(3, bytes([108, 0]) + valid)) == [(1, OK, b"")]
    invalid = (6).to_bytes(4, "little") * 2 + (9999).to_bytes(4, "little")
    assert bench.send(packet(3, bytes([108, 0]) + invalid)) == [(1, LIMIT, b"")]
    assert [bench.read(address, 4) for address in (108, 112, 116)] == [5, 5, 2100]


def test_position_limits_apply_in_position_mode_only(bench):
    assert bench.write(48, 2400, 4) == OK
    assert bench.write(116, 2401, 4) == LIMIT
    assert bench.write(11, 4, 1) == OK
    assert bench.write(116, 2401, 4) == OK


def test_homing_offset_and_reverse_mode_change_the_counts(bench):
    assert bench.write(20, 100, 4) == OK
    assert bench.read(132, 4) == 2148
    assert bench.write(20, 5000, 4) == OK  # invalid in position mode, so ignored
    assert bench.read(132, 4) == 2048
    assert bench.write(20, 0, 4) == OK
    assert bench.write(10, 1, 1) == OK
    bench.engage()
    bench.write(116, 2148, 4)
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == pytest.approx(-100 * COUNT_RAD)
    assert bench.read(132, 4) == 2148


def test_stuffed_bytes_are_decoded_and_encoded(bench):
    value = int.from_bytes(b"\xff\xff\xfd\xff", "little", signed=True)
    assert bench.write(20, value, 4) == OK
    bench.servo.receive(bench.now_s, packet(2, bytes([20, 0, 4, 0])))
    raw = bench.wait(0.02)
    assert b"\xff\xff\xfd\xfd\xff" in raw
    assert statuses(raw) == [(1, OK, b"\xff\xff\xfd\xff")]


def test_reg_write_waits_for_action(bench):
    bench.engage()
    assert bench.send(packet(4, bytes([116, 0]) + (2100).to_bytes(4, "little"))) == [(1, OK, b"")]
    assert bench.read(69, 1) == 1
    bench.wait(0.5)
    assert bench.shaft.angle_rad() == 0.0
    assert bench.send(packet(5)) == [(1, OK, b"")]
    bench.wait(0.5)
    assert bench.read(132, 4) == 2100
    assert bench.read(69, 1) == 0


def test_sync_write_and_sync_read_select_the_servo(bench):
    bench.engage()
    block = bytes([116, 0, 4, 0]) + bytes([2, 9, 9, 0, 0]) + bytes([1]) + (2200).to_bytes(4, "little")
    assert bench.send(packet(0x83, block, device_id=254)) == []
    bench.wait(1.0)
    read = packet(0x82, bytes([132, 0, 4, 0, 2, 1]), device_id=254)
    assert bench.send(read) == [(1, OK, (2200).to_bytes(4, "little"))]
    assert bench.send(packet(0x82, bytes([132, 0, 4, 0, 2]), device_id=254)) == []


def test_broadcasts_have_no_reply_except_ping(bench):
    assert bench.send(packet(3, bytes([64, 0, 1]), device_id=254)) == []
    assert bench.read(64, 1) == 1
    assert len(bench.send(packet(1, device_id=254))) == 1
    assert bench.send(packet(1, device_id=7)) == []


def test_status_return_level_suppresses_replies(bench):
    bench.servo.receive(bench.now_s, packet(3, bytes([68, 0, 1])))
    bench.wait(0.1)
    assert bench.send(packet(3, bytes([65, 0, 1]))) == []
    assert bench.read(65, 1) == 1
    bench.send(packet(3, bytes([68, 0, 0])))
    assert bench.send(packet(2, bytes([65, 0, 1, 0]))) == []
    assert len(bench.send(PING)) == 1


def test_bus_watchdog_stops_the_shaft_until_cleared(bench):
    bench.engage()
    assert bench.write(98, 5, 1) == OK  # 100 ms
    assert bench.write(112, 50, 4) == OK
    for _ in range(10):
        bench.write(116, 2048 + 600, 4)
        bench.wait(0.05)
    last_command_rad = bench.shaft.angle_rad()
    assert bench.wait(0.5) == b""
    stopped_rad = bench.shaft.angle_rad()
    assert stopped_rad - last_command_rad == pytest.approx(0.03 * 30 * DEG, abs=0.1 * DEG)
    assert bench.read(98, 1, signed=True) == -1
    assert bench.read(112, 4) == 0
    assert bench.write(116, 2048, 4) == RANGE
    assert bench.write(104, 1, 4) == RANGE
    assert bench.write(98, 5, 1) == RANGE
    assert bench.write(98, 0, 1) == OK
    bench.wait(5.0)  # the old goal must not count as a stall
    assert bench.shaft.angle_rad() == stopped_rad
    assert bench.write(116, 2048, 4) == OK
    bench.wait(2.0)
    assert bench.read(132, 4) == 2048


def test_bus_watchdog_is_reset_by_instructions_and_off_without_torque(bench):
    assert bench.write(98, 2, 1) == OK  # 40 ms
    bench.wait(1.0)
    assert bench.read(98, 1) == 2
    bench.engage()
    for _ in range(20):
        bench.send(packet(1, device_id=9), seconds=0.03)
    assert bench.send(packet(2, bytes([98, 0, 1, 0])), seconds=0.03) == [(1, OK, b"\x02")]


def test_shutdown_removes_torque_until_reboot(bench):
    bench.engage()
    bench.write(116, 2500, 4)
    bench.wait(0.3)
    bench.servo.inject_error(0x20)
    ((_, error, _),) = bench.send(PING)
    assert error == ALERT
    stuck_rad = bench.shaft.angle_rad()
    assert bench.read(70, 1) == 0x20
    assert bench.read(64, 1) == 0
    assert bench.write(64, 1, 1) == ALERT | FAIL
    bench.wait(1.0)
    assert bench.shaft.angle_rad() == stuck_rad > 0.0
    assert bench.send(packet(8)) == [(1, ALERT, b"")]
    assert bench.send(PING, seconds=0.3) == []
    bench.wait(0.3)
    assert bench.read(70, 1) == 0
    bench.engage()


@pytest.mark.parametrize(
    ("quantity", "value", "error", "torque"), [("voltage_v", 8.0, 0x01, 1), ("temperature_c", 81.0, 0x04, 0)]
)
def test_error_removes_the_torque_only_within_the_shutdown_mask(bench, quantity, value, error, torque):
    bench.engage()
    setattr(bench.servo.motor, quantity, value)
    assert bench.write(116, 2100, 4) == ALERT
    assert [bench.read(70, 1), bench.read(64, 1)] == [error, torque]


def test_jammed_servo_shuts_down_after_the_overload_time(bench):
    bench.engage()
    bench.shaft.jam()
    bench.write(116, 2300, 4)
    bench.wait(2.5)
    assert bench.read(126, 2, signed=True) == pytest.approx(4.9 / 0.00269, abs=20)
    assert bench.read(64, 1) == 1
    bench.wait(1.0)
    assert bench.read(70, 1) == 0x20
    assert bench.read(64, 1) == 0


def test_long_motion_is_no_overload(bench):
    bench.engage()
    bench.write(116, 4000, 4)
    bench.wait(5.0)
    bench.write(116, 100, 4)
    bench.wait(8.0)
    assert bench.read(70, 1) == 0


def test_power_cycle_resets_the_ram_area_only(bench):
    bench.write(9, 3, 1)
    bench.engage()
    bench.write(112, 77, 4)
    bench.write(116, 2300, 4)
    bench.wait(0.2)
    bench.servo.power_cycle(bench.now_s, off_s=1.0)
    assert bench.servo.next_output_s() == math.inf
    stuck_rad = bench.shaft.angle_rad()
    assert bench.send(PING, seconds=0.5) == []
    assert bench.send(PING, seconds=0.9) == []
    bench.wait(0.2)
    assert bench.shaft.angle_rad() == stuck_rad
    assert [bench.read(64, 1), bench.read(112, 4), bench.read(9, 1)] == [0, 0, 3]
    assert bench.read(116, 4) == bench.read(132, 4)


@pytest.mark.parametrize(("delay", "baud"), [(250, 57_600), (0, 1_000_000)])
def test_reply_is_complete_after_return_delay_and_transfer(delay, baud):
    bench = Bench(return_delay=delay, baud=baud)
    bench.servo.receive(1.0, PING)
    assert bench.servo.next_output_s() == pytest.approx(1.0 + delay * 2e-6 + 14 * 10 / baud)


@pytest.mark.parametrize(("transferred", "collisions", "replies"), [(0.5, 1, 0), (1.0, 0, 2)])
def test_instruction_during_a_reply_destroys_both(transferred, collisions, replies):
    """The second instruction is complete this part of its transfer time after the end of the reply."""
    bench = Bench(collisions=True)
    bench.servo.receive(1.0, PING)
    end_s = bench.servo.next_output_s()
    bench.servo.receive(end_s + transferred * 10 * 10 / 57_600, PING)
    assert bench.servo.collision_count == collisions
    bench.now_s = end_s + 0.1
    assert len(statuses(bench.wait(0.1))) == replies
    assert len(bench.send(PING)) == 1


def test_new_id_applies_to_the_next_packet(bench):
    assert bench.write(7, 5, 1) == OK
    assert bench.send(PING) == []
    assert len(bench.send(packet(1, device_id=5))) == 1


def test_packets_within_garbage_or_in_pieces_have_replies(bench):
    assert len(bench.send(b"\xff\xff\xff\xfd\x00\x01" + PING + b"\x00" + PING)) == 2
    assert bench.send(PING[:4], seconds=0.002) == []
    assert len(bench.send(PING[4:])) == 1


def test_damaged_length_does_not_hide_later_packets(bench):
    damaged = bytearray(PING)
    damaged[5] = 40
    replies = bench.send(bytes(damaged) + PING * 4)
    assert [error for _, error, _ in replies] == [CRC, OK, OK, OK, OK]


def test_seed_determines_the_measurements():
    output = [b""] * 3
    for index, seed in enumerate((1, 1, 2)):
        servo = DynamixelEmulator(ServoShaft(), np.random.default_rng(seed))
        servo.receive(1.0, packet(3, bytes([64, 0, 1])))
        for count in range(50):
            servo.receive(2.0 + count * 0.1, packet(2, bytes([126, 0, 2, 0])))
            output[index] += servo.take_output(2.05 + count * 0.1)
    assert output[0] == output[1] != output[2]
