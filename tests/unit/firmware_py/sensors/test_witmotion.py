"""WitMotion sensors: packets, axes, the algorithm register, what is written to the sensor, recovery."""

import math
import struct

import numpy as np
import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.devices import decode
from firmware_py.sensors.witmotion import WitmotionCompass, WitmotionOptions
from hil.devices.witmotion import WitmotionEmulator

READ_ALGORITHM, READ_RATE = bytes.fromhex("FF AA 27 24 00"), bytes.fromhex("FF AA 27 03 00")
UNLOCK, SAVE = bytes.fromhex("FF AA 69 88 B5"), bytes.fromhex("FF AA 00 00 00")
SET_20_HZ = bytes.fromhex("FF AA 03 07 00")
# Types of packets.
ACCELERATION, ANGULAR_RATE, ANGLE, MAGNETIC_FIELD, REGISTERS = 0x51, 0x52, 0x53, 0x54, 0x5F


def packet(kind, *numbers):
    data = bytes([0x55, kind]) + struct.pack("<4h", *numbers)
    return data + bytes([sum(data) % 256])


def angle(roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0):
    return packet(ANGLE, *(round(value / 180.0 * 32768.0) for value in (roll_deg, pitch_deg, yaw_deg)), 0x46)


def reply(value, *others):
    """Return the reply to a read: the algorithm (0: nine axes, 1: six) or the code of the rate (6: 10 Hz, 7: 20 Hz)."""
    return packet(REGISTERS, value, *(*others, 0, 0, 0)[:3])


TEMPERATURE = packet(ACCELERATION, 0, 0, 2048, 2150)
TURN = packet(ANGULAR_RATE, 0, 0, -1638, 2150)  # 100 deg/s to starboard
FIELD = packet(MAGNETIC_FIELD, 200, 0, -430, 2150)
NO_FIELD = packet(MAGNETIC_FIELD, 0, 0, 0, 2150)


@pytest.fixture
def exchange(line):
    """Function that delivers packets to a driver at a time and returns its commands."""

    def exchange(driver, now_s, *packets):
        sent = len(line.written)
        line.inbox += b"".join(packets)
        driver.receive(now_s)
        return line.written[sent:]

    return exchange


@pytest.fixture
def make(line, exchange):
    """Function that makes a driver with options which knows that the sensor has nine axes."""

    def make(**options):
        compass = WitmotionCompass(line, WitmotionOptions(**options))
        assert exchange(compass, 0.0) == [READ_ALGORITHM]
        exchange(compass, 0.01, FIELD, reply(0))
        return compass

    return make


@pytest.fixture
def compass(make):
    return make()


def attitude_deg(sample):
    return [math.degrees(value) for value in (sample.heading_rad, sample.pitch_rad, sample.roll_rad)]


@pytest.mark.parametrize(
    ("sensor_deg", "boat_deg"),
    [
        # Roll is about x to the right (bow up), pitch about y ahead (starboard down), yaw about z up (to port).
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, -90.0), (90.0, 0.0, 0.0)),
        ((0.0, 0.0, 135.0), (225.0, 0.0, 0.0)),
        ((10.0, 0.0, -90.0), (90.0, 10.0, 0.0)),
        ((0.0, 10.0, -90.0), (90.0, 0.0, 10.0)),
        ((-10.0, 0.0, 30.0), (330.0, -10.0, 0.0)),
    ],
)
def test_axes_of_the_sensor(compass, exchange, sensor_deg, boat_deg):
    exchange(compass, 0.2, angle(*sensor_deg))
    (sample,) = compass.poll()
    assert attitude_deg(sample) == pytest.approx(boat_deg, abs=0.01)
    assert (sample.t_s, sample.reference, sample.variation_rad) == (0.2, NorthReference.MAGNETIC, None)


def test_text_until_the_first_angle(compass, exchange):
    exchange(compass, 0.2, FIELD)
    assert compass.health(0.2).text == "connected, no heading yet"


