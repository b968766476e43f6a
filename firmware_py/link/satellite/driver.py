"""Satellite sessions: time and content of a session, and evaluation of its result."""

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

# Maximum of the random wait after each of the first failures. Source: Ground Control, Adaptive Retry.
_FIRST_RETRIES_S = (5.0, 5.0, 30.0, 30.0)
_LATER_RETRY_S = 300.0  # mean wait after further failures; it doubles while each failure may have been charged
_MAX_RETRY_S = 3600.0
_REGISTRATION_RETRY_S = 180.0  # minimum wait after status 36
_TOO_EARLY_STATUS = 36  # too soon after the last registration
# After these MO statuses the gateway may have received the message, so that the message counts as charged: no reply of
# the modem, session not completed, gateway not responding, connection lost, link failure.
_AMBIGUOUS_STATUSES = frozenset({None, 13, 17, 18, 19})
# Wait after a weak signal, doubled each time. A measurement older than the minimum is repeated before a session.
_MIN_SIGNAL_RETRY_S, _MAX_SIGNAL_RETRY_S = 15.0, 120.0
_SILENT_S = 60.0  # a modem that does not respond for longer is reported
_BLOCKED_S = 1800.0  # a session that is blocked for longer is reported; waves obstruct the sky for shorter times


class Settings(msgspec.Struct, frozen=True):
    """Settings from the parameters."""

    limits: Limits
    min_signal: int  # 0 to 5
    mailbox_s: float  # interval of mailbox checks; 0: no checks


@dataclass(slots=True)
class Counts:
    """Counters since start."""

    sessions: int = 0
    failed: int = 0  # sessions
    sent: int = 0  # messages
    sent_bytes: int = 0
    received: int = 0  # messages
    refused: dict[str, int] = field(default_factory=dict)  # received messages by the reason of the refusal


