"""Half-duplex bus: expired requests, late replies, silence, and the window for readings."""

import pytest

from firmware_py.actuator.half_duplex import HalfDuplex, ReadingWindow, reply_timeout_s

MAX_REPLY_TIMEOUT_S = 1.0


@pytest.fixture
def line(fakes):
    return fakes.line()


@pytest.fixture
def bus(line):
    return HalfDuplex(line, 0.02)


def test_request_expires_once(bus):
    assert bus.send(b"?", "request", 1.0)
    assert bus.give_up_expired(1.019) is None
    assert bus.pending_request == "request"
    assert bus.give_up_expired(1.021) == "request"
    assert bus.pending_request is None
    for now_s in range(2, 100):
        assert bus.give_up_expired(float(now_s)) is None
    assert bus.send(b"?", "other", 0.0)
    assert bus.give_up_expired(0.02) == "other"


def test_blocked_line_leaves_no_pending_request(bus, line):
    line.full = True
    assert not bus.send(b"?", "request", 1.0)
    assert bus.pending_request is None


def test_silence_needs_half_a_second_and_three_lost_replies(bus):
    for now_s in (0.0, 1.0):  # a slow loop
        bus.send(b"?", "request", now_s)
        bus.give_up_expired(now_s + 0.5)
        assert not bus.is_silent(now_s + 0.5)
    bus.send(b"?", "request", 2.0)
    bus.give_up_expired(2.5)
    assert bus.is_silent(2.5)
    bus.end_exchange()
    assert not bus.is_silent(9.0)


@pytest.mark.parametrize("late", [False, True])
def test_after_a_reply_the_silence_timeout_starts_again(bus, late):
    send_without_replies(bus, "a1", "b1", "c1", "d1")
    if late:
        bus.match_reply(starts_with("c"))  # the reply to d1 may still arrive
    else:
        bus.end_exchange()
        bus.send(b"?", "request", 3.0)
    bus.give_up_expired(3.1)
    assert not bus.is_silent(3.6)  # one lost reply
    for now_s in (3.1, 3.2):
        bus.send(b"?", "request", now_s)
        bus.give_up_expired(now_s + 0.05)
    assert not bus.is_silent(3.499)
    assert bus.is_silent(3.501)


def test_many_lost_replies_in_a_short_time_are_no_silence(bus):
    for tick in range(10):
        bus.send(b"?", "request", 0.04 * tick)
        bus.give_up_expired(0.04 * tick + 0.03)
    assert not bus.is_silent(0.4)
    assert bus.is_silent(0.5)


def starts_with(letter):
    return lambda request: request.startswith(letter)


def send_without_replies(bus, *requests):
    """Send the requests at 0, 1, 2, ... s; all but the last are given up."""
    for number, request in enumerate(requests):
        bus.give_up_expired(float(number))
        assert bus.send(b"?", request, float(number))


def test_reply_without_a_matching_request_is_none(bus):
    assert bus.match_reply(starts_with("a")) is None
    send_without_replies(bus, "b1", "b2")
    assert bus.match_reply(starts_with("a")) is None
    assert bus.pending_request == "b2"


def test_late_reply_is_assigned_to_its_request_and_discards_older_ones(bus):
    send_without_replies(bus, "a1", "b1", "c1", "d1")
    assert bus.match_reply(starts_with("b")) == ("b1", 1.0, True, None)
    assert bus.pending_request == "d1"
    assert bus.match_reply(starts_with("a")) is None  # replies keep their order
    assert bus.match_reply(starts_with("d")) == ("d1", 3.0, True, None)
    assert bus.pending_request is None
    assert bus.match_reply(starts_with("c")) is None


def test_reply_with_several_matching_requests_is_assigned_to_the_oldest_as_uncertain(bus):
    send_without_replies(bus, "a1", "a2")
    assert bus.match_reply(starts_with("a")) == ("a1", 0.0, False, "a2")
    assert bus.pending_request is None  # it may have been the reply to a2
    assert bus.match_reply(starts_with("a")) == ("a2", 1.0, True, None)
    send_without_replies(bus, "a3", "a4", "b1")
    assert bus.match_reply(starts_with("a")) == ("a3", 0.0, False, None)
    assert bus.pending_request == "b1"


@pytest.mark.parametrize(("later_s", "is_matched"), [(2.0, True), (2.01, False)])
def test_reply_is_matched_for_two_seconds(bus, later_s, is_matched):
    send_without_replies(bus, "a1", "b1")
    bus.give_up_expired(later_s)
    assert (bus.match_reply(starts_with("a")) is not None) is is_matched
    assert bus.match_reply(starts_with("b")) == ("b1", 1.0, True, None)


def test_reopening_discards_all_requests(bus, line):
    send_without_replies(bus, "early", "request")
    assert not bus.notice_reopening()
    line.unplug()
    line.plug()
    assert bus.notice_reopening()
    assert bus.pending_request is None
    assert bus.match_reply(starts_with("early")) is None
    assert not bus.notice_reopening()


def test_window_for_readings():
    window = ReadingWindow()
    assert not window.is_early(0.0)  # without a command
    assert (window.is_overdue(0.249), window.is_overdue(0.25)) == (False, True)
    for command_s, half_period_s, overdue_s in (
        (10.0, 0.5, 2.5),
        (10.5, 0.25, 1.25),
        (10.5625, 0.03125, 0.25),
        (20.0, 0.5, 2.5),
    ):
        window.note_command(command_s)
        end_s = command_s + half_period_s
        assert (window.early_s, window.early_end_s) == (half_period_s, end_s)
        assert (window.is_early(end_s), window.is_early(end_s + 0.001)) == (True, False)
        assert (window.is_overdue(overdue_s - 0.001), window.is_overdue(overdue_s)) == (False, True)


def test_reply_timeout_depends_on_the_baud_rate():
    assert reply_timeout_s(57600, 110) == pytest.approx(0.0351, abs=1e-4)
    assert reply_timeout_s(9600, 110) > 0.016 + 70 * 10 / 9600
    assert reply_timeout_s(300, 110) == MAX_REPLY_TIMEOUT_S
