"""How long to wait for an answer, by the kind of line."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from firmware_py.link.wire.transport import Transport, usual_class
from firmware_py.link.wire.urls import LinkClass

_RADIO_BYTES_S = 100.0  # a slower line is a satellite's: 1200 baud is a radio's
_NEW = 0.3  # part of the latest answer in what is usual
_DEVIATIONS, _LATER = 4.0, 1.25  # an answer is waited for so long beyond the usual; as TCP does, RFC 6298
_ALIKE = 0.5  # two answers of one line take as long, within this part of it
_PATIENCE = 10.0  # usual round trips of silence are no end yet


class Timeouts(msgspec.Struct, frozen=True):
    """A question is asked again after `shortest_s` to `longest_s`, as the answers come; `give_up_s` of silence end it.

    A line on which answers take longer is given longer. After `yield_s` of silence another may have its turn.
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
    """Return the timeouts for a transport: its class's; a satellite's where a line is slower than any radio's."""
    slow = transport.byte_rate is not None and transport.byte_rate < _RADIO_BYTES_S
    return SATELLITE if slow else _OF_CLASS[usual_class(transport)]


class RetryTimer:
    """When a question is to be asked again: learns how long answers take, and asks less often the longer none comes.

    The wait is the usual time and four times its mean deviation: what is lost on an even line costs little more than a
    round trip, and what is late on an uneven one is not asked for in vain.

    Which asking an answer belongs to cannot be told once there were two; a second answer that took as long from the
    second asking tells that it was the first, and that to ask again was in vain. One that comes at another time is
    what the station says again by itself.
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
        """Start without a question."""
        self._timeouts = timeouts
        self._typical_s: float | None = None
        self._deviation_s = 0.0
        # Of the latest that was asked twice: since its first asking, and when it was asked for the second time.
        self._in_doubt: tuple[float, float] | None = None
        self._started_s = self._asked_s = 0.0
        self._suspected_s: float | None = None  # how long answers take, by a second answer
        self._again_s = 0.0  # when the present one was asked for the second time
        self._wait_s = timeouts.first_s
        self._tries = 0

    def begin(self, now_s: float) -> None:
        """Note that a new question was asked; the wait is as before where nothing is known."""
        self._started_s = self._asked_s = now_s
        self._tries = 0
        if self._typical_s is not None:
            self._wait_s = self._usual_wait_s(self._typical_s)

    def repeat(self, now_s: float) -> None:
        """Note that the same question was asked again."""
        self._asked_s, self._tries = now_s, self._tries + 1
        if self._tries == 1:
            self._again_s = now_s
        self._wait_s = min(1.5 * self._wait_s, max(self._timeouts.longest_s, self._wait_s))

    def learn(self, now_s: float) -> None:
        """Learn from an answer; that to a question asked twice teaches nothing yet."""
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
        """Learn from a second answer to the last question but one, if its first was that to the first asking."""
        if self._in_doubt is None:
            return
        took_s, again_s = self._in_doubt
        if abs(now_s - again_s - took_s) > _ALIKE * took_s:
            return
        self._in_doubt, before_s = None, self._suspected_s
        self._suspected_s = took_s
        if before_s is None or abs(took_s - before_s) > _ALIKE * before_s:
            return  # once is chance
        self._typical_s = max(took_s, self._typical_s or 0.0)
        self._wait_s = max(self._wait_s, self._usual_wait_s(self._typical_s))

    def _usual_wait_s(self, typical_s: float) -> float:
        """Return how long to wait for an answer, within the bounds; never so little that a usual one is too late."""
        wait_s = typical_s + _DEVIATIONS * self._deviation_s
        within_s = min(max(wait_s, self._timeouts.shortest_s), self._timeouts.longest_s)
        return max(within_s, _LATER * typical_s)

    @property
    def give_up_s(self) -> float:
        """How much silence ends it all: more where round trips are long."""
        return max(self._timeouts.give_up_s, _PATIENCE * (self._typical_s or 0.0))

    def due(self, now_s: float) -> bool:
        """Return whether it is time to ask again."""
        return now_s - self._asked_s >= self._wait_s

    @property
    def tries(self) -> int:
        """How often the present question was asked again."""
        return self._tries