def test_health_before_the_first_bytes(make, line):
    health = WitmotionCompass(line, WitmotionOptions()).health(0.0)
    assert (health.state, health.accepted) == (DeviceState.STARTING, 0)


def test_heading_of_a_boat_that_pitches_and_heels_is_not_minus_yaw(compass, exchange):
    """In the sequence Z-Y-X the ahead axis y is turned by pitch and roll: by atan(tan 20 sin 20) here."""
    exchange(compass, 0.2, angle(20.0, 20.0, 0.0))
    heading_deg, _, _ = attitude_deg(compass.poll()[0])
    assert heading_deg == pytest.approx(
        math.degrees(math.atan(math.tan(math.radians(20)) * math.sin(math.radians(20)))), abs=0.02
    )


def test_scale_of_the_manual(compass, exchange):
    """Half of the range is 90 degrees and 1000 deg/s."""
    exchange(compass, 0.2, packet(ANGULAR_RATE, 0, 0, 16384, 0), packet(ANGLE, 0, 0, 16384, 0x46))
    (sample,) = compass.poll()
    assert math.degrees(sample.heading_rad) == 270.0
    assert math.degrees(sample.yaw_rate_rad_s) == pytest.approx(-1000.0)


def test_yaw_rate_and_temperature_of_the_same_cycle(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions(algorithm="nine_axis"))
    exchange(compass, 0.0, FIELD, TEMPERATURE, TURN, angle())
    (sample,) = compass.poll()
    assert math.degrees(sample.yaw_rate_rad_s) == pytest.approx(100.0, abs=0.05)
    assert sample.temperature_c == 21.5
    exchange(compass, 0.1, angle())
    assert compass.poll()[0].yaw_rate_rad_s is not None
    exchange(compass, 0.101, angle())
    assert compass.poll()[0].yaw_rate_rad_s is None


@pytest.mark.parametrize(("number", "temperature_c"), [(-4000, -40.0), (-4001, None), (8500, 85.0), (8501, None)])
def test_impossible_temperature_is_unknown(compass, exchange, number, temperature_c):
    exchange(compass, 0.2, packet(ACCELERATION, 0, 0, 2048, number), angle())
    assert compass.poll()[0].temperature_c == temperature_c


def test_headings_need_the_reply_about_the_algorithm(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions())
    exchange(compass, 0.0, FIELD, angle())
    assert compass.poll() == ()
    assert (compass.health(0.0).state, compass.health(0.0).text) == (
        DeviceState.STARTING,
        "algorithm unknown: no answer",
    )
    commands = [exchange(compass, 0.05 * step, FIELD, angle()) for step in range(1, 24)]
    # Read again after 0.5 s, after an unlock command, which some firmware may need.
    assert [command for group in commands for command in group] == [UNLOCK, READ_ALGORITHM, UNLOCK]
    exchange(compass, 1.17, reply(0), angle())
    assert compass.poll() == ()  # the reply does not belong to a request
    assert exchange(compass, 1.4, FIELD) == [READ_ALGORITHM]
    exchange(compass, 1.42, reply(0), angle())
    assert len(compass.poll()) == 1


def test_six_axes_give_no_heading_but_a_yaw_rate(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions())
    exchange(compass, 0.0)
    exchange(compass, 0.01, FIELD, reply(1), TURN, angle())
    (sample,) = compass.poll()
    assert sample.reference is NorthReference.RELATIVE
    assert math.degrees(sample.yaw_rate_rad_s) == pytest.approx(100.0, abs=0.05)
    health = compass.health(0.02)
    assert (health.state, health.text) == (DeviceState.FAULTY, "six-axis algorithm: no magnetic heading")


