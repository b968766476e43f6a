import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.devices.timing import MAX_QUEUE, MAX_TURNS_AT_ONCE, Pace, ReceiveBuffer, Transmitter, transfer_s


def test_pace_keeps_its_phase():
    pace = Pace(0.1, start_s=0.03)
    pace.take(86_400.0)
    assert pace.next_s == pytest.approx(86_400.03, abs=1e-9)


def test_pace_with_a_fast_clock():
    pace = Pace(1.0, error_ppm=100.0)
    taken = 0
    while pace.next_s <= 100_000.0:
        taken += len(pace.take(pace.next_s))
    assert taken == 100_011  # one at the start, and 100 ppm of 100 000 s


def test_late_pace_skips_in_phase():
    pace = Pace(0.1)
    late = pace.take(1000.0)
    assert len(late) == MAX_TURNS_AT_ONCE
    assert late[-1] == pytest.approx(1000.0)


@given(st.floats(1e-3, 10.0), st.floats(0.0, 1e6), st.integers(1, 50))
def test_take_at_the_exact_time(period_s, start_s, turns):
    pace = Pace(period_s, start_s=start_s)
    for _ in range(turns):
        due_s = pace.next_s
        assert pace.take(due_s) == [due_s]
        assert pace.next_s > due_s


@pytest.mark.parametrize("period_s", [0.0, -1.0, math.nan, math.inf])
def test_invalid_period(period_s):
    with pytest.raises(ValueError, match="period"):
        Pace(period_s)


def test_transmission_times():
    line = Transmitter(4800)
    assert line.send(1.0, b"x" * 48) == pytest.approx(1.1)
    assert line.send(1.01, b"y" * 48) == pytest.approx(1.2)
    assert line.take(1.099) == b""
    assert line.take(1.1001) == b"x" * 48
    assert line.next_s() == pytest.approx(1.2)
    assert line.take(9.0) == b"y" * 48
    assert line.next_s() == math.inf


def test_full_queue_drops_the_newest():
    line = Transmitter(4800)
    for _ in range(MAX_QUEUE):
        assert line.send(0.0, b"a") < math.inf
    assert line.send(0.0, b"b") == math.inf
    assert b"b" not in line.take(1e9)


def test_occupied():
    line = Transmitter(10)
    line.send(5.0, b"abc")
    assert not line.occupies(4.0, 5.0)
    assert line.occupies(4.0, 5.1)
    assert line.occupies(7.9, 8.5)
    assert not line.occupies(8.0, 8.5)


def test_transfer_time():
    assert transfer_s(6, 115_200) == pytest.approx(0.52e-3, rel=0.01)


def test_pause_begins_a_new_message():
    buffer = ReceiveBuffer(max_bytes=4, pause_s=0.01)
    buffer.append(1.0, b"ab")
    buffer.append(1.005, b"cde")
    assert buffer.data == b"bcde"
    buffer.append(1.1, b"f")
    assert buffer.data == b"f"
