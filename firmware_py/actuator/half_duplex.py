"""One question at a time on a bus where both ends share the wires, and replies that may come after it is given up."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from firmware_py.common.interfaces import ByteLine

RequestT = TypeVar("RequestT")

SILENT_AFTER_S = 0.5
SILENT_AFTER_REQUESTS = 3  # so that one lost reply of a slow loop is no silence
EARLY_PART = 0.5
OVERDUE_S, OVERDUE_PERIODS = 0.25, 2.5
LONGEST_PERIOD_S = 1.0
LONGEST_REPLY_TIMEOUT_S = 1.0
ADAPTER_LATENCY_S = 0.016  # the latency timer of a USB adapter
BITS_PER_BYTE = 10
LATEST_REPLY_S = 2.0  # for so long the reply to a question that was given up may still come


def reply_timeout_s(baud: int, exchange_bytes: int) -> float:
    """Return after how long a reply is given up on a line where question and reply have at most so many bytes."""
    return min(ADAPTER_LATENCY_S + exchange_bytes * BITS_PER_BYTE / baud, LONGEST_REPLY_TIMEOUT_S)


class Answered(NamedTuple, Generic[RequestT]):
    """What a reply answers: of several that it fits the oldest, and then not `sure`.

    `doubtful` is the newest if it fits that, too, and is given up.
    """

    request: RequestT
    asked_s: float
    sure: bool = True
    doubtful: RequestT | None = None


class HalfDuplex(Generic[RequestT]):
    """Remembers which requests wait for their replies, and for how long there has been none.

    A reply that an adapter has held back comes after its request was given up, and after the next one was sent. Replies
    come in the order of the requests, so each is that of the oldest which it fits, and ends the wait for all before.
    """

    __slots__ = (
        *("_given_up", "_line", "_openings", "_reply_timeout_s", "_unanswered", "_waiting_since_s"),
        *("outstanding", "sent_s"),
    )

    def __init__(self, line: ByteLine, reply_timeout_s: float) -> None:
        """Take the line, and the time after which a reply is given up."""
        self._line = line
        self._reply_timeout_s = reply_timeout_s
        self._openings = line.openings
        self.sent_s = 0.0  # the last question
        self._unanswered = 0
        self._waiting_since_s: float | None = None
        self._given_up: deque[tuple[RequestT, float]] = deque()  # and when asked; oldest first
        self.outstanding: RequestT | None = None

    def notice_reopening(self) -> bool:
        """Say whether the line is a new one since the last call, and if so forget what waited."""
        if self._line.openings == self._openings:
            return False
        self._openings = self._line.openings
        self.finish()
        return True

    def ask(self, frame: bytes, request: RequestT, now_s: float) -> bool:
        """Write a frame whose reply is awaited; False when the line does not take it."""
        if not self._line.write(frame):
            return False
        self.outstanding = request
        self.sent_s = now_s
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        return True

    def finish(self) -> None:
        """End the exchange: the reply has come, and those of earlier requests will not."""
        self.outstanding = None
        self._given_up.clear()
        self._unanswered = 0
        self._waiting_since_s = None

    def take_answered(self, fits: Callable[[RequestT], bool]) -> Answered[RequestT] | None:
        """Return what a reply answers, given which requests it fits; None for a reply to none.

        The bus is free when it may be the reply to the newest. If that is not sure, the newest is given up.
        """
        newest, sent_s = self.outstanding, self.sent_s
        fits_newest = newest is not None and fits(newest)
        candidates = [number for number, (request, _) in enumerate(self._given_up) if fits(request)]
        if not candidates:
            if newest is None or not fits_newest:
                return None
            self.finish()
            return Answered(newest, sent_s)
        for _ in range(candidates[0]):
            self._given_up.popleft()
        request, asked_s = self._given_up.popleft()
        doubtful = newest if fits_newest else None
        if doubtful is not None:
            self._given_up.append((doubtful, sent_s))
            self.outstanding = None
        self._unanswered = 0
        self._waiting_since_s = None if self.outstanding is None else sent_s
        return Answered(request, asked_s, len(candidates) == 1 and doubtful is None, doubtful)

    def take_expired(self, now_s: float) -> RequestT | None:
        """Return the request whose reply is given up now, once."""
        request = self.outstanding
        if request is None or now_s - self.sent_s < self._reply_timeout_s:
            return None
        self.outstanding = None
        while self._given_up and now_s - self._given_up[0][1] > LATEST_REPLY_S:
            self._given_up.popleft()
        self._given_up.append((request, self.sent_s))
        self._unanswered += 1
        return request

    def is_silent(self, now_s: float) -> bool:
        """Say whether the device has stopped answering."""
        waiting_since_s = self._waiting_since_s
        if waiting_since_s is None or self._unanswered < SILENT_AFTER_REQUESTS:
            return False
        return now_s - waiting_since_s >= SILENT_AFTER_S


class Pace:
    """Keeps the bus free for the next command.

    A reading begun late in the period of the commands could still hold the bus when the
    next one comes, so there it is only begun when it is overdue.
    """

    __slots__ = ("_command_s", "_period_s")

    def __init__(self) -> None:
        """Begin without a command."""
        self._command_s = -math.inf
        self._period_s = 0.0

    @property
    def early_s(self) -> float:
        """How long after the command a reading may begin."""
        return EARLY_PART * self._period_s

    @property
    def early_end_s(self) -> float:
        """Until when a reading may begin."""
        return self._command_s + self.early_s

    def note_command(self, now_s: float) -> None:
        """Note that a command has come."""
        self._period_s = min(max(now_s - self._command_s, 0.0), LONGEST_PERIOD_S)
        self._command_s = now_s

    def is_early(self, now_s: float) -> bool:
        """Say whether a reading begun now is over before the next command."""
        return now_s - self._command_s <= EARLY_PART * self._period_s

    def is_overdue(self, age_s: float) -> bool:
        """Say whether a reading is too old to wait for a better moment."""
        return age_s >= max(OVERDUE_S, OVERDUE_PERIODS * self._period_s)
