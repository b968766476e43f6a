"""Half-duplex bus: one request at a time; a reply may arrive after its request was given up."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from firmware_py.common.interfaces import ByteLine

RequestT = TypeVar("RequestT")

SILENT_AFTER_S = 0.5
SILENT_AFTER_REQUESTS = 3  # one lost reply of a slow loop is not silence
EARLY_FRACTION = 0.5  # of the command period: the window for readings after a command
OVERDUE_S, OVERDUE_PERIODS = 0.25, 2.5  # age at which a reading is overdue: the longer of time and command periods
MAX_PERIOD_S = 1.0  # a longer interval between commands is a pause
MAX_REPLY_TIMEOUT_S = 1.0
ADAPTER_LATENCY_S = 0.016  # the latency timer of a USB adapter
BITS_PER_BYTE = 10
MAX_REPLY_DELAY_S = 2.0  # a reply to a request that was given up may arrive within this time


def reply_timeout_s(baud: int, exchange_bytes: int) -> float:
    """Return the reply timeout for exchanges of at most `exchange_bytes` bytes."""
    return min(ADAPTER_LATENCY_S + exchange_bytes * BITS_PER_BYTE / baud, MAX_REPLY_TIMEOUT_S)


class MatchedRequest(NamedTuple, Generic[RequestT]):
    """The oldest request that a reply matches; `is_certain` if it is the only one.

    `uncertain` is the newest request if the reply matches it, too; it is given up.
    """

    request: RequestT
    sent_s: float
    is_certain: bool = True
    uncertain: RequestT | None = None


class HalfDuplex(Generic[RequestT]):
    """Tracks the requests that wait for replies, and the time since the last reply.

    A reply that an adapter has delayed arrives after its request was given up and the next one was sent. Replies arrive
    in the order of the requests, so each belongs to the oldest request that it matches; earlier ones are discarded.
    """

    __slots__ = (
        *("_given_up_requests", "_line", "_openings", "_reply_timeout_s", "_lost_count", "_waiting_since_s"),
        *("pending_request", "sent_s"),
    )

    def __init__(self, line: ByteLine, reply_timeout_s: float) -> None:
        """Store the line and the reply timeout."""
        self._line = line
        self._reply_timeout_s = reply_timeout_s
        self._openings = line.openings
        self.sent_s = 0.0  # time of the last request
        self._lost_count = 0  # requests given up since the last reply
        self._waiting_since_s: float | None = None
        self._given_up_requests: deque[tuple[RequestT, float]] = deque()  # with the time of sending; oldest first
        self.pending_request: RequestT | None = None

    def notice_reopening(self) -> bool:
        """Return whether the line was reopened since the last call; if so, discard all requests."""
        if self._line.openings == self._openings:
            return False
        self._openings = self._line.openings
        self.end_exchange()
        return True

    def send(self, frame: bytes, request: RequestT, now_s: float) -> bool:
        """Write a frame, whose reply is then pending; return False if the line does not accept it."""
        if not self._line.write(frame):
            return False
        self.pending_request = request
        self.sent_s = now_s
        if self._waiting_since_s is None:
            self._waiting_since_s = now_s
        return True

    def end_exchange(self) -> None:
        """End the exchange after its reply, and discard the requests that were given up."""
        self.pending_request = None
        self._given_up_requests.clear()
        self._lost_count = 0
        self._waiting_since_s = None

    def match_reply(self, matches: Callable[[RequestT], bool]) -> MatchedRequest[RequestT] | None:
        """Return the request of a reply, None without one; `matches` checks whether a request matches.

        The bus is free if the reply matches the newest request. If the match is not certain, the newest is given up.
        """
        newest, newest_sent_s = self.pending_request, self.sent_s
        matches_newest = newest is not None and matches(newest)
        matching = [index for index, (request, _) in enumerate(self._given_up_requests) if matches(request)]
        if not matching:
            if newest is None or not matches_newest:
                return None
            self.end_exchange()
            return MatchedRequest(newest, newest_sent_s)
        for _ in range(matching[0]):
            self._given_up_requests.popleft()
        request, sent_s = self._given_up_requests.popleft()
        uncertain = newest if matches_newest else None
        if uncertain is not None:
            self._given_up_requests.append((uncertain, newest_sent_s))
            self.pending_request = None
        self._lost_count = 0
        self._waiting_since_s = None if self.pending_request is None else newest_sent_s
        return MatchedRequest(request, sent_s, len(matching) == 1 and uncertain is None, uncertain)

    def give_up_expired(self, now_s: float) -> RequestT | None:
        """Return the request that is given up now, once."""
        request = self.pending_request
        if request is None or now_s - self.sent_s < self._reply_timeout_s:
            return None
        self.pending_request = None
        while self._given_up_requests and now_s - self._given_up_requests[0][1] > MAX_REPLY_DELAY_S:
            self._given_up_requests.popleft()
        self._given_up_requests.append((request, self.sent_s))
        self._lost_count += 1
        return request

    def is_silent(self, now_s: float) -> bool:
        """Return whether the device has stopped replying."""
        waiting_since_s = self._waiting_since_s
        if waiting_since_s is None or self._lost_count < SILENT_AFTER_REQUESTS:
            return False
        return now_s - waiting_since_s >= SILENT_AFTER_S


class ReadingWindow:
    """The time window for readings between two commands.

    A reading late in the command period could occupy the bus at the next command, so it is only sent there when it is
    overdue.
    """

    __slots__ = ("_command_s", "_period_s")

    def __init__(self) -> None:
        """Start without a command."""
        self._command_s = -math.inf
        self._period_s = 0.0

    @property
    def early_s(self) -> float:
        """The duration of the window after the command."""
        return EARLY_FRACTION * self._period_s

    @property
    def early_end_s(self) -> float:
        """The end of the window."""
        return self._command_s + self.early_s

    def note_command(self, now_s: float) -> None:
        """Note a new command."""
        self._period_s = min(now_s - self._command_s, MAX_PERIOD_S)
        self._command_s = now_s

    def is_early(self, now_s: float) -> bool:
        """Return whether now_s is within the window."""
        return now_s - self._command_s <= EARLY_FRACTION * self._period_s

    def is_overdue(self, age_s: float) -> bool:
        """Return whether a reading is too old to wait for the window."""
        return age_s >= max(OVERDUE_S, OVERDUE_PERIODS * self._period_s)
