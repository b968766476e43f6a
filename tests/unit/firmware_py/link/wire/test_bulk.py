"""How much of a long transfer goes at one time."""

import pytest

from firmware_py.link.wire.bulk import BulkShare

FRAME = 110


def test_a_network_takes_a_slice_whenever_nothing_waits():
    allowance = BulkShare(None)
    assert allowance.frames(FRAME, 0, 0.0) > 0
    assert allowance.frames(FRAME, 1, 0.0) == 0
    allowance.leave()
    assert allowance.hungry


@pytest.mark.parametrize("byte_rate", [120.0, 960.0, 5760.0, 92160.0])
def test_a_line_is_filled_to_a_part_in_the_long_run(byte_rate):
    allowance, sent = BulkShare(byte_rate), 0
    for tick in range(600):
        frames = allowance.frames(FRAME, 0, 0.1 * tick)
        allowance.spend(frames * FRAME)
        sent += frames * FRAME
    assert sent == pytest.approx(0.7 * byte_rate * 60.0, rel=0.05)
    allowance.leave()
    assert not allowance.hungry


def test_an_idle_line_saves_up_little_and_a_clock_that_stands_nothing():
    allowance = BulkShare(5760.0)
    assert allowance.frames(FRAME, 0, 0.0) == 0
    assert allowance.frames(FRAME, 0, 1e6) <= 0.25 * 5760.0 / FRAME
    allowance.spend(10 * FRAME)
    assert allowance.frames(FRAME, 0, 1e6) <= 0
    assert allowance.frames(FRAME, 0, 0.0) <= 0


def test_what_waits_leaves_no_room():
    allowance = BulkShare(1e6)
    allowance.frames(FRAME, 0, 0.0)
    assert allowance.frames(FRAME, 60, 10.0) == 4
    assert allowance.frames(FRAME, 64, 10.0) == 0
