"""Timeouts and repetition of requests to a station, by the kind of link."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from firmware_py.link.wire.transport import Transport, usual_class
from firmware_py.link.wire.urls import LinkClass

_RADIO_BYTES_S = 100.0  # a slower line is a satellite's: 1200 baud is a radio's
_NEW = 0.3  # weight of the latest answer in the average
_DEVIATIONS, _LATER = 4.0, 1.25  # wait of average + 4 deviations, at least 1.25 averages; as TCP, RFC 6298
_ALIKE = 0.5  # relative difference of two equal answer times
_PATIENCE = 10.0  # average round trips of silence before the end


class Timeouts(msgspec.Struct, frozen=True):
    """A request is repeated after `shortest_s` to `longest_s`, by the measured answer times.

    After `yield_s` of silence another station may take over; `give_up_s` of silence ends the exchange. Both grow with
    the answer times of a slow line.
    """

    shortest_s: float
    first_s: float
    longest_s: float
    yield_s: float
    give_up_s: float


FAST = Timeouts(0.15, 0.5, 1.5, 5.0, 15.0)
RADIO = Timeouts(0.7, 1.5, 5.0, 15.0, 60.0)
# An answer by satellite may take two minutes.
SATELLITE = Timeouts(30.0, 120.0, 240.0, 600.0, 1200.0)
_OF_CLASS: Mapping[LinkClass, Timeouts] = {
    LinkClass.FAST: FAST,
    LinkClass.RADIO: RADIO,
    LinkClass.SATELLITE: SATELLITE,
    LinkClass.MESSAGES: SATELLITE,
}


def timeouts_of(transport: Transport) -> Timeouts:
    """Return the timeouts of a transport by its class; a line that is slower than any radio counts as a satellite."""
    slow = transport.byte_rate is not None and transport.byte_rate < _RADIO_BYTES_S
    return SATELLITE if slow else _OF_CLASS[usual_class(transport)]


class RetryTimer:
    """Schedules the repetition of a request: estimates the answer time, and waits longer after each repetition.

    The wait is the average answer time plus four mean deviations, as in TCP: a loss on an even line costs little more
    than a round trip, and a late answer on an uneven line causes no needless repetition.

    After a repetition it is not known to which request an answer belongs. If a second answer takes as long from the
    second request as the first answer from the first, the repetition was needless, and that time is learned. A second
    answer after another time was sent by the station on its own.
    """

    __slots__ = (
        "_again_s",
        "_asked_s",
        "_deviation_s",
        "_in_doubt",
        "_started_s",
        "_suspected_s",
        "_timeouts",
        "_tries",
        "_typical_s",
        "_wait_s",
    )

    def __init__(self, timeouts: Timeouts) -> None:
        """Start without a request."""
        self._timeouts = timeouts
        self._typical_s: float | None = None
        self._deviation_s = 0.0
        # Of the latest repeated request: answer time since its first sending, and time of the second sending.
        self._in_doubt: tuple[float, float] | None = None
        self._started_s = self._asked_s = 0.0
        self._suspected_s: float | None = None  # answer time by a second answer
        self._again_s = 0.0  # second sending of the present request
        self._wait_s = timeouts.first_s
        self._tries = 0

    def begin(self, now_s: float) -> None:
        """Note that a new request was sent; the wait is unchanged before the first measurement."""
        self._started_s = self._asked_s = now_s
        self._tries = 0
        if self._typical_s is not None:
            self._wait_s = self._usual_wait_s(self._typical_s)

    def repeat(self, now_s: float) -> None:
        """Note that the request was repeated."""
        self._asked_s, self._tries = now_s, self._tries + 1
        if self._tries == 1:
            self._again_s = now_s
        self._wait_s = min(1.5 * self._wait_s, max(self._timeouts.longest_s, self._wait_s))

    def learn(self, now_s: float) -> None:
        """Learn from an answer; that to a repeated request is ambiguous."""
        took_s = max(0.0, now_s - self._started_s)
        if self._tries:
            self._in_doubt = took_s, self._again_s
            return
        self._in_doubt = None
        if self._typical_s is None:
            self._typical_s, self._deviation_s = took_s, 0.5 * took_s
            return
        beside_s = took_s - self._typical_s
        self._deviation_s += _NEW * (abs(beside_s) - self._deviation_s)
        self._typical_s += _NEW * beside_s

    def learn_from_duplicate(self, now_s: float) -> None:
        """Learn from a second answer to the previous request, if the first was that to its first sending."""
        if self._in_doubt is None:
            return
        took_s, again_s = self._in_doubt
        if abs(now_s - again_s - took_s) > _ALIKE * took_s:
            return
        self._in_doubt, before_s = None, self._suspected_s
        self._suspected_s = took_s
        if before_s is None or abs(took_s - before_s) > _ALIKE * before_s:
            return  # a single case may be chance
        self._typical_s = max(took_s, self._typical_s or 0.0)
        self._wait_s = max(self._wait_s, self._usual_wait_s(self._typical_s))

    def _usual_wait_s(self, typical_s: float) -> float:
        """Return the wait for an answer, within the bounds, and never shorter than an average answer takes."""
        wait_s = typical_s + _DEVIATIONS * self._deviation_s
        within_s = min(max(wait_s, self._timeouts.shortest_s), self._timeouts.longest_s)
        return max(within_s, _LATER * typical_s)

    @property
    def give_up_s(self) -> float:
        """Silence that ends the exchange: longer with long round trips."""
        return max(self._timeouts.give_up_s, _PATIENCE * (self._typical_s or 0.0))

    def due(self, now_s: float) -> bool:
        """Return whether a repetition is due."""
        return now_s - self._asked_s >= self._wait_s

    @property
    def tries(self) -> int:
        """Number of repetitions of the present request."""
        return self._tries