@pytest.mark.parametrize("value", [2, -1, 6])
def test_unknown_algorithm_is_read_again(line, exchange, value):
    compass = WitmotionCompass(line, WitmotionOptions())
    exchange(compass, 0.0)
    exchange(compass, 0.01, FIELD, reply(value), angle())
    assert compass.poll() == ()
    assert compass.health(0.01).text.startswith("algorithm")
    assert exchange(compass, 0.49) == []
    assert exchange(compass, 0.5) == [READ_ALGORITHM]


def test_algorithm_is_read_every_ten_seconds(compass, exchange):
    commands = {step / 10: exchange(compass, step / 10, FIELD, angle()) for step in range(1, 105)}
    assert [now_s for now_s, sent in commands.items() if sent] == [10.1]
    exchange(compass, 10.5, reply(1), angle())
    compass.poll()
    exchange(compass, 10.6, angle())
    assert [sample.reference for sample in compass.poll()] == [NorthReference.RELATIVE]


def test_option_nine_axis_reads_and_writes_no_register(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions(algorithm="nine_axis"))
    for step in range(300):
        exchange(compass, step / 10, FIELD, angle())
    assert line.written == []
    assert len(compass.poll()) == 300


def test_first_packet_after_the_start_is_not_used(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions(algorithm="nine_axis"))
    exchange(compass, 0.0, angle())
    assert compass.poll() == ()
    exchange(compass, 0.1, angle())
    assert len(compass.poll()) == 1
    line.unplug()
    compass.receive(0.2)
    line.plug()
    exchange(compass, 0.3, angle())
    assert compass.poll() == ()


def test_sensor_without_field_has_no_heading(compass, exchange):
    exchange(compass, 0.2, NO_FIELD, angle())
    assert compass.poll() == ()
    assert (compass.health(0.2).state, compass.health(0.2).text) == (DeviceState.FAULTY, "no magnetic field measured")
    exchange(compass, 0.3, FIELD, angle())
    assert len(compass.poll()) == 1
    assert compass.health(0.3).state is DeviceState.RUNNING


def test_default_options_never_write_a_register(compass, line, exchange):
    for step in range(600):
        for command in exchange(compass, step / 10, FIELD, angle()):
            if command == READ_ALGORITHM:
                line.inbox += reply(0)
    assert set(line.written) == {READ_ALGORITHM}
    assert len(line.written) == pytest.approx(7, abs=1)


def rate_commands(exchange, line, compass, device, seconds):
    """Run a driver with a simulated register of the rate; return the commands other than of the algorithm."""
    commands = []
    for step in range(round(seconds * 20)):
        for command in exchange(compass, 0.05 * step + 0.05, FIELD, angle()):
            if command == READ_ALGORITHM:
                line.inbox += reply(0)
                continue
            commands.append(command)
            if command == READ_RATE:
                line.inbox += reply(device["rate"])
            elif command == SET_20_HZ and device.get("accepts", True):
                device["rate"] = 7
    return commands


@pytest.mark.parametrize(
    ("options", "device", "expected"),
    [
        ({"rate_hz": 20}, {"rate": 6}, [READ_RATE, UNLOCK, SET_20_HZ, READ_RATE]),
        ({"rate_hz": 20, "save_rate": True}, {"rate": 6}, [READ_RATE, UNLOCK, SET_20_HZ, READ_RATE, UNLOCK, SAVE]),
        ({"rate_hz": 20, "save_rate": True}, {"rate": 7}, [READ_RATE]),
        ({"save_rate": True}, {"rate": 6}, []),
        (
            {"rate_hz": 20, "save_rate": True},
            {"rate": 6, "accepts": False},
            [READ_RATE, UNLOCK, SET_20_HZ, READ_RATE, UNLOCK, SET_20_HZ, READ_RATE],
        ),
    ],
)
def test_rate_is_set_if_it_differs_and_stored_if_required(make, line, exchange, options, device, expected):
    assert rate_commands(exchange, line, make(**options), device, 5.0) == expected


