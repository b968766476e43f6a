"""The splitter finds all complete frames between arbitrary other bytes."""

import random

import pytest

from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Splitter

STALE_S = 0.5
STATUSTEXT = mavlink.MAVLINK_MSG_ID_STATUSTEXT

FALSE_START = b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00"
LONG_TEXT = b"x" * 50


@pytest.fixture
def splitter():
    return Splitter()


def make_frame(sequence=0, *, text=b"hello", v1=False):
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    sender.seq = sequence
    return mavlink.MAVLink_statustext_message(4, text).pack(sender, force_mavlink1=v1)


def sequences(frames):
    return [frame.data[4] for frame in frames]


@pytest.mark.parametrize("v1", [False, True])
@pytest.mark.parametrize("piece", [1, 2, 7, 1000])
def test_frames_in_pieces_are_complete(splitter, piece, v1):
    sent = [make_frame(number, v1=v1) for number in range(5)]
    data = b"".join(sent)
    frames = [frame for at in range(0, len(data), piece) for frame in splitter.feed(data[at : at + piece], 0.0)]
    assert [frame.data for frame in frames] == sent
    assert {frame.number for frame in frames} == {STATUSTEXT}


def test_frames_after_false_markers_are_found(splitter):
    garbage = b"\xfd\xff\x00\x00\x00\x00\x00\xfd\x00\x00" + b"\xfe\x1f\x00\x00\x00\x00"
    data = garbage + make_frame(1) + b"\xfd" + make_frame(2) + b"\xfe\xfd" + make_frame(3) + bytes(300)
    assert sequences(splitter.feed(data, 0.0)) == [1, 2, 3]


def test_damaged_frame_is_counted_and_its_neighbours_are_found(splitter):
    damaged = bytearray(make_frame(2))
    damaged[12] ^= 1
    assert sequences(splitter.feed(make_frame(1) + bytes(damaged) + make_frame(3), 0.0)) == [1, 3]
    assert splitter.rejected == 1


@pytest.mark.parametrize(
    "steps",
    [
        pytest.param([(FALSE_START, 0.0, []), (make_frame(7), STALE_S + 0.01, [7])], id="stale"),
        # A station that sends four requests per second does not prolong a false start.
        pytest.param(
            [
                (FALSE_START, 0.0, []),
                (make_frame(0), 0.25, []),
                (make_frame(1), 0.5, []),
                (make_frame(2), 0.75, [0, 1, 2]),
                (make_frame(3), 1.0, [3]),
            ],
            id="repeated_frames",
        ),
        pytest.param(
            [(FALSE_START + make_frame(7), 0.0, []), (make_frame(8), STALE_S + 0.01, [7, 8])], id="frame_behind_start"
        ),
        pytest.param(
            [
                (FALSE_START * 3 + make_frame(7) + make_frame(8)[:10], 0.0, []),
                (b"", STALE_S + 0.1, [7]),
                (make_frame(8)[10:], STALE_S + 0.2, [8]),
            ],
            id="several_starts",
        ),
    ],
)
def test_false_start_hides_later_frames_only_until_it_is_stale(splitter, steps):
    assert [sequences(splitter.feed(data, now_s)) for data, now_s, _ in steps] == [expected for *_, expected in steps]


def test_frame_on_a_slow_line_may_take_its_transmission_time():
    data = make_frame(1, text=LONG_TEXT)
    splitter = Splitter(byte_rate=30.0)
    frames = [frame for index, byte in enumerate(data) for frame in splitter.feed(bytes((byte,)), index / 30.0)]
    assert [frame.data for frame in frames] == [data]


@pytest.mark.parametrize("gap_s", [0.2, STALE_S + 0.1, 5.0])
def test_modem_may_deliver_the_parts_of_a_frame_seconds_apart(gap_s):
    data = make_frame(1, text=LONG_TEXT)
    splitter = Splitter(byte_rate=5760.0)
    frames = [frame for part in range(4) for frame in splitter.feed(data[part * 20 : part * 20 + 20], part * gap_s / 3)]
    assert [frame.data for frame in frames] == [data]


def test_late_end_of_a_frame_may_be_followed_by_the_start_of_the_next(splitter):
    first, second = make_frame(1), make_frame(2)
    assert splitter.feed(first[:10], 0.0) == []
    assert sequences(splitter.feed(first[10:] + second[:10], 9.0)) == [1]
    assert splitter.feed(b"", 18.9) == []  # the age counts from the start of the second
    assert sequences(splitter.feed(second[10:], 18.9)) == [2]


@pytest.mark.parametrize(("byte_rate", "late_s"), [(None, 10.0), (57.6, 10.0), (30.0, 18.66)])
def test_incomplete_frame_is_dropped_when_it_is_late(byte_rate, late_s):
    """On a slow line that is twice the time of the longest frame."""
    for age_s, expected in ((late_s, [1]), (late_s + 0.01, [])):
        splitter = Splitter(byte_rate)
        splitter.feed(make_frame(1)[:-1], 0.0)
        assert splitter.feed(b"", age_s) == []
        assert sequences(splitter.feed(make_frame(1)[-1:], age_s)) == expected


def test_signed_frames_are_accepted_and_unknown_messages_ignored(splitter):
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    sender.signing.secret_key = b"k" * 32
    sender.signing.sign_outgoing = True
    signed = mavlink.MAVLink_statustext_message(4, b"hello").pack(sender)
    unknown = b"\xfd\x02\x00\x00\x00\x01\x01\xff\xff\x00ab\x00\x00"
    assert [frame.data for frame in splitter.feed(signed + unknown + make_frame(9), 0.0)] == [signed, make_frame(9)]


def test_noise_uses_no_memory_and_hides_no_frame(splitter):
    rng = random.Random(3)
    count = 0
    for number in range(1000):
        data = rng.randbytes(1000) + make_frame(number % 256)
        count += sum(frame.number == STATUSTEXT for frame in splitter.feed(data, number * 1e-3))
        assert len(splitter._buffer) < 300
    # The last noise may end with a false start.
    count += sum(frame.number == STATUSTEXT for frame in splitter.feed(b"", 1e3))
    assert count == 1000
