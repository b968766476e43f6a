"""BNO08x in UART-RVC mode: frames, yaw rate from successive frames, lost frames, restarts."""

import math
import struct
import sys
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.records import DeviceRole, DeviceState, NorthReference
from firmware_py.devices import decode
from firmware_py.sensors.bno08x_rvc import Bno08xRvc, Bno08xRvcOptions, create_framer, read_frame
from firmware_py.sensors.message_error import MessageError

# The example of the data sheet.
EXAMPLE = bytes.fromhex("AAAA DE 0100 92FF 2508 8DFE ECFF D103 000000 E7".replace(" ", ""))
INT16 = st.integers(-32768, 32767)


def frame(index, yaw_deg=0.0, pitch_deg=0.0, roll_deg=0.0, reserved=bytes(3)):
    content = struct.pack(
        "<Bhhhhhh", index % 256, *(round(100 * x) for x in (yaw_deg, pitch_deg, roll_deg)), 0, 0, 1000
    )
    content += reserved
    return b"\xaa\xaa" + content + bytes([sum(content) & 0xFF])


def frames(first, yaws_deg):
    return [frame(first + number, yaw_deg) for number, yaw_deg in enumerate(yaws_deg)]


@pytest.fixture
def gyro(line):
    return Bno08xRvc(line, Bno08xRvcOptions(rate_hz=100.0))


@pytest.fixture
def send(line, gyro):
    """Function that delivers frames at 100 Hz from a time and returns the samples."""

    def send(data, begin_s=1.0):
        samples = []
        for number, item in enumerate(data):
            line.inbox += item
            gyro.receive(begin_s + 0.01 * number)
            samples += gyro.poll()
        return samples

    return send


def rates_deg_s(samples):
    return [math.degrees(sample.yaw_rate_rad_s) for sample in samples]


def test_example_of_the_data_sheet():
    (packet,) = create_framer().feed(EXAMPLE)
    reading = read_frame(packet.data)
    assert reading.index == 222
    assert (reading.yaw_deg, reading.pitch_deg, reading.roll_deg) == pytest.approx((0.01, -1.10, 20.85))
    assert reading.acceleration_mg == (-371, -20, 977)


def test_capture_of_the_example():
    (result, error) = decode("bno08x_rvc", EXAMPLE + EXAMPLE[:-1] + b"\x00")
    assert result == {
        "line": 1, "offset": 0, "type": "attitude", "reference": "relative", "index": 222, "yaw_deg": 0.01,
        "pitch_deg": -1.1, "roll_deg": 20.85, "acceleration_x_mg": -371, "acceleration_y_mg": -20,
        "acceleration_z_mg": 977,
    }  # fmt: skip
    assert error == {"line": 2, "offset": 19, "type": "error", "error": "checksum", "bytes": 19}