@pytest.mark.parametrize(("rate_hz", "code"), [(1, 3), (2, 4), (5, 5), (10, 6), (20, 7), (50, 8), (100, 9), (200, 11)])
def test_codes_of_the_rates(make, line, exchange, rate_hz, code):
    compass = make(rate_hz=rate_hz)
    assert exchange(compass, 0.2) == [READ_RATE]
    exchange(compass, 0.21, FIELD, reply(1))
    assert [exchange(compass, now_s) for now_s in (0.35, 0.5)] == [[UNLOCK], [bytes([0xFF, 0xAA, 3, code, 0])]]


def test_right_rate_is_never_written_or_stored(make, line, exchange):
    compass = make(rate_hz=20, save_rate=True)
    assert rate_commands(exchange, line, compass, {"rate": 7}, 25.0) == [READ_RATE] * 3


def test_slow_sensor_is_silent_after_three_intervals(make, exchange):
    compass = make(rate_hz=1)
    exchange(compass, 0.2, angle())
    assert compass.health(3.19).state is DeviceState.RUNNING
    assert compass.health(3.21).state is DeviceState.SILENT


def test_rejected_rate_is_reported(make, line, exchange):
    compass = make(rate_hz=20)
    rate_commands(exchange, line, compass, {"rate": 6, "accepts": False}, 3.0)
    assert (compass.health(3.0).state, compass.health(3.0).text) == (DeviceState.RUNNING, "rate of 20 Hz not accepted")
    rate_commands(lambda driver, now_s, *data: exchange(driver, now_s + 3.0, *data), line, compass, {"rate": 7}, 12.0)
    assert compass.health(15.0).text == ""


def test_rate_is_set_again_after_a_power_cut_and_stored_only_once(make, line, exchange):
    compass, device = make(rate_hz=20, save_rate=True), {"rate": 6}
    rate_commands(exchange, line, compass, device, 9.0)
    device["rate"] = 6  # the sensor was reset
    later = [
        command
        for step in range(200)
        for command in exchange(compass, 9.1 + 0.05 * step, FIELD, angle())
        if command != READ_ALGORITHM or line.inbox.extend(reply(0))
    ]
    assert later[0] == READ_RATE
    line.inbox += reply(6)
    rest = rate_commands(lambda driver, now_s, *data: exchange(driver, now_s + 19.1, *data), line, compass, device, 5.0)
    assert rest[:3] == [UNLOCK, SET_20_HZ, READ_RATE]
    assert SAVE not in rest


def test_single_packet_in_noise_is_not_used(compass, exchange):
    """The sum passes one of 256 random packets, so a packet counts only directly after another one."""
    exchange(compass, 0.2, b"\x00", angle(yaw_deg=50.0))
    assert compass.poll() == ()
    exchange(compass, 0.3, angle(yaw_deg=60.0))
    assert len(compass.poll()) == 1
    exchange(compass, 0.4, angle(yaw_deg=60.0), b"\x01", angle(yaw_deg=20.0), angle(yaw_deg=60.0))
    headings_deg = [round(math.degrees(sample.heading_rad)) for sample in compass.poll()]
    assert headings_deg == [300, 300]


@pytest.mark.parametrize(("number", "count"), [(16384, 1), (-16384, 1), (16385, 0), (-16385, 0)])
def test_pitch_of_the_sensor_is_at_most_90_degrees(compass, exchange, number, count):
    exchange(compass, 0.2, packet(ANGLE, 0, number, 0, 0x46))
    health = compass.health(0.2)
    assert health.rejected == 1 - count
    assert health.text.startswith("pitch of the sensor") is (count == 0)


def test_nearly_vertical_boat_has_no_heading(compass, exchange):
    exchange(compass, 0.2, angle(roll_deg=85.0))
    assert compass.poll() == ()
    assert compass.health(0.2).text == "attitude near vertical: check the mounting"
    exchange(compass, 0.3, angle())
    assert compass.health(0.3).state is DeviceState.RUNNING


