"""How much of a long transfer goes at one time."""

import pytest

from firmware_py.link.wire.outbox import BulkShare

FRAME = 110


def test_a_network_takes_a_slice_whenever_nothing_waits():
    share = BulkShare(None)
    assert share.frames(FRAME, 0, 0.0) > 0
    assert share.frames(FRAME, 1, 0.0) == 0
    share.mark_unfinished()
    assert share.can_continue


@pytest.mark.parametrize("byte_rate", [120.0, 960.0, 5760.0, 92160.0])
def test_a_line_is_filled_to_a_part_in_the_long_run(byte_rate):
    share, sent = BulkShare(byte_rate), 0
    for tick in range(600):
        frames = share.frames(FRAME, 0, 0.1 * tick)
        share.spend(frames * FRAME)
        sent += frames * FRAME
    assert sent == pytest.approx(0.7 * byte_rate * 60.0, rel=0.05)
    share.mark_unfinished()
    assert not share.can_continue


def test_an_idle_line_saves_up_little_and_a_clock_that_stands_nothing():
    share = BulkShare(5760.0)
    assert share.frames(FRAME, 0, 0.0) == 0
    assert share.frames(FRAME, 0, 1e6) <= 0.25 * 5760.0 / FRAME
    share.spend(10 * FRAME)
    assert share.frames(FRAME, 0, 1e6) <= 0
    assert share.frames(FRAME, 0, 0.0) <= 0


def test_what_waits_leaves_no_room():
    share = BulkShare(1e6)
    share.frames(FRAME, 0, 0.0)
    assert share.frames(FRAME, 60, 10.0) == 4
    assert share.frames(FRAME, 64, 10.0) == 0