class SatelliteDriver:
    """Modem, message queue and budget, without input and output; the time is an argument.

    A session is charged before it starts, and refunded if it certainly cost nothing. So the ledger is at least the
    bill, even after a power cut or a lost reply. A received message is charged on reception.
    """

    def __init__(
        self,
        ledger: Ledger,
        settings: Settings,
        store_ledger: Callable[[Ledger], None],
        report: Callable[[Event], None],
        seed: int = 0,
    ) -> None:
        """Store the ledger of earlier runs, the settings, and functions that store the ledger and report an event."""
        self.modem = Modem()
        self.queue = MessageQueue()
        self.counts = Counts()
        self.ledger = ledger
        self.settings = settings
        self.received: list[tuple[int, bytes]] = []  # message number of the network, message
        self.session_s: float | None = None  # time of the latest successful session
        self.status: int | None = None  # MO status of the latest session
        self.blocked_reason = ""  # reason why a session that is due cannot start
        self._store_ledger, self._report = store_ledger, report
        self._rng = random.Random(seed)  # noqa: S311 - for the times of sessions only
        self._bundle: Bundle | None = None  # of the present session
        self._charge = 0  # credits of the present session
        self._failures = 0  # in sequence
        self._ambiguous_failures = 0  # of the latest failures, number in sequence that may have been charged
        self._next_s = 0.0  # earliest start of the next session
        self._signal_retry_s = _MIN_SIGNAL_RETRY_S
        self._is_signal_measured = False
        self._mailbox_checked_s = 0.0
        self._has_queued_messages = False  # in the network, for the boat
        self._due_since_s: float | None = None  # since when a session is due without success
        self._reported_silent = self._reported_blocked = False
        self._reported_credits_day = -1  # day of the ledger whose used-up credits were reported

    # ------------------------------------------------------------------ bytes

    def restart(self, now_s: float) -> None:
        """Restart after the line to the modem was lost."""
        if self._bundle is not None:
            self._end_session(Session(tried=True), now_s)
        self.modem.restart()

    def feed(self, data: bytes, now_s: float) -> None:
        """Evaluate bytes received from the modem; `update` evaluates a session that they end."""
        self.modem.feed(data, now_s)

    def update(self, now_s: float, utc_s: float) -> bytes:
        """Start a session if one is due; return the bytes for the modem."""
        output = self.modem.update(now_s)
        self._end_sessions(now_s)
        self.ledger = self.ledger.at(utc_s, self._charge)
        self._report_outage(now_s)
        if not output and self.modem.is_ready and self._bundle is None and now_s >= self._next_s:
            self._start_session(now_s)
            output = self.modem.update(now_s)
        return output

    # ------------------------------------------------------------------ start of a session

    def _start_session(self, now_s: float) -> None:
        """Start a session if one is due and the signal is sufficient; measure the signal first."""
        bundle = self._due_bundle(now_s)
        if bundle is None:
            self._due_since_s = None
            self.blocked_reason = "credits used up" if len(self.queue) or self.modem.is_ringing else ""
            return
        if self._due_since_s is None:
            self._due_since_s = now_s
        if not self._is_signal_measured or now_s - self.modem.idle_since_s > _MIN_SIGNAL_RETRY_S:
            self._is_signal_measured = True
            self.modem.measure_signal(now_s)
            return
        signal = self.modem.signal
        if signal is None or signal < self.settings.min_signal:
            self._next_s = now_s + self._signal_retry_s
            self._signal_retry_s = min(2.0 * self._signal_retry_s, _MAX_SIGNAL_RETRY_S)
            self._is_signal_measured = False
            self.blocked_reason = "no signal known" if signal is None else f"signal {signal} of 5"
            return
        self._signal_retry_s, self._is_signal_measured = _MIN_SIGNAL_RETRY_S, False
        self._charge = self.settings.limits.cost(len(bundle.content))
        self._bundle = bundle
        self._set_ledger(self.ledger.charged(self._charge))
        self.counts.sessions += 1
        self.modem.start_session(bundle.content, now_s)

    def _due_bundle(self, now_s: float) -> Bundle | None:
        """Return the bundle to be sent now, an empty one for a mailbox check; None if no session is due."""
        limits, ledger = self.settings.limits, self.ledger
        available = {kind: ledger.available(limits, kind) for kind in Kind}
        bundle = self.queue.compose(lambda kind, size: limits.cost(size) <= available[kind])
        if bundle.frames:
            return bundle
        if len(self.queue):
            self._report_credits_used(available)
        mailbox_s = self.settings.mailbox_s
        is_check_due = mailbox_s > 0.0 and now_s - self._mailbox_checked_s >= mailbox_s
        has_reason = self.modem.is_ringing or self._has_queued_messages or is_check_due
        return bundle if has_reason and available[Kind.MAILBOX] >= 1 else None

    def _report_credits_used(self, available: Mapping[Kind, float]) -> None:
        if available[Kind.REPORT] < 1 and self._reported_credits_day != self.ledger.day:
            self._reported_credits_day = self.ledger.day
            used = f"{self.ledger.day_used} today, {self.ledger.month_used} this month"
            self._report(Event(Severity.WARNING, f"Satellite credits used up: {used}"))

    # ------------------------------------------------------------------ end of a session

    def _end_sessions(self, now_s: float) -> None:
        while (session := self.modem.take_session()) is not None:
            self._end_session(session, now_s)

    def _end_session(self, session: Session, now_s: float) -> None:
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
            may_be_charged = session.sent or (session.tried and session.status in _AMBIGUOUS_STATUSES)
            # A mailbox check that receives a message costs the message only.
            if not may_be_charged or (not bundle.frames and session.length):
                ledger = ledger.charged(-charge)
            if session.sent:
                self._remove_sent(bundle, now_s)
            if session.sent and not session.unread:
                self._failures = self._ambiguous_failures = 0
                self._due_since_s, self.blocked_reason = None, ""
                if self._reported_blocked:
                    self._reported_blocked = False
                    self._report(Event(Severity.NOTICE, "Satellite link recovered"))
            else:
                self._ambiguous_failures = self._ambiguous_failures + 1 if may_be_charged else 0
                self._schedule_retry(session, now_s)
        if session.sent:
            self._has_queued_messages = session.unread or session.queued > 0
        self._set_ledger(ledger)

    def _remove_sent(self, bundle: Bundle, now_s: float) -> None:
        self.queue.remove(bundle)
        self.counts.sent += bool(bundle.frames)
        self.counts.sent_bytes += len(bundle.content)
        self.session_s = self._mailbox_checked_s = now_s

    def _schedule_retry(self, session: Session, now_s: float) -> None:
        self.counts.failed += 1
        self.blocked_reason = "message not handed over" if session.sent else session_error_text(session.status)
        first_retries = len(_FIRST_RETRIES_S)
        if self._failures < first_retries:
            wait_s = self._rng.uniform(0.0, _FIRST_RETRIES_S[self._failures])
        else:
            doublings = max(0, self._ambiguous_failures - first_retries)
            wait_s = min(_LATER_RETRY_S * 2.0**doublings, _MAX_RETRY_S) * self._rng.uniform(0.8, 1.2)
        self._next_s = now_s + max(wait_s, _REGISTRATION_RETRY_S if session.status == _TOO_EARLY_STATUS else 0.0)
        self._failures += 1

    def refuse(self, reason: str) -> None:
        """Count a refused message; report the first one of each reason."""
        is_first = reason not in self.counts.refused
        self.counts.refused[reason] = self.counts.refused.get(reason, 0) + 1
        if is_first:
            self._report(Event(Severity.NOTICE, f"Satellite message refused: {reason}"))

    # ------------------------------------------------------------------

    def _set_ledger(self, ledger: Ledger) -> None:
        if ledger != self.ledger:
            self.ledger = ledger
            self._store_ledger(ledger)

    def _report_outage(self, now_s: float) -> None:
        """Report a modem that does not respond, its recovery, and a session that is blocked for long."""
        since_s = self.modem.failing_since_s
        is_silent = since_s is not None and now_s - since_s > _SILENT_S
        if is_silent != self._reported_silent:
            self._reported_silent = is_silent
            text = "Satellite modem not responding" if is_silent else "Satellite modem recovered"
            self._report(Event(Severity.WARNING if is_silent else Severity.NOTICE, text))
        is_blocked = self._due_since_s is not None and now_s - self._due_since_s > _BLOCKED_S
        if is_blocked and not self._reported_blocked and not is_silent and self.blocked_reason:
            self._reported_blocked = True
            self._report(Event(Severity.WARNING, f"Satellite out of reach: {self.blocked_reason}"))