def test_algorithm_is_read_again_after_silence_and_reopening(compass, line, exchange):
    exchange(compass, 0.2, angle())
    assert exchange(compass, 2.2) == []
    assert exchange(compass, 2.21) == [READ_ALGORITHM]
    compass.poll()
    exchange(compass, 2.4, FIELD, angle())
    assert compass.poll() == ()
    exchange(compass, 2.5, reply(0), angle())
    assert len(compass.poll()) == 1
    line.unplug()
    compass.receive(2.6)
    assert compass.health(2.6).state is DeviceState.ABSENT
    line.plug()
    assert exchange(compass, 3.0, angle(), angle()) == [READ_ALGORITHM]
    assert compass.poll() == ()


def test_full_line_is_tried_again(line, exchange):
    compass = WitmotionCompass(line, WitmotionOptions())
    line.full = True
    assert exchange(compass, 0.0) == []
    line.full = False
    assert exchange(compass, 0.51) == [READ_ALGORITHM]


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"algorithm": "six_axis"}, "algorithm: 'six_axis' is not known; use one of read, nine_axis"),
        ({"rate_hz": 15}, "rate_hz: 15 is not supported; use one of 0, 1, 2, 5, 10, 20, 50, 100, 200"),
        ({"mounting": "down"}, "mounting: 'down' is not known"),
    ],
)
def test_invalid_options_are_named(values, problem):
    with pytest.raises(ValueError, match=problem):
        WitmotionOptions(**values)


class Boat:
    def heading_rad(self):
        return math.radians(298.5)

    def yaw_rate_rad_s(self):
        return 0.2


@pytest.mark.parametrize("mounting", ["none", "yaw_135", "pitch_180", "pitch_90"])
@pytest.mark.parametrize("options", [{}, {"locks_reads": True}])
def test_driver_and_emulator_give_the_attitude_of_the_boat(line, mounting, options):
    device = WitmotionEmulator(
        Boat(), np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0, turn_noise_deg_s=0.0, mounting=mounting,
        declination_deg=10.0, **options,
    )  # fmt: skip
    device.pitch_deg, device.roll_deg = 12.0, -7.0
    compass = WitmotionCompass(line, WitmotionOptions(mounting=mounting, rate_hz=5, save_rate=True))
    samples = []
    for step in range(500):
        now_s = step / 100
        line.inbox += device.take_output(now_s)
        compass.receive(now_s)
        for data in line.written:
            device.receive(now_s, data)
        line.written.clear()
        samples += compass.poll()
    assert 20 <= len(samples) <= 32
    assert attitude_deg(samples[-1]) == pytest.approx([288.5, 12.0, -7.0], abs=0.03)
    expected_rad_s = 0.2  # the world has no rates of pitch and roll
    assert samples[-1].yaw_rate_rad_s == pytest.approx(expected_rad_s, abs=0.002)
    assert samples[-1].temperature_c == 20.0
    assert device.saves == 1


def test_capture_is_decoded():
    results = list(decode("witmotion", b"\x01" + TURN + angle(10.0, 0.0, -90.0) + FIELD + packet(0x50, 0, 0, 0, 0)))
    assert [result["type"] for result in results] == ["error", "turn_rate", "heading", "other", "other"]
    assert results[1]["z_deg_s"] == pytest.approx(-100.0, abs=0.05)
    assert results[2]["packet"] == "ANGLE"
    assert results[2]["magnetic_deg"] == pytest.approx(90.0, abs=0.01)
    assert results[2]["x_deg"] == pytest.approx(10.0, abs=0.01)
    assert results[3] == {
        "line": 4,
        "offset": 23,
        "type": "other",
        "packet": "MAGNETIC_FIELD",
        "numbers": [200, 0, -430, 2150],
    }
    assert results[4]["packet"] == "50"
