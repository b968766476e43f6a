"""The Iridium network as a modem uses it: signal, gateway with a message queue, and costs."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

CREDIT_BYTES: Final = 50
# Status of a failed session (first field of +SBDIX).
NO_SERVICE, BUSY, TIMED_OUT, DROPPED, TOO_SOON = 32, 35, 17, 18, 36
NOT_COMPLETED = 13
_FAILURES = (NO_SERVICE, DROPPED, TIMED_OUT, BUSY, TOO_SOON, NOT_COMPLETED)


def clear_sky(_now_s: float) -> int:
    """Return a signal of five bars."""
    return 5


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a session.

    `message` is the number (MTMSN) and the content of the message for the boat, if any; `queued` is the number of
    further ones.
    """

    duration_s: float
    status: int  # first field of +SBDIX; 0: success
    increments_number: bool  # the message number of the modem (MOMSN)
    message: tuple[int, bytes] | None
    queued: int


@dataclass(slots=True)
class Bill:
    """Credits charged by the provider for messages from and to the boat and for checks of an empty mailbox."""

    from_boat: int = 0
    to_boat: int = 0
    mailbox_checks: int = 0

    @property
    def total(self) -> int:
        """All credits."""
        return self.from_boat + self.to_boat + self.mailbox_checks


class IridiumNetwork:
    """Transfers messages with random failures, which are drawn from `rng`.

    `failed` is the share of sessions that fail, `lost_replies` the share of these whose message arrives although the
    modem gets a failure. `duration_s` is the range of the duration of a session.
    `signal` returns the bars at a time, `lost_alerts` is the share of alerts that are lost.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        *,
        failed: float = 0.0,
        lost_replies: float = 0.0,
        lost_alerts: float = 0.0,
        duration_s: tuple[float, float] = (6.0, 25.0),
        signal: Callable[[float], int] = clear_sky,
    ) -> None:
        """Start with no messages in either direction."""
        self.failed = failed
        self.signal = signal
        self.bill = Bill()
        self.charges: list[tuple[float, int]] = []  # time and number of credits
        # Time, number (MOMSN), message.
        self.delivered: deque[tuple[float, int, bytes]] = deque()
        self.attempts = 0
        self._rng = rng
        self._lost_replies, self._lost_alerts = lost_replies, lost_alerts
        self._duration_s = duration_s
        self._queue: deque[tuple[int, bytes]] = deque()
        self._number = int(rng.integers(0, 65536))
        self._alerts = 0

    def send(self, message: bytes) -> None:
        """Queue a message to the boat; raise ValueError for an invalid length."""
        if not 1 <= len(message) <= 270:
            raise ValueError(f"a message to the boat has 1 to 270 bytes, not {len(message)}")
        self._number = (self._number + 1) & 0xFFFF
        self._queue.append((self._number, message))
        self._alerts += 1

    @property
    def queued(self) -> int:
        """Number of messages for the boat in the queue."""
        return len(self._queue)

    def take_alert(self, now_s: float) -> bool:
        """Return whether the modem receives an alert now; without a signal the alert is lost."""
        if not self._alerts:
            return False
        self._alerts -= 1
        return self.signal(now_s) > 0 and float(self._rng.random()) >= self._lost_alerts

    def run_session(self, now_s: float, number: int, message: bytes) -> Outcome:
        """Run a session; `number` is the MOMSN, an empty message stands for no message from the boat."""
        self.attempts += 1
        duration_s = float(self._rng.uniform(*self._duration_s))
        failure_draw, arrival_draw = float(self._rng.random()), float(self._rng.random())
        if self.signal(now_s) == 0:
            return Outcome(duration_s, NO_SERVICE, increments_number=False, message=None, queued=0)
        if failure_draw < self.failed:
            if message and arrival_draw < self._lost_replies:
                self._deliver(now_s, number, message)
                return Outcome(duration_s, NOT_COMPLETED, increments_number=False, message=None, queued=0)
            status = _FAILURES[int(self._rng.integers(0, len(_FAILURES)))]
            return Outcome(duration_s, status, increments_number=False, message=None, queued=0)
        if message:
            self._deliver(now_s, number, message)
        received = self._queue.popleft() if self._queue else None
        if received is not None:
            self.bill.to_boat += self._charge(now_s, len(received[1]))
        elif not message:
            self.bill.mailbox_checks += self._charge(now_s, 1)
        return Outcome(duration_s, 0, increments_number=True, message=received, queued=len(self._queue))

    def _deliver(self, now_s: float, number: int, message: bytes) -> None:
        self.delivered.append((now_s, number, message))
        self.bill.from_boat += self._charge(now_s, len(message))

    def _charge(self, now_s: float, size_bytes: int) -> int:
        """Add a charge, rounded up to whole credits, and return it."""
        self.charges.append((now_s, math.ceil(size_bytes / CREDIT_BYTES)))
        return self.charges[-1][1]
