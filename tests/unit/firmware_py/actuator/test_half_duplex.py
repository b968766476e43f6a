"""One question at a time, silence, and the pace of the commands."""

import pytest

from firmware_py.actuator.half_duplex import LONGEST_REPLY_TIMEOUT_S, HalfDuplex, Pace, reply_timeout_s


@pytest.fixture
def line(fakes):
    return fakes.line()


@pytest.fixture
def bus(line):
    return HalfDuplex(line, 0.02)


def test_a_request_expires_once(bus):
    assert bus.ask(b"?", "question", 1.0)
    assert bus.take_expired(1.019) is None
    assert bus.outstanding == "question"
    assert bus.take_expired(1.021) == "question"
    assert bus.outstanding is None
    assert bus.take_expired(2.0) is None


def test_a_line_that_does_not_take_the_frame_leaves_nothing_outstanding(bus, line):
    line.full = True
    assert not bus.ask(b"?", "question", 1.0)
    assert bus.outstanding is None


def test_silence_needs_half_a_second_and_three_requests(bus):
    for now_s in (0.0, 1.0):  # a slow loop: two lost replies are no silence
        bus.ask(b"?", "question", now_s)
        bus.take_expired(now_s + 0.5)
        assert not bus.is_silent(now_s + 0.5)
    bus.ask(b"?", "question", 2.0)
    bus.take_expired(2.5)
    assert bus.is_silent(2.5)
    bus.finish()
    assert not bus.is_silent(9.0)


def test_many_requests_in_a_short_time_are_no_silence(bus):
    for tick in range(10):
        bus.ask(b"?", "question", 0.04 * tick)
        bus.take_expired(0.04 * tick + 0.03)
    assert not bus.is_silent(0.4)
    assert bus.is_silent(0.5)


def test_reopening_forgets_what_waited(bus, line):
    bus.ask(b"?", "question", 0.0)
    assert not bus.notice_reopening()
    line.unplug()
    line.plug()
    assert bus.notice_reopening()
    assert bus.outstanding is None
    assert not bus.notice_reopening()


def test_pace():
    pace = Pace()
    assert not pace.is_early(0.0)  # no command, no moment for a reading but the overdue one
    assert pace.is_overdue(0.25)
    pace.note_command(10.0)
    assert pace.is_early(10.4)
    pace.note_command(10.1)
    assert pace.is_early(10.14)
    assert not pace.is_early(10.16)
    assert not pace.is_overdue(0.2)
    assert pace.is_overdue(0.3)
    pace.note_command(11.1)
    assert not pace.is_overdue(2.0)


def test_a_slow_line_is_waited_for_as_long_as_its_bytes_take():
    """At 9600 baud a Dynamixel's telemetry takes longer than any exchange at 57600."""
    assert reply_timeout_s(57600, 110) == pytest.approx(0.0351, abs=1e-4)
    assert reply_timeout_s(9600, 110) > 0.016 + 70 * 10 / 9600
    assert reply_timeout_s(300, 110) == LONGEST_REPLY_TIMEOUT_S
