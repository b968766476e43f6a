"""Messages by satellite: decides when to start a session and what it carries, and handles its result."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import msgspec

from firmware_py.common.link_status import session_error_text
from firmware_py.common.records import Event, Severity
from firmware_py.link.satellite.messages import Bundle, Kind, MessageQueue
from firmware_py.link.satellite.modem import Modem, Session
from firmware_py.link.satellite.record import Ledger, Limits

# Maximum random wait after each failure, then _RETRY_LATER_S. Source: Ground Control, Adaptive Retry.
_RETRY_S = (5.0, 5.0, 30.0, 30.0)
_RETRY_LATER_S = 300.0
_RETRY_LATEST_S = 3600.0  # limit of the wait, which doubles while each failure may have cost something
_REGISTERED_S = 180.0  # wait after status 36, too early after the last registration
_TOO_EARLY = 36
# With these the gateway may have received the message: it is counted as paid.
_UNCLEAR = frozenset({None, 13, 17, 18, 19})
_WEAK_S, _WEAK_LONGEST_S = 15.0, 120.0  # between signal measurements, doubled each time
_SILENT_S = 60.0  # a modem without response for longer is reported
_BLOCKED_S = 1800.0  # a session that is blocked for longer is reported; a seaway hides the sky for less


class Settings(msgspec.Struct, frozen=True):
    """Settings by parameters: limits, minimum signal, and the interval of mailbox checks."""

    limits: Limits
    min_signal: int
    mailbox_s: float  # 0: never


@dataclass(slots=True)
class Counts:
    """Counters since the start."""

    sessions: int = 0
    failed: int = 0
    sent: int = 0  # messages
    sent_bytes: int = 0
    received: int = 0
    refused: dict[str, int] = field(default_factory=dict)  # messages received, by the reason


class SatelliteDriver:
    """One modem, its queue and its budget; without I/O, time is an argument.

    A session is charged before it starts and refunded if it has certainly cost nothing, so that neither a power cut nor
    a lost answer makes the bill larger than the count. A received message is charged when it comes.
    """

    def __init__(
        self,
        ledger: Ledger,
        settings: Settings,
        spent: Callable[[Ledger], None],
        report: Callable[[Event], None],
        seed: int = 0,
    ) -> None:
        """Take the ledger of earlier runs, the settings, and functions that store the ledger and report an event."""
        self.modem = Modem()
        self.queue = MessageQueue()
        self.counts = Counts()
        self.ledger = ledger
        self.settings = settings
        self.received: list[tuple[int, bytes]] = []  # number of the network, message
        self.session_s: float | None = None  # time of the latest successful session
        self.status: int | None = None  # of the last session
        self.blocked_reason = ""  # why the session that is due cannot start
        self._spent, self._report = spent, report
        self._chance = random.Random(seed)  # noqa: S311 - it spreads calls, and guards nothing
        self._bundle: Bundle | None = None  # in the present session
        self._charge = 0
        self._failures = 0
        self._unclear = 0  # of these, in a row, such as may have cost something
        self._next_s = 0.0
        self._weak_s = _WEAK_S
        self._measured = False  # by the last dialogue with the modem
        self._looked_s = 0.0
        self._more_ashore = False
        self._due_since_s: float | None = None
        self._reported_silent = self._reported_blocked = False
        self._reported_credits_day = -1

    # ------------------------------------------------------------------ bytes

    def restart(self, now_s: float) -> None:
        """Restart after the line to the modem was lost."""
        if self._bundle is not None:
            self._end(Session(tried=True), now_s)
        self.modem.restart()

    def feed(self, data: bytes, now_s: float) -> None:
        """Take bytes of the modem."""
        self.modem.feed(data, now_s)
        self._take_sessions(now_s)

    def update(self, now_s: float, utc_s: float) -> bytes:
        """Do the work that is due and return the bytes to be written to the modem."""
        out = self.modem.update(now_s)
        self._take_sessions(now_s)
        self.ledger = self.ledger.at(utc_s, self._charge)
        self._watch(now_s)
        if not out and self.modem.ready and self._bundle is None and now_s >= self._next_s:
            self._call(now_s)
            out = self.modem.update(now_s)
        return out

    # ------------------------------------------------------------------ out

    def _call(self, now_s: float) -> None:
        bundle = self._due(now_s)
        if bundle is None:
            self._due_since_s = None
            self.blocked_reason = "credits used up" if len(self.queue) or self.modem.ringing else ""
            return
        if self._due_since_s is None:
            self._due_since_s = now_s
        if not self._measured or now_s - self.modem.idle_since_s > _WEAK_S:
            self._measured = True
            self.modem.measure_signal(now_s)
            return
        signal = self.modem.signal
        if signal is None or signal < self.settings.min_signal:
            self._next_s = now_s + self._weak_s
            self._weak_s = min(2.0 * self._weak_s, _WEAK_LONGEST_S)
            self._measured = False
            self.blocked_reason = "no signal known" if signal is None else f"signal {signal} of 5"
            return
        self._weak_s, self._measured = _WEAK_S, False
        self._charge = self.settings.limits.cost(len(bundle.content))
        self._bundle = bundle
        self._set_ledger(self.ledger.charged(self._charge))
        self.counts.sessions += 1
        self.modem.begin(bundle.content, now_s)

    def _due(self, now_s: float) -> Bundle | None:
        """Return the bundle to be sent now, an empty one for a mailbox check; None if no session is due."""
        limits, ledger = self.settings.limits, self.ledger
        rooms = {kind: ledger.room(limits, kind) for kind in Kind}
        bundle = self.queue.compose(lambda kind, size: limits.cost(size) <= rooms[kind])
        if bundle.frames:
            return bundle
        if len(self.queue):
            self._report_credits_used(rooms)
        mailbox_s = self.settings.mailbox_s
        look = mailbox_s > 0.0 and now_s - self._looked_s >= mailbox_s
        wanted = self.modem.ringing or self._more_ashore or look
        return bundle if wanted and rooms[Kind.MAILBOX] >= 1 else None

    def _report_credits_used(self, rooms: Mapping[Kind, float]) -> None:
        if rooms[Kind.REPORT] < 1 and self._reported_credits_day != self.ledger.day:
            self._reported_credits_day = self.ledger.day
            used = f"{self.ledger.day_used} today, {self.ledger.month_used} this month"
            self._report(Event(Severity.WARNING, f"Satellite credits used up: {used}"))

    # ------------------------------------------------------------------ in

    def _take_sessions(self, now_s: float) -> None:
        while (session := self.modem.take_session()) is not None:
            self._end(session, now_s)

    def _end(self, session: Session, now_s: float) -> None:
        bundle, self._bundle = self._bundle, None
        charge, self._charge = self._charge, 0
        ledger = self.ledger
        if session.content is not None:
            self.received.append((session.number, session.content))
            self.counts.received += 1
        elif session.damaged:
            self.refuse("damaged on the line of the modem")
        if session.length:
            ledger = ledger.charged(self.settings.limits.cost(session.length))
        if bundle is not None:
            self.status = session.status
            paid = session.sent or (session.tried and session.status in _UNCLEAR)
            # A session that receives a message costs that message only.
            if not paid or (not bundle.frames and session.length):
                ledger = ledger.charged(-charge)
            if session.sent:
                self._take_as_sent(bundle, now_s)
            if session.sent and not session.unread:
                self._failures = self._unclear = 0
                self._next_s = now_s
                self._due_since_s, self.blocked_reason = None, ""
                if self._reported_blocked:
                    self._reported_blocked = False
                    self._report(Event(Severity.NOTICE, "Satellite link recovered"))
            else:
                self._unclear = self._unclear + 1 if paid else 0
                self._fail(session, now_s)
        if session.sent:
            self._more_ashore = session.unread or session.queued > 0
        self._set_ledger(ledger)

    def _take_as_sent(self, bundle: Bundle, now_s: float) -> None:
        self.queue.remove(bundle)
        self.counts.sent += bool(bundle.frames)
        self.counts.sent_bytes += len(bundle.content)
        self.session_s = self._looked_s = now_s

    def _fail(self, session: Session, now_s: float) -> None:
        self.counts.failed += 1
        self.blocked_reason = "message not handed over" if session.sent else session_error_text(session.status)
        if self._failures < len(_RETRY_S):
            wait_s = self._chance.uniform(0.0, _RETRY_S[self._failures])
        else:
            later_s = min(_RETRY_LATER_S * 2.0 ** max(0, self._unclear - len(_RETRY_S)), _RETRY_LATEST_S)
            wait_s = later_s * self._chance.uniform(0.8, 1.2)
        self._next_s = now_s + max(wait_s, _REGISTERED_S if session.status == _TOO_EARLY else 0.0)
        self._failures += 1

    def refuse(self, reason: str) -> None:
        """Count a refused message; the first for each reason is reported."""
        first = reason not in self.counts.refused
        self.counts.refused[reason] = self.counts.refused.get(reason, 0) + 1
        if first:
            self._report(Event(Severity.NOTICE, f"Satellite message refused: {reason}"))

    # ------------------------------------------------------------------

    def _set_ledger(self, ledger: Ledger) -> None:
        if ledger != self.ledger:
            self.ledger = ledger
            self._spent(ledger)

    def _watch(self, now_s: float) -> None:
        since_s = self.modem.failing_since_s
        silent = since_s is not None and now_s - since_s > _SILENT_S
        if silent != self._reported_silent:
            self._reported_silent = silent
            text = "Satellite modem not responding" if silent else "Satellite modem recovered"
            self._report(Event(Severity.WARNING if silent else Severity.NOTICE, text))
        kept = self._due_since_s is not None and now_s - self._due_since_s > _BLOCKED_S
        if kept and not self._reported_blocked and not silent and self.blocked_reason:
            self._reported_blocked = True
            self._report(Event(Severity.WARNING, f"Satellite out of reach: {self.blocked_reason}"))
