"""One question at a time, silence, and the pace of the commands."""

import pytest

from firmware_py.actuator.half_duplex import MAX_REPLY_TIMEOUT_S, HalfDuplex, ReadingWindow, reply_timeout_s


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


@pytest.mark.parametrize("late", [False, True])
def test_after_a_reply_the_silence_timeout_starts_again(bus, late):
    ask_in_vain(bus, "a1", "b1", "c1", "d1")
    if late:
        bus.match_reply(starts_with("c"))  # d1 may still come
    else:
        bus.finish()
        bus.ask(b"?", "question", 3.0)
    bus.take_expired(3.1)
    assert not bus.is_silent(3.6)  # long enough, and one lost reply
    for now_s in (3.1, 3.2):
        bus.ask(b"?", "question", now_s)
        bus.take_expired(now_s + 0.05)
    assert not bus.is_silent(3.499)  # enough of them, and not long enough
    assert bus.is_silent(3.501)


def test_without_a_request_nothing_expires(bus):
    for tick in range(100):
        assert bus.take_expired(float(tick)) is None
    bus.ask(b"?", "question", 100.0)
    bus.take_expired(101.0)
    assert not bus.is_silent(101.0)


def test_many_requests_in_a_short_time_are_no_silence(bus):
    for tick in range(10):
        bus.ask(b"?", "question", 0.04 * tick)
        bus.take_expired(0.04 * tick + 0.03)
    assert not bus.is_silent(0.4)
    assert bus.is_silent(0.5)


def starts_with(letter):
    return lambda request: request.startswith(letter)


def ask_in_vain(bus, *requests):
    """Ask each at its number of seconds, so that all but the last are given up."""
    for number, request in enumerate(requests):
        bus.take_expired(float(number))
        assert bus.ask(b"?", request, float(number))


def test_a_reply_that_fits_nothing_answers_nothing(bus):
    assert bus.match_reply(starts_with("a")) is None
    ask_in_vain(bus, "b1", "b2")
    assert bus.match_reply(starts_with("a")) is None
    assert bus.outstanding == "b2"


def test_a_late_reply_is_that_of_its_own_question_and_ends_the_wait_for_older_ones(bus):
    ask_in_vain(bus, "a1", "b1", "c1", "d1")
    assert bus.match_reply(starts_with("b")) == ("b1", 1.0, True, None)
    assert bus.outstanding == "d1"
    assert bus.match_reply(starts_with("a")) is None  # replies keep their order
    assert bus.match_reply(starts_with("d")) == ("d1", 3.0, True, None)
    assert bus.outstanding is None
    assert bus.match_reply(starts_with("c")) is None


def test_of_several_that_it_fits_a_reply_is_that_of_the_oldest_and_not_sure(bus):
    ask_in_vain(bus, "a1", "a2")
    assert bus.match_reply(starts_with("a")) == ("a1", 0.0, False, "a2")
    assert bus.outstanding is None  # it may have been the answer to a2
    assert bus.match_reply(starts_with("a")) == ("a2", 1.0, True, None)  # or that one is
    ask_in_vain(bus, "a3", "a4", "b1")
    assert bus.match_reply(starts_with("a")) == ("a3", 0.0, False, None)
    assert bus.outstanding == "b1"


def test_a_reply_that_is_later_than_any_adapter_holds_it_answers_nothing(bus):
    ask_in_vain(bus, "a1", "b1", "c1", "d1", "e1")
    assert bus.match_reply(starts_with("a")) is None
    assert bus.match_reply(starts_with("c")) == ("c1", 2.0, True, None)


def test_a_late_reply_is_a_sign_of_life(bus):
    ask_in_vain(bus, "a1", "b1", "c1", "d1")
    assert bus.is_silent(3.0)
    bus.match_reply(starts_with("c"))
    assert not bus.is_silent(9.0)


def test_reopening_forgets_what_waited(bus, line):
    ask_in_vain(bus, "early", "question")
    assert not bus.notice_reopening()
    line.unplug()
    line.plug()
    assert bus.notice_reopening()
    assert bus.outstanding is None
    assert bus.match_reply(starts_with("early")) is None
    assert not bus.notice_reopening()


def test_pace():
    pace = ReadingWindow()
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
    assert reply_timeout_s(300, 110) == MAX_REPLY_TIMEOUT_S
