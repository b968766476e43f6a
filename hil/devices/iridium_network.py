"""The network behind an Iridium modem: signal, gateway with its queue, and costs."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

CREDIT_BYTES: Final = 50
NO_SERVICE, BUSY, TIMED_OUT, DROPPED, TOO_SOON = 32, 35, 17, 18, 36
NOT_COMPLETED = 13
_FAILURES = (NO_SERVICE, DROPPED, TIMED_OUT, BUSY, TOO_SOON, NOT_COMPLETED)


def clear_sky(_now_s: float) -> int:
    """Return a signal of five bars."""
    return 5


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a session: duration, status for the modem, and the message for the boat, if any."""

    duration_s: float
    status: int
    counted: bool  # the modem increments its message number
    message: tuple[int, bytes] | None
    waiting: int


@dataclass(slots=True)
class Bill:
    """Credits of the provider: whole credits for each message either way, one for a check of an empty mailbox."""

    from_boat: int = 0
    to_boat: int = 0
    looks: int = 0

    @property
    def total(self) -> int:
        """All credits."""
        return self.from_boat + self.to_boat + self.looks


class IridiumNetwork:
    """Transfers messages with random failures; all chances are drawn from `numbers`.

    `failed` is the share of sessions that fail, `lost_answers` the share of those whose message arrives although the
    modem gets a failure. `signal` returns the bars at a time, `lost_rings` is the share of alerts that are lost.
    """

    def __init__(
        self,
        numbers: np.random.Generator,
        *,
        failed: float = 0.0,
        lost_answers: float = 0.0,
        lost_rings: float = 0.0,
        duration_s: tuple[float, float] = (6.0, 25.0),
        signal: Callable[[float], int] = clear_sky,
    ) -> None:
        """Start with no messages in either direction."""
        self.failed = failed
        self.signal = signal
        self.bill = Bill()
        self.charges: list[tuple[float, int]] = []  # time and number of credits
        # Time, number of the modem, message.
        self.delivered: deque[tuple[float, int, bytes]] = deque()
        self.attempts = 0
        self._numbers = numbers
        self._lost_answers, self._lost_rings = lost_answers, lost_rings
        self._duration_s = duration_s
        self._queue: deque[tuple[int, bytes]] = deque()
        self._number = int(numbers.integers(0, 65536))
        self._rings = 0

    def send(self, message: bytes) -> None:
        """Queue a message to the boat; ValueError for an invalid length."""
        if not 1 <= len(message) <= 270:
            raise ValueError(f"a message to the boat has 1 to 270 bytes, not {len(message)}")
        self._number = (self._number + 1) & 0xFFFF
        self._queue.append((self._number, message))
        self._rings += 1

    @property
    def waiting(self) -> int:
        """The number of messages for the boat."""
        return len(self._queue)

    def take_ring(self, now_s: float) -> bool:
        """Return whether the modem receives an alert now; without a signal the alert is lost."""
        if not self._rings:
            return False
        self._rings -= 1
        return self.signal(now_s) > 0 and float(self._numbers.random()) >= self._lost_rings

    def session(self, now_s: float, number: int, message: bytes) -> Outcome:
        """Make a session with the modem's message, an empty one for none."""
        self.attempts += 1
        duration_s = float(self._numbers.uniform(*self._duration_s))
        chance, lot = float(self._numbers.random()), float(self._numbers.random())
        if self.signal(now_s) == 0:
            return Outcome(duration_s, NO_SERVICE, counted=False, message=None, waiting=0)
        if chance < self.failed:
            if message and lot < self._lost_answers:
                self._deliver(now_s, number, message)
                return Outcome(duration_s, NOT_COMPLETED, counted=False, message=None, waiting=0)
            status = _FAILURES[int(self._numbers.integers(0, len(_FAILURES)))]
            return Outcome(duration_s, status, counted=False, message=None, waiting=0)
        if message:
            self._deliver(now_s, number, message)
        received = self._queue.popleft() if self._queue else None
        if received is not None:
            self.bill.to_boat += self._charge(now_s, len(received[1]))
        elif not message:
            self.bill.looks += self._charge(now_s, 1)
        return Outcome(duration_s, 0, counted=True, message=received, waiting=len(self._queue))

    def _deliver(self, now_s: float, number: int, message: bytes) -> None:
        self.delivered.append((now_s, number, message))
        self.bill.from_boat += self._charge(now_s, len(message))

    def _charge(self, now_s: float, size_bytes: int) -> int:
        self.charges.append((now_s, math.ceil(size_bytes / CREDIT_BYTES)))
        return self.charges[-1][1]
