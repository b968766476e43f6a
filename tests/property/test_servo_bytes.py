"""No bytes from a servo's line can harm its driver, and no damaged frame is believed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator import dynamixel_frames, volz_frames
from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceHealth, RudderCommand
from support.line import FakeLine

LARGEST_LENGTH = 64

STATUS = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x00" + bytes(range(21)))
STUFFED = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x80\xff\xff\xfd\x00\x01")
SHORT = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x00")
POSITION = volz_frames.request(volz_frames.POSITION_REPLY, 1, 0x0812)

# Noise with the beginnings of real frames in it, which plain random bytes hardly ever have.
PIECES = st.sampled_from(
    [STATUS, STUFFED, SHORT, POSITION, STATUS[:9], STATUS[5:], b"\xff\xff\xfd\x00\x01\x30\x00\x55"]
)
NOISE = st.lists(PIECES | st.binary(max_size=12), max_size=12).map(b"".join)

PARSERS = {
    "dynamixel": (lambda: dynamixel_frames.StatusParser(LARGEST_LENGTH), STATUS, 7 + LARGEST_LENGTH),
    "volz": (lambda: volz_frames.ReplyParser(1), POSITION, volz_frames.FRAME_SIZE),
}


@pytest.fixture(params=list(PARSERS), scope="module")
def codec(request):
    """A parser's maker, a good frame and the bound of its buffer."""
    return PARSERS[request.param]


@given(st.lists(NOISE | st.binary(max_size=5000), max_size=6))
def test_parsers_take_anything_and_keep_little(codec, chunks):
    make, _, bound = codec
    parser = make()
    for chunk in chunks:
        parser.feed(chunk)
        assert parser.pending < bound


@given(NOISE)
def test_a_good_frame_after_any_noise_is_found_at_once(codec, noise):
    make, frame, _ = codec
    parser = make()
    parser.feed(noise)
    assert len(parser.feed(frame)) >= 1


@given(NOISE, st.integers(1, 7))
def test_how_the_bytes_are_cut_does_not_matter(codec, noise, piece):
    make, frame, _ = codec
    stream = noise + frame
    whole, cut = make(), make()
    found = [packet for start in range(0, len(stream), piece) for packet in cut.feed(stream[start : start + piece])]
    assert found == whole.feed(stream)
    assert cut.rejected == whole.rejected


@pytest.mark.parametrize("frame", [STATUS, STUFFED, SHORT], ids=["telemetry", "stuffed", "short"])
def test_no_single_bit_flip_is_believed_dynamixel(frame):
    assert len(dynamixel_frames.StatusParser().feed(frame)) == 1
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        assert dynamixel_frames.StatusParser().feed(bytes(damaged)) == [], bit


@given(st.integers(0, 0xFFFF), st.sampled_from(sorted(volz_frames.REPLY_OF.values())), st.integers(0, 47))
def test_no_single_bit_flip_is_believed_volz(argument, code, bit):
    frame = volz_frames.request(code, 1, argument)
    assert len(volz_frames.ReplyParser(1).feed(frame)) == 1
    damaged = bytearray(frame)
    damaged[bit // 8] ^= 1 << bit % 8
    assert volz_frames.ReplyParser(1).feed(bytes(damaged)) == []


ANGLES = st.floats() | st.floats(-2.0, 2.0)
STEPS = st.lists(st.tuples(NOISE, ANGLES, st.booleans(), st.floats(0.0, 0.6)), max_size=40)


DRIVERS = {
    "dynamixel": lambda line: dynamixel_rudder(line, DynamixelOptions()),
    "volz": lambda line: volz_rudder(line, VolzOptions()),
}


@pytest.mark.parametrize("driver", DRIVERS)
@given(STEPS, st.booleans())
def test_drivers_survive_anything(driver, steps, takes):
    line = FakeLine()
    line.full = not takes
    rudder = DRIVERS[driver](line)
    now_s = 0.0
    for noise, angle_rad, torque_on, step_s in steps:
        now_s += step_s
        line.inbox += noise
        before = len(line.written)
        rudder.receive(now_s)
        rudder.command(RudderCommand(angle_rad, torque_on), now_s)
        rudder.receive(now_s)
        assert len(line.written) - before <= 3
        assert all(len(frame) <= 32 for frame in line.written[before:])
        feedback = rudder.poll()
        assert len(feedback) <= 8
        for record in feedback:
            values = (record.shaft_rad, record.voltage_v, record.current_a, record.temperature_c)
            assert all(value is None or math.isfinite(value) for value in values)
        assert isinstance(rudder.health(now_s), DeviceHealth)
