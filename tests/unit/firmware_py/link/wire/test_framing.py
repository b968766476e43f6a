"""The splitter finds every whole frame, whatever is around it."""

import random

import pytest

from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import LATE_S, STALE_S, Splitter


def frame(sequence=0, *, text=b"hello", v1=False):
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    sender.seq = sequence
    return mavlink.MAVLink_statustext_message(4, text).pack(sender, force_mavlink1=v1)


@pytest.mark.parametrize("v1", [False, True])
@pytest.mark.parametrize("piece", [1, 2, 7, 1000])
def test_frames_in_pieces_come_out_whole(piece, v1):
    sent = [frame(number, v1=v1) for number in range(5)]
    data = b"".join(sent)
    splitter = Splitter()
    found = [f for at in range(0, len(data), piece) for f in splitter.feed(data[at : at + piece], 0.0)]
    assert [f.data for f in found] == sent
    assert {f.number for f in found} == {253}


def test_frames_right_after_false_markers_are_not_swallowed():
    false = b"\xfd\xff\x00\x00\x00\x00\x00\xfd\x00\x00" + b"\xfe\x1f\x00\x00\x00\x00"
    data = false + frame(1) + b"\xfd" + frame(2) + b"\xfe\xfd" + frame(3) + bytes(300)
    assert [f.data[4] for f in Splitter().feed(data, 0.0)] == [1, 2, 3]


def test_a_frame_with_one_wrong_byte_is_counted_and_its_neighbours_live():
    broken = bytearray(frame(2))
    broken[12] ^= 1
    splitter = Splitter()
    assert [f.data[4] for f in splitter.feed(frame(1) + bytes(broken) + frame(3), 0.0)] == [1, 3]
    assert splitter.rejected == 1


def test_the_rest_of_a_frame_that_does_not_come_is_not_waited_for():
    splitter = Splitter()
    assert splitter.feed(b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00", 0.0) == []
    assert [f.data[4] for f in splitter.feed(frame(7), STALE_S + 0.1)] == [7]


def test_a_false_beginning_is_not_kept_alive_by_the_frames_that_come_after_it():
    """A station that asks four times a second must not have to fill 280 bytes first."""
    splitter = Splitter()
    assert splitter.feed(b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00", 0.0) == []
    received = [f.data[4] for turn in range(4) for f in splitter.feed(frame(turn), 0.25 * (turn + 1))]
    assert received == [0, 1, 2, 3]


def test_on_a_slow_line_a_frame_has_the_time_that_it_takes():
    whole = frame(1, text=b"x" * 50)
    splitter = Splitter(byte_rate=30.0)
    received = [f for place in range(len(whole)) for f in splitter.feed(whole[place : place + 1], place / 30.0)]
    assert [f.data for f in received] == [whole]


@pytest.mark.parametrize("gap_s", [0.2, STALE_S + 0.1, 5.0])
def test_a_frame_whose_parts_a_modem_delivers_seconds_apart_is_whole(gap_s):
    whole = frame(1, text=b"x" * 50)
    splitter = Splitter(byte_rate=5760.0)
    received = [f for part in range(4) for f in splitter.feed(whole[part * 20 : part * 20 + 20], part * gap_s / 3)]
    assert [f.data for f in received] == [whole]


def test_a_beginning_whose_rest_never_comes_is_forgotten():
    splitter = Splitter()
    splitter.feed(frame(1)[:-1], 0.0)
    assert splitter.feed(b"", LATE_S + 0.1) == []
    assert splitter._held == b""


def test_a_whole_frame_behind_a_stale_beginning_is_found_when_more_comes():
    splitter = Splitter()
    assert splitter.feed(b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00" + frame(7), 0.0) == []
    assert [f.data[4] for f in splitter.feed(frame(8), STALE_S + 0.1)] == [7, 8]


def test_several_false_beginnings_hide_no_frame_for_long():
    splitter = Splitter()
    false = b"\xfd\xff\x00\x00\x00\x00\x00\x00\x00\x00"
    assert splitter.feed(false * 3 + frame(7) + frame(8)[:10], 0.0) == []
    assert [f.data[4] for f in splitter.feed(b"", STALE_S + 0.1)] == [7]
    assert [f.data[4] for f in splitter.feed(frame(8)[10:], STALE_S + 0.2)] == [8]


def test_signed_frames_pass_and_foreign_messages_do_not():
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    sender.signing.secret_key = b"k" * 32
    sender.signing.sign_outgoing = True
    signed = mavlink.MAVLink_statustext_message(4, b"hello").pack(sender)
    unknown = b"\xfd\x02\x00\x00\x00\x01\x01\xff\xff\x00ab\x00\x00"
    assert [f.data for f in Splitter().feed(signed + unknown + frame(9), 0.0)] == [signed, frame(9)]


def test_noise_leaves_no_memory_and_hides_no_frame():
    noise = random.Random(3)
    splitter = Splitter()
    found = 0
    for number in range(1000):
        chunk = noise.randbytes(1000)
        found += sum(f.number == 253 for f in splitter.feed(chunk + frame(number % 256), number * 1e-3))
        assert len(splitter._held) < 300
    # A false beginning may still be open at the end of the last chunk.
    found += sum(f.number == 253 for f in splitter.feed(b"", 1e3))
    assert found == 1000