@pytest.fixture(scope="module")
def adafruit():
    """The library of a vendor, without its dependency on a board: pip install --no-deps (pyproject.toml)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "busio", SimpleNamespace(UART=object))
        return pytest.importorskip("adafruit_bno08x_rvc")


@given(index=st.integers(0, 255), numbers=st.tuples(*[INT16] * 6), reserved=st.binary(min_size=3, max_size=3))
def test_values_agree_with_the_library_of_a_vendor(adafruit, index, numbers, reserved):
    content = bytes([index]) + struct.pack("<6h", *numbers) + reserved
    data = content + bytes([sum(content) & 0xFF])
    expected = adafruit.BNO08x_RVC._parse_frame(data)
    try:
        reading = read_frame(b"\xaa\xaa" + data)
    except MessageError:
        assert abs(numbers[0]) > 18000 or abs(numbers[1]) > 9000 or abs(numbers[2]) > 18000
        return
    assert (reading.yaw_deg, reading.pitch_deg, reading.roll_deg) == pytest.approx(expected[:3])
    assert [0.0098067 * number for number in reading.acceleration_mg] == pytest.approx(expected[3:], rel=1e-4)


@pytest.mark.parametrize(
    ("angles", "name"),
    [((180.01, 0, 0), "yaw"), ((-180.01, 0, 0), "yaw"), ((0, 90.01, 0), "pitch"), ((0, -90.01, 0), "pitch"),
     ((0, 0, 180.01), "roll"), ((0, 0, -180.01), "roll")],
)  # fmt: skip
def test_impossible_angles_are_rejected(send, gyro, angles, name):
    assert send([frame(number, *angles) for number in range(10)]) == []
    health = gyro.health(1.1)
    assert (health.accepted, health.rejected) == (0, 10)
    assert health.text.startswith(f"{name} ")


@pytest.mark.parametrize("angles", [(180.0, 80.0, 180.0), (-180.0, -80.0, -180.0)])
def test_angles_at_the_limits_are_accepted(send, angles):
    samples = send([frame(number, *angles) for number in range(6)])
    assert rates_deg_s(samples) == pytest.approx([0.0])


@pytest.mark.parametrize("clockwise", [True, False])
def test_rate_is_the_turn_over_five_frames(line, deliver, clockwise):
    gyro = Bno08xRvc(line, Bno08xRvcOptions(rate_hz=100.0, clockwise=clockwise))
    (sample,) = deliver(gyro, b"".join(frames(7, [0.0, 0.1, 0.3, 0.5, 0.7, 1.0])), now_s=2.0)
    sign = 1.0 if clockwise else -1.0
    assert (sample.t_s, sample.reference, sample.source) == (2.0, NorthReference.RELATIVE, 0)
    assert math.degrees(sample.yaw_rate_rad_s) == pytest.approx(sign * 20.0)
    assert math.degrees(sample.heading_rad) == pytest.approx(1.0 if clockwise else 359.0)
    assert (sample.roll_rad, sample.pitch_rad, sample.variation_rad) == (None, None, None)


def test_rate_is_right_where_yaw_wraps_at_180_deg_and_the_index_at_255(send):
    samples = send(frames(250, [179.0, 179.5, -180.0, -179.5, -179.0, -178.5, -178.0, -177.5]))
    assert rates_deg_s(samples) == pytest.approx([50.0] * 3)


@pytest.mark.parametrize(
    ("rate_hz", "sizes", "count"),
    [
        (100.0, [1] * 100, 95),
        (50.0, [1] * 101, 48),
        (10.0, [1] * 1000, 100),
        (10.0, [10] * 10, 10),
        (10.0, [10, 9, 11, 8, 10], 5),  # frames that arrive before each tick
        (10.0, [10, 7, 10, 7, 10], 4),
        (5.0, [10] * 10, 5),
        (1.0, [10] * 20, 3),
    ],
)
def test_number_of_samples_by_the_option_and_the_frames_of_a_tick(line, deliver, rate_hz, sizes, count):
    gyro, number, samples = Bno08xRvc(line, Bno08xRvcOptions(rate_hz=rate_hz)), 0, []
    for size in sizes:
        samples += deliver(gyro, b"".join(frames(number, [0.0] * size)), now_s=0.01 * (number + size))
        number += size
    assert len(samples) == count


def test_rate_is_that_of_the_newest_frames(line, deliver):
    gyro = Bno08xRvc(line, Bno08xRvcOptions())
    (sample,) = deliver(gyro, b"".join(frames(0, [0.0] * 15 + [0.1, 0.2, 0.3, 0.4, 0.5])))
    assert rates_deg_s([sample]) == pytest.approx([10.0])
    assert deliver(gyro, b"", now_s=1.2) == ()


@pytest.mark.parametrize("lost", [1, 2])
def test_lost_frames_are_counted_and_do_not_change_the_rate(send, gyro, lost):
    data = frames(0, [0.3 * number for number in range(14 + lost)])
    samples = send(data[:6] + data[6 + lost :])
    assert rates_deg_s(samples) == pytest.approx([30.0] * 9)
    health = gyro.health(1.2)
    assert (health.rejected, health.text) == (lost, f"lost frames: {lost}")


@pytest.mark.parametrize(("lost", "is_continued"), [(10, True), (11, False)])
def test_measurement_starts_again_after_more_than_ten_lost_frames(send, gyro, lost, is_continued):
    data = frames(0, [0.1 * number for number in range(30)])
    samples = send(data[:6] + data[6 + lost : 7 + lost])
    assert len(samples) == (2 if is_continued else 1)
    assert gyro.health(1.1).text == (
        "lost frames: 10" if is_continued else "restarted, or frames lost: yaw rate starts again"
    )


@pytest.mark.parametrize(("pause_s", "count"), [(0.25, 7), (0.26, 2)])
def test_measurement_starts_again_after_a_pause_on_the_line(send, gyro, pause_s, count):
    samples = send(frames(0, [0.0] * 6))
    gyro.receive(1.05 + pause_s)
    samples += send(frames(6, [0.0] * 6), begin_s=3.0)
    assert len(samples) == count


def test_frames_that_wait_during_a_pause_of_the_program_are_used(line, gyro):
    line.inbox += b"".join(frames(0, [0.2 * number for number in range(100)]))
    gyro.receive(5.0)
    assert rates_deg_s(gyro.poll()) == pytest.approx([20.0])


@pytest.mark.parametrize("index", [0, 106])
@pytest.mark.parametrize("yaw_deg", [90.0, -179.0])
def test_restart_of_the_device_makes_no_spike(send, gyro, index, yaw_deg):
    """Yaw begins at 0; the index begins at 0, or by chance continues."""
    before = send(frames(100, [yaw_deg] * 6))
    after = send(frames(index, [0.0] * 20), begin_s=1.06)
    assert rates_deg_s(before + after) == pytest.approx([0.0] * 16)
    turned_deg = [math.degrees(math.remainder(sample.heading_rad, math.tau)) for sample in before + after]
    assert turned_deg == pytest.approx([0.0] * 16)
    assert gyro.health(1.3).text == "restarted, or frames lost: yaw rate starts again"


@pytest.mark.parametrize(("step_deg", "count"), [(1.49, 5), (1.51, 0)])
def test_turn_that_no_boat_makes_is_no_rate(send, step_deg, count):
    assert len(send(frames(0, [step_deg * number for number in range(10)]))) == count


@pytest.mark.parametrize("step_deg", [0.0, 0.1])
def test_repeated_index_starts_the_measurement_again(send, gyro, step_deg):
    assert send([frame(5, step_deg * number) for number in range(20)]) == []
    assert gyro.health(1.2).rejected == 19


def test_nearly_vertical_device_gives_no_rate(send, gyro):
    assert send([frame(number, 0.0, -80.1) for number in range(10)]) == []
    health = gyro.health(1.1)
    assert (health.state, health.text) == (DeviceState.RUNNING, "nearly vertical: no yaw rate")
    assert len(send([frame(10 + number, 50.0, 79.9) for number in range(6)], begin_s=1.1)) == 1
    assert gyro.health(1.2).text == "gyro only, no north: used as yaw rate"


def test_rate_contains_no_turn_from_before_a_restart(send):
    data = frames(0, [0.2 * number for number in range(17)])
    before = send(data[:6] + data[16:])
    after = send(frames(100, [40.0] * 7), begin_s=1.06)
    assert rates_deg_s(before) == pytest.approx([20.0] * 2)
    assert rates_deg_s(after) == pytest.approx([0.0] * 2)


def test_measurement_starts_again_after_a_vertical_position(send):
    flat, vertical = frames(0, [0.0] * 6), [frame(number, 0.0, 85.0) for number in (6, 7)]
    assert len(send(flat + vertical + frames(8, [0.5] * 6))) == 2


def test_health_says_that_there_is_no_north(send, gyro):
    assert gyro.health(0.0).state is DeviceState.STARTING
    send(frames(0, [0.0] * 3))
    health = gyro.health(1.1)
    assert (health.role, health.state) == (DeviceRole.COMPASS, DeviceState.RUNNING)
    assert (health.accepted, health.rejected, health.text) == (3, 0, "gyro only, no north: used as yaw rate")
    assert gyro.health(4.0).state is DeviceState.SILENT


def test_reopened_port_starts_the_measurement_again(line, send, gyro):
    send(frames(0, [0.0] * 6))
    line.unplug()
    gyro.receive(1.1)
    assert gyro.health(1.1).state is DeviceState.ABSENT
    line.plug()
    assert len(send(frames(6, [1.0] * 6), begin_s=1.12)) == 1
    assert gyro.health(1.2).rejected == 0


def test_wrong_baud_rate_is_named(line, gyro):
    line.inbox += bytes([0x7F, 0x00, 0xE6]) * 200
    gyro.receive(1.0)
    assert gyro.health(1.0).text == "data not understood: wrong baud rate?"


def test_frames_between_foreign_bytes(send, gyro):
    data = frames(0, [0.5 * number for number in range(8)])
    noisy = [b"\xaa\xaa\xaa" + item + b"$GPHDT,,*4F\r\n\xaa" for item in data]
    samples = send(noisy)
    assert rates_deg_s(samples) == pytest.approx([50.0] * 3)
    assert gyro.health(1.1).accepted == 8


def test_reserved_bytes_may_have_any_value(send):
    assert len(send([frame(number, reserved=b"\x03\x01\xff") for number in range(6)])) == 1


@given(position=st.integers(0, 18), change=st.integers(1, 255))
def test_one_damaged_byte_is_always_detected(position, change):
    damaged = bytearray(EXAMPLE)
    damaged[position] ^= change
    framer = create_framer()
    packets = framer.feed(bytes(damaged)) + framer.finish()
    assert all(packet.fault for packet in packets)
