"""Servo drivers accept any bytes from the line, and reject damaged frames."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.actuator import dynamixel_frames, feetech_protocol, volz_frames
from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.actuator.maestro import MaestroOptions, maestro_rudder
from firmware_py.actuator.pulse import PulseOptions, PulseScale
from firmware_py.actuator.pwm import PwmServo
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceHealth, RudderCommand
from support.line import FakeLine

MAX_LENGTH = 64

STATUS_PACKET = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x00" + bytes(range(21)))
STUFFED = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x80\xff\xff\xfd\x00\x01")
SHORT_PACKET = dynamixel_frames.instruction(1, dynamixel_frames.STATUS, b"\x00")
POSITION_REPLY = volz_frames.request(volz_frames.POSITION_REPLY, 1, 0x0812)
STATE = bytes((1, 0, 0x55, 9)) + bytes(11) + bytes((1, 0x55, 9, 0, 0, 0, 0, 121, 31)) + bytes(7)
STATE_REPLY = feetech_protocol.instruction(1, 0, *STATE)

# Noise with parts of real frames, which reach more states of the parsers than random bytes alone.
PIECES = st.sampled_from(
    [
        STATUS_PACKET,
        STUFFED,
        SHORT_PACKET,
        POSITION_REPLY,
        STATE_REPLY,
        STATE_REPLY[:9],
        STATE_REPLY[5:],
        STATUS_PACKET[:9],
        STATUS_PACKET[5:],
        b"\xff\xff\xfd\x00\x01\x30\x00\x55",
    ]
)
NOISE = st.lists(PIECES | st.binary(max_size=12), max_size=12).map(b"".join)

PARSERS = {
    "dynamixel": (lambda: dynamixel_frames.StatusParser(MAX_LENGTH), STATUS_PACKET, 7 + MAX_LENGTH),
    "volz": (lambda: volz_frames.ReplyParser(1), POSITION_REPLY, volz_frames.FRAME_SIZE),
    "feetech": (lambda: feetech_protocol.ReplyParser(1), STATE_REPLY, 52),
}


@pytest.fixture(params=list(PARSERS), scope="module")
def parser_case(request):
    """A function that makes a parser, a valid frame, and the limit of the buffer."""
    return PARSERS[request.param]


@given(st.lists(NOISE | st.binary(max_size=5000), max_size=6))
def test_parsers_accept_any_bytes_with_a_bounded_buffer(parser_case, chunks):
    make, _, max_buffer = parser_case
    parser = make()
    for chunk in chunks:
        parser.feed(chunk)
        assert parser.pending < max_buffer


@given(NOISE)
def test_valid_frame_after_noise_is_decoded(parser_case, noise):
    make, frame, _ = parser_case
    parser = make()
    parser.feed(noise)
    assert len(parser.feed(frame)) >= 1


@given(NOISE, st.integers(1, 7))
def test_parsing_does_not_depend_on_the_pieces(parser_case, noise, size):
    make, frame, _ = parser_case
    stream = noise + frame
    undivided, divided = make(), make()
    packets = [packet for start in range(0, len(stream), size) for packet in divided.feed(stream[start : start + size])]
    assert packets == undivided.feed(stream)
    assert divided.rejected == undivided.rejected


@pytest.mark.parametrize("frame", [STATUS_PACKET, STUFFED, SHORT_PACKET], ids=["telemetry", "stuffed", "short"])
def test_single_bit_flip_is_rejected_dynamixel(frame):
    assert len(dynamixel_frames.StatusParser().feed(frame)) == 1
    for bit in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        assert dynamixel_frames.StatusParser().feed(bytes(damaged)) == [], bit


@given(st.integers(0, 0xFFFF), st.sampled_from(sorted(volz_frames.REPLY_CODES_BY_REQUEST.values())), st.integers(0, 47))
def test_single_bit_flip_is_rejected_volz(argument, code, bit):
    frame = volz_frames.request(code, 1, argument)
    assert len(volz_frames.ReplyParser(1).feed(frame)) == 1
    damaged = bytearray(frame)
    damaged[bit // 8] ^= 1 << bit % 8
    assert volz_frames.ReplyParser(1).feed(bytes(damaged)) == []


@given(st.integers(0, 4095), st.integers(0), st.integers(1, 255), st.integers(0, 4095))
def test_one_damaged_byte_never_gives_a_wrong_angle_feetech(position, place, change, next_position):
    """The sum detects every damage to one byte, but only 255 of 256 damages to two bytes."""
    frames = [feetech_state_reply(counts) for counts in (position, next_position)]
    frames[0][place % len(frames[0])] ^= change
    replies = feetech_protocol.ReplyParser(1).feed(bytes(frames[0] + frames[1]))
    assert [feetech_protocol.decode_state(reply.data).shaft_rad for reply in replies] == [
        (next_position - 2048) * math.tau / 4096
    ]


@given(st.integers(0, 4095), st.integers(0, 36))
def test_lost_byte_never_gives_a_wrong_angle_feetech(position, place):
    """The driver clears the parser before the next request, so the reply remains unfinished."""
    frame = feetech_state_reply(position)
    del frame[place]
    assert feetech_protocol.ReplyParser(1).feed(bytes(frame)) == []


def feetech_state_reply(position):
    data = bytearray(STATE)
    data[16:18] = position.to_bytes(2, "little")
    return bytearray(feetech_protocol.instruction(1, 0, *data))


ANGLES = st.floats() | st.floats(-2.0, 2.0)
STEPS = st.lists(st.tuples(NOISE, ANGLES, st.booleans(), st.floats(0.0, 0.6)), max_size=40)


DRIVERS = {
    "dynamixel": lambda line: dynamixel_rudder(line, DynamixelOptions()),
    "volz": lambda line: volz_rudder(line, VolzOptions()),
    "feetech": lambda line: feetech_rudder(line, FeetechOptions()),
    "maestro": lambda line: maestro_rudder(line, MaestroOptions(crc=True)),
    "pwm": lambda line: PwmServo(line, PulseOptions()),
}


@pytest.mark.parametrize("driver", DRIVERS)
@given(STEPS, st.booleans())
def test_drivers_accept_any_bytes_and_commands(driver, steps, line_accepts):
    line = FakeLine()
    line.full = not line_accepts
    rudder = DRIVERS[driver](line)
    now_s = 0.0
    for noise, angle_rad, torque_on, step_s in steps:
        now_s += step_s
        line.inbox += noise
        frame_count = len(line.written)
        rudder.receive(now_s)
        rudder.command(RudderCommand(angle_rad, torque_on), now_s)
        rudder.receive(now_s)
        assert len(line.written) - frame_count <= 3
        assert all(len(frame) <= 32 for frame in line.written[frame_count:])
        feedback = rudder.poll()
        assert len(feedback) <= 8
        for record in feedback:
            values = (record.shaft_rad, record.voltage_v, record.current_a, record.temperature_c)
            assert all(value is None or math.isfinite(value) for value in values)
        assert isinstance(rudder.health(now_s), DeviceHealth)


@pytest.mark.parametrize("driver", ["maestro", "pwm"])
@given(STEPS)
def test_hobby_servo_never_reports_an_angle(driver, steps):
    line = FakeLine()
    rudder = DRIVERS[driver](line)
    now_s = 0.0
    for noise, angle_rad, torque_on, step_s in steps:
        now_s += step_s
        line.inbox += noise
        rudder.command(RudderCommand(angle_rad, torque_on), now_s)
        rudder.receive(now_s)
        assert all(record.shaft_rad is None for record in rudder.poll())


@given(st.floats(-10.0, 10.0), st.floats(450.0, 2550.0), st.floats(50.0, 5000.0))
def test_pulse_widths_are_within_the_limits_and_increase_with_the_angle(angle_rad, centre_us, us_per_rad):
    scale = PulseScale.of(PulseOptions(centre_us=centre_us, us_per_rad=us_per_rad, min_us=450.0, max_us=2550.0))
    assert 450.0 <= scale.pulse_us(angle_rad) <= 2550.0
    assert scale.pulse_us(angle_rad) <= scale.pulse_us(angle_rad + 0.1)
