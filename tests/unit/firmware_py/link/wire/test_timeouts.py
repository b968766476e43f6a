"""Timer of repeated requests: estimate of the response time, waits and limits."""

import pytest

from firmware_py.link.wire.timeouts import FAST, RADIO, SATELLITE, RetryTimer, timeouts_of
from support.link import MemoryTransport


def wait_s(timer, start_s):
    """Return the wait of a request that was sent at start_s, to a millisecond."""
    return next(n for n in range(10_000) if timer.is_due(start_s + 0.001 * n)) * 0.001


def timer_after(*responses_s, timeouts=FAST):
    """Return a timer that has sent a request after these responses, at time 100."""
    timer = RetryTimer(timeouts)
    for number, response_s in enumerate(responses_s):
        timer.start_request(10.0 * number)
        timer.add_response(10.0 * number + response_s)
    timer.start_request(100.0)
    return timer


@pytest.mark.parametrize(
    ("responses_s", "expected_s"),
    [
        pytest.param((), 0.5, id="before the first response"),
        pytest.param((0.2,), 0.6, id="average 0.2, deviation 0.1"),
        pytest.param((0.2, 0.2), 0.48, id="deviation 0.07"),
        pytest.param((0.2, 0.4), 0.26 + 4.0 * 0.13, id="average 0.26, deviation 0.13"),
        pytest.param((0.4, 0.2), 0.34 + 4.0 * 0.2, id="a shorter response"),
        pytest.param((0.2,) * 20, 0.25, id="constant: 1.25 averages"),
        pytest.param((0.01,) * 20, 0.15, id="not below the shortest"),
        pytest.param((1.0,), 1.5, id="not above the longest"),
        pytest.param((2.0,), 2.5, id="above the longest by 1.25 averages"),
    ],
)
def test_wait_is_the_average_plus_four_deviations(responses_s, expected_s):
    assert wait_s(timer_after(*responses_s), 100.0) == pytest.approx(expected_s, abs=0.002)


def test_wait_grows_by_half_with_each_repetition_up_to_the_longest():
    timer = timer_after()
    waits_s = []
    for number in range(5):
        timer.add_repetition(100.0 + number)
        assert timer.repetitions == number + 1
        waits_s.append(wait_s(timer, 100.0 + number))
    assert waits_s == pytest.approx([0.75, 1.125, 1.5, 1.5, 1.5], abs=0.002)
    slow = timer_after(2.0)
    slow.add_repetition(100.0)
    assert wait_s(slow, 100.0) == pytest.approx(2.5, abs=0.002)
    slow.start_request(200.0)
    assert slow.repetitions == 0


def test_response_to_a_repeated_request_does_not_change_the_estimate():
    timer = timer_after(0.2)
    timer.add_repetition(100.6)
    timer.add_response(100.7)
    timer.start_request(200.0)
    assert wait_s(timer, 200.0) == pytest.approx(0.6, abs=0.002)


def repeat_unnecessarily(timer, start_s, second_response_s):
    """Repeat a request after 1 s; the first response comes after 2 s, the second after second_response_s."""
    timer.start_request(start_s)
    timer.add_repetition(start_s + 1.0)
    timer.add_response(start_s + 2.0)
    timer.add_second_response(start_s + second_response_s)


@pytest.mark.parametrize(
    ("seconds", "is_learned"),
    [
        pytest.param((3.0, 3.0), True, id="twice after the same time"),
        pytest.param((3.9, 2.1), True, id="within half of the response time"),
        pytest.param((3.0, 4.1), False, id="later"),
        pytest.param((1.9, 3.0), False, id="earlier"),
        pytest.param((3.0,), False, id="once, which may be chance"),
    ],
)
def test_second_responses_show_that_repetitions_were_unnecessary(seconds, is_learned):
    timer = RetryTimer(FAST)
    timer.start_request(0.0)
    timer.add_second_response(0.1)  # of an earlier exchange
    for number, second_response_s in enumerate(seconds):
        repeat_unnecessarily(timer, 10.0 * number, second_response_s)
    timer.start_request(100.0)
    assert wait_s(timer, 100.0) == pytest.approx(2.5 if is_learned else 1.125 if len(seconds) == 2 else 0.75, abs=0.002)
    assert timer.give_up_s == pytest.approx(20.0 if is_learned else 15.0)


def test_silence_that_ends_an_exchange_grows_with_the_response_time():
    assert timer_after().give_up_s == 15.0
    assert timer_after(1.4).give_up_s == 15.0
    assert timer_after(1.6).give_up_s == pytest.approx(16.0)
    assert timer_after(1.6, timeouts=RADIO).give_up_s == 60.0


def test_line_slower_than_any_radio_has_the_timeouts_of_a_satellite():
    assert timeouts_of(MemoryTransport()) == FAST
    assert timeouts_of(MemoryTransport(byte_rate=100.0, has_radio_rates=True)) == RADIO
    assert timeouts_of(MemoryTransport(byte_rate=99.0, has_radio_rates=True)) == SATELLITE


@pytest.mark.parametrize(
    ("timeouts", "shortest_s", "first_s", "longest_s", "yield_s", "give_up_s"),
    [
        (FAST, 0.15, 0.5, 1.5, 5.0, 15.0),
        (RADIO, 0.7, 1.5, 5.0, 15.0, 60.0),
        (SATELLITE, 30.0, 120.0, 240.0, 600.0, 1200.0),
    ],
)
def test_limits_of_each_kind_of_link(timeouts, shortest_s, first_s, longest_s, yield_s, give_up_s):
    timer = timer_after(timeouts=timeouts)
    assert not timer.is_due(100.0 + first_s - 0.01)
    assert timer.is_due(100.0 + first_s)
    for _ in range(9):
        timer.add_repetition(100.0)
    assert not timer.is_due(100.0 + longest_s - 0.01)
    assert timer.is_due(100.0 + longest_s)
    quick = timer_after(*[0.001] * 5, timeouts=timeouts)
    assert not quick.is_due(100.0 + shortest_s - 0.01)
    assert quick.is_due(100.0 + shortest_s)
    assert (timer.give_up_s, timeouts.yield_s) == (give_up_s, yield_s)


@pytest.mark.parametrize(("response_s", "give_up_s"), [(1.4, 15.0), (1.6, 16.0), (30.0, 300.0)])
def test_exchange_ends_after_ten_response_times(response_s, give_up_s):
    assert timer_after(response_s).give_up_s == pytest.approx(give_up_s)
