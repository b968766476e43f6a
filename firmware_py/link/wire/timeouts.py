"""Timeouts and repetition of requests to a station, by the kind of link."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from firmware_py.link.wire.transport import Transport, link_class_of
from firmware_py.link.wire.urls import LinkClass

_MIN_RADIO_BYTE_RATE = 100.0  # bytes per second; a radio has at least 1200 baud, a slower line is a satellite link
_AVERAGE_WEIGHT = 0.3  # of the latest response time
# The wait is the average plus 4 mean deviations (as in TCP, RFC 6298), and at least 1.25 averages.
_WAIT_DEVIATIONS, _MIN_WAIT_AVERAGES = 4.0, 1.25
_MAX_RELATIVE_DIFFERENCE = 0.5  # of two response times that count as equal
_GIVE_UP_AVERAGES = 10.0  # response times of silence before the exchange ends


class Timeouts(msgspec.Struct, frozen=True):
    """Limits of the wait before a request is repeated, and of the silence of a station.

    `first_s` is the wait before the first measured response. After `yield_s` of silence another station may start an
    exchange; after `give_up_s` of silence the exchange ends. Both grow with the response times of a slow line.
    """

    shortest_s: float
    first_s: float
    longest_s: float
    yield_s: float
    give_up_s: float


FAST = Timeouts(0.15, 0.5, 1.5, 5.0, 15.0)
RADIO = Timeouts(0.7, 1.5, 5.0, 15.0, 60.0)
SATELLITE = Timeouts(30.0, 120.0, 240.0, 600.0, 1200.0)  # a response may take two minutes
_TIMEOUTS_OF_CLASS: Mapping[LinkClass, Timeouts] = {
    LinkClass.FAST: FAST,
    LinkClass.RADIO: RADIO,
    LinkClass.SATELLITE: SATELLITE,
    LinkClass.MESSAGES: SATELLITE,
}


def timeouts_of(transport: Transport) -> Timeouts:
    """Return the timeouts of the link class of a transport; a line slower than any radio counts as a satellite link."""
    is_slow = transport.byte_rate is not None and transport.byte_rate < _MIN_RADIO_BYTE_RATE
    return SATELLITE if is_slow else _TIMEOUTS_OF_CLASS[link_class_of(transport)]


class RetryTimer:
    """Timer of the repetition of a request. It estimates the response time and waits longer after each repetition.

    The wait is the average response time plus four mean deviations, as in TCP. With constant response times a loss
    costs little more than a round trip; with variable ones a late response causes no unnecessary repetition.

    After a repetition it is unknown to which request a response belongs. If a second response follows the second
    request after the same time as the first response followed the first request, the repetition was unnecessary, and
    the estimate includes that time. If the times differ, the station sent the second response by itself.
    """

    __slots__ = (
        "_average_s",
        "_deviation_s",
        "_first_sent_s",
        "_repeated_exchange",
        "_repetitions",
        "_second_response_s",
        "_second_sent_s",
        "_sent_s",
        "_timeouts",
        "_wait_s",
    )

    def __init__(self, timeouts: Timeouts) -> None:
        """Start without a request."""
        self._timeouts = timeouts
        self._average_s: float | None = None
        self._deviation_s = 0.0
        # Of the latest repeated request: time from its first sending to the response, and time of its second sending.
        self._repeated_exchange: tuple[float, float] | None = None
        self._first_sent_s = self._sent_s = 0.0
        self._second_response_s: float | None = None  # response time that the latest second response indicates
        self._second_sent_s = 0.0
        self._wait_s = timeouts.first_s
        self._repetitions = 0

    def start_request(self, now_s: float) -> None:
        """Register a new request. The wait remains unchanged until the first measured response."""
        self._first_sent_s = self._sent_s = now_s
        self._repetitions = 0
        if self._average_s is not None:
            self._wait_s = self._compute_wait_s(self._average_s)

    def add_repetition(self, now_s: float) -> None:
        """Register a repetition of the request, and extend the wait."""
        self._sent_s, self._repetitions = now_s, self._repetitions + 1
        if self._repetitions == 1:
            self._second_sent_s = now_s
        self._wait_s = min(1.5 * self._wait_s, max(self._timeouts.longest_s, self._wait_s))

    def add_response(self, now_s: float) -> None:
        """Update the estimate by a response; the response to a repeated request is ambiguous and only stored."""
        response_s = max(0.0, now_s - self._first_sent_s)
        if self._repetitions:
            self._repeated_exchange = response_s, self._second_sent_s
            return
        self._repeated_exchange = None
        if self._average_s is None:
            self._average_s, self._deviation_s = response_s, 0.5 * response_s
            return
        error_s = response_s - self._average_s
        self._deviation_s += _AVERAGE_WEIGHT * (abs(error_s) - self._deviation_s)
        self._average_s += _AVERAGE_WEIGHT * error_s

    def add_second_response(self, now_s: float) -> None:
        """Update the estimate by a second response to the latest repeated request."""
        if self._repeated_exchange is None:
            return
        response_s, second_sent_s = self._repeated_exchange
        if abs(now_s - second_sent_s - response_s) > _MAX_RELATIVE_DIFFERENCE * response_s:
            return
        self._repeated_exchange, previous_s = None, self._second_response_s
        self._second_response_s = response_s
        if previous_s is None or abs(response_s - previous_s) > _MAX_RELATIVE_DIFFERENCE * previous_s:
            return  # a single case may be chance
        self._average_s = max(response_s, self._average_s or 0.0)
        self._wait_s = max(self._wait_s, self._compute_wait_s(self._average_s))

    def _compute_wait_s(self, average_s: float) -> float:
        """Return the wait for a response, limited by the timeouts, but not shorter than 1.25 averages."""
        wait_s = average_s + _WAIT_DEVIATIONS * self._deviation_s
        limited_s = min(max(wait_s, self._timeouts.shortest_s), self._timeouts.longest_s)
        return max(limited_s, _MIN_WAIT_AVERAGES * average_s)

    @property
    def give_up_s(self) -> float:
        """Silence that ends the exchange; longer with long response times."""
        return max(self._timeouts.give_up_s, _GIVE_UP_AVERAGES * (self._average_s or 0.0))

    def is_due(self, now_s: float) -> bool:
        """Return whether the request is to be repeated."""
        return now_s - self._sent_s >= self._wait_s

    @property
    def repetitions(self) -> int:
        """Number of repetitions of the present request."""
        return self._repetitions
