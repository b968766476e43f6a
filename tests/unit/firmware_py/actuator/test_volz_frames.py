"""Codec of the Volz protocol."""

import math

import pytest

from firmware_py.actuator import volz_frames as frames


def test_requests_of_the_protocol_description():
    assert frames.set_position(1, 0.0) == bytes.fromhex("DC 01 08 00 80 14")
    assert frames.set_position(1, math.radians(100.0)) == bytes.fromhex("DC 01 0F 80 91 14")
    assert frames.request(frames.READ_CURRENT, 1) == bytes.fromhex("B0 01 00 00 C0 06")


@pytest.mark.parametrize(("angle_deg", "counts"), [(-100.0, 0x0080), (-1e6, 0x0080), (1e6, 0x0F80), (45.0, 0x0B60)])
def test_counts_are_limited(angle_deg, counts):
    assert int.from_bytes(frames.set_position(3, math.radians(angle_deg))[2:4], "big") == counts


def test_replies_are_decoded_between_noise_and_echo(fakes):
    reply = fakes.volz_frame(frames.POSITION_REPLY, 1, 0x0F, 0x80)
    stream = (
        b"\x2c\x01"
        + frames.set_position(1, 0.3)
        + b"\x00\x2c"
        + reply
        + fakes.volz_frame(frames.CURRENT_REPLY, 2, 1, 1)
        + reply[:3]
    )
    parser = frames.ReplyParser(1)
    replies = [reply for byte in stream for reply in parser.feed(bytes((byte,)))]
    assert [(reply.code, math.degrees(reply.shaft_rad())) for reply in replies] == [
        (frames.POSITION_REPLY, pytest.approx(100.0))
    ]
    assert parser.pending < frames.FRAME_SIZE


def test_wrong_checksum_is_counted(fakes):
    reply = bytearray(fakes.volz_frame(frames.VOLTAGE_REPLY, 1, 140, 0))
    reply[2] ^= 1
    parser = frames.ReplyParser(1)
    assert parser.feed(bytes(reply)) == []
    assert parser.rejected == 1
    assert parser.feed(frames.set_position(1, 0.3)[:-1] + b"\0") == []  # the echo of a request does not count
    assert parser.rejected == 1


def test_values_of_replies():
    assert frames.Reply(frames.POSITION_REPLY, 0x00, 0x80).shaft_rad() == pytest.approx(math.radians(-100.0))
    assert frames.Reply(frames.POSITION_REPLY, 0x0F, 0xFF).shaft_rad() == pytest.approx(
        math.radians(100.0 * 2047 / 1920)
    )
    assert frames.Reply(frames.POSITION_REPLY, 0x10, 0x00).shaft_rad() is None
    assert frames.Reply(frames.CURRENT_REPLY, 30, 5).current_a() == pytest.approx(0.7)
    assert frames.Reply(frames.VOLTAGE_REPLY, 0, 140).voltage_v() == pytest.approx(28.0)
    assert frames.Reply(frames.VOLTAGE_REPLY, 0, 0).voltage_v() is None
    assert frames.Reply(frames.TEMPERATURE_REPLY, 75, 81).temperature_c() == 31.0
    assert frames.Reply(frames.TEMPERATURE_REPLY, 201, 0).temperature_c() is None
    assert frames.Reply(frames.TEMPERATURE_REPLY, 0, 200).temperature_c() == 150.0
