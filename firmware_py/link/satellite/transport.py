"""MAVLink in satellite messages: an Iridium modem on a serial line, with one peer ashore."""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from firmware_py.common.calendar import is_possible
from firmware_py.common.interfaces import ByteLine, Vault
from firmware_py.common.link_status import SatelliteStatus
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Event, Severity
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.satellite import messages
from firmware_py.link.satellite.driver import SatelliteDriver, Settings
from firmware_py.link.satellite.messages import (
    EPOCH_S,
    NUMBERS_HZ,
    SHORT_FORM_MARK,
    AuthenticatedFrame,
    Window,
    open_short_form,
)
from firmware_py.link.satellite.record import MAX_STORED_MESSAGES, Ledger, Limits, Record, from_bytes, to_bytes
from firmware_py.link.wire.frames import Splitter
from firmware_py.link.wire.transport import Address
from firmware_py.link.wire.urls import LinkClass, LinkUrl

_SHORE: Address = "shore"
_BYTE_RATE = 30.0  # bytes per second: a session of 340 bytes takes at least ten seconds
_HOUR_S, _DAY_S = 3600.0, 86400.0
_MAX_LEAD_S = _DAY_S  # of the clock of the sender
_MAX_BURST_TEXTS, _MAX_TEXTS_HZ = 6, 1.0 / 1800.0
_MIN_REPEAT_S = 3600.0  # minimum time between two equal texts


class SbdTransport:
    """Transport to the peer ashore by satellite messages; implements transport.MessageTransport.

    The frames of a received message are passed on after its number is stored as used, so that the message is not
    executed again after a power cut.
    """

    is_datagram = False
    has_radio_rates = True
    blocked_reason = ""  # it is part of satellite_status
    is_exposed = True  # anyone can send messages to the modem
    byte_rate: float | None = _BYTE_RATE

    def __init__(
        self,
        url: LinkUrl,
        line: ByteLine,
        vault: Vault,
        utc_s: Callable[[], float],
        report: Callable[[Event], None],
    ) -> None:
        """Store the line of the modem, the storage of the record, the clock, and the function that reports an event."""
        self.name = url.text
        self.options = replace(url.options, link_class=LinkClass.MESSAGES)
        self._line, self._vault, self._utc_s, self._report_event = line, vault, utc_s, report
        self._record = self._read_record()
        self._driver = SatelliteDriver(self._record.ledger, _settings(ParameterSet()), self._store_ledger, report)
        self._parameters: Callable[[], ParameterSet] = ParameterSet
        self._compute_hmac: Callable[[bytes], bytes | None] = lambda _covered: None
        self._mark_signed: Callable[[bytes], None] = lambda _frame: None
        self._classifier = messages.FrameClassifier()
        self._texts = TokenBucket(_MAX_BURST_TEXTS, _MAX_TEXTS_HZ)
        self._text_sent_s: dict[bytes, float] = {}
        self._accepted: list[tuple[bytes, bool]] = []  # frames, and whether they have a valid HMAC
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._openings = line.openings
        self._now_s = 0.0

    def attach(
        self,
        parameters: Callable[[], ParameterSet],
        compute_hmac: Callable[[bytes], bytes | None],
        mark_signed: Callable[[bytes], None],
    ) -> None:
        """Store three functions of the link: see `Satellite.attach` of wire/transport.py."""
        self._parameters, self._compute_hmac, self._mark_signed = parameters, compute_hmac, mark_signed

    # ------------------------------------------------------------------ transport.Transport

    def descriptors(self) -> Sequence[int]:
        """Return the descriptor of the open line, and the event descriptor that signals accepted messages."""
        descriptor = self._line.fileno()
        return (self._wake_fd,) if descriptor < 0 else (descriptor, self._wake_fd)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Read from the modem, or return the accepted frames."""
        if descriptor == self._wake_fd:
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
            accepted, self._accepted = self._accepted, []
            for frame, is_authenticated in accepted:
                if is_authenticated:
                    self._mark_signed(frame)
            return [(_SHORE, frame) for frame, _ in accepted]
        self._driver.feed(self._line.read(), self._now_s)
        self._update()
        return ()

    def send(self, address: Address, data: bytes) -> bool:  # noqa: ARG002 - there is only one
        """Queue frames for the next session. Return True in any case, since the queue counts dropped frames."""
        for frame in messages.split_batch(data):
            kind, short_frame = self._classifier.kind_of(frame), messages.shorten(frame)
            if short_frame is None:
                continue
            if messages.is_text(frame) and not self._may_send_text(short_frame):
                self._driver.queue.dropped[kind] += 1
            else:
                self._driver.queue.offer(kind, short_frame)
        return True

    def _may_send_text(self, frame: bytes) -> bool:
        """Return whether a text may be sent: an equal one at most once per hour, and all at a limited rate."""
        text, now_s = frame[messages.TEXT_OFFSET : -2], self._now_s
        sent_s = self._text_sent_s.get(text)
        if (sent_s is not None and now_s - sent_s < _MIN_REPEAT_S) or not self._texts.spend_one(now_s):
            return False
        recent = {other: sent_s for other, sent_s in self._text_sent_s.items() if now_s - sent_s < _MIN_REPEAT_S}
        self._text_sent_s = recent | {text: now_s}
        return True

    def addresses(self) -> Sequence[Address]:
        """Return the peer ashore."""
        return (_SHORE,)

    def connections(self) -> Sequence[Address]:
        """Return no peers: a modem has no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the address itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the peer is permanent."""

    def poll(self, now_s: float) -> None:
        """Continue the dialogue with the modem."""
        self._now_s = now_s
        self._update()

    def close(self) -> None:
        """Close the event descriptor; the caller closes the line. A second call does nothing."""
        wake_fd, self._wake_fd = self._wake_fd, -1
        if wake_fd >= 0:
            os.close(wake_fd)

    # ------------------------------------------------------------------ satellite

    def satellite_status(self, now_s: float) -> SatelliteStatus:
        """Return the status of modem, sessions and budget."""
        driver = self._driver
        ledger, limits, counts = driver.ledger, driver.settings.limits, driver.counts
        return SatelliteStatus(
            imei=driver.modem.imei,
            signal=driver.modem.signal,
            waiting=len(driver.queue),
            dropped=sum(driver.queue.dropped.values()),
            sessions=counts.sessions,
            failed=counts.failed,
            last_status=driver.status,
            blocked_reason=driver.blocked_reason,
            session_age_s=None if driver.session_s is None else now_s - driver.session_s,
            sent=counts.sent,
            sent_bytes=counts.sent_bytes,
            received=counts.received,
            refused=dict(counts.refused),
            day_credits=ledger.day_used,
            day_limit=limits.day,
            month_credits=ledger.month_used,
            month_limit=limits.month,
            total_credits=ledger.total,
        )

    def _update(self) -> None:
        if self._line.openings != self._openings:
            self._openings = self._line.openings
            self._driver.restart(self._now_s)
        self._driver.settings = _settings(self._parameters())
        output = self._driver.update(self._now_s, self._utc_s())
        if output:
            self._line.write(output)
        received, self._driver.received = self._driver.received, []
        for number, content in received:
            self._process_message(number, content)

    # ------------------------------------------------------------------ received messages

    def _process_message(self, number: int, content: bytes) -> None:
        """Accept or refuse a received message."""
        if content[:1] == bytes((SHORT_FORM_MARK,)):
            opened = open_short_form(content, self._driver.modem.imei, self._compute_hmac)
            if isinstance(opened, str):
                self._driver.refuse(opened)
            elif reason := self._refusal_reason(opened):
                self._driver.refuse(reason)
            else:
                self._store(replace(self._record, window=self._record.window.with_number(opened.number)))
                self._accept_when_stored([(opened.frame, True)])
            return
        frames = [(frame.data, False) for frame in Splitter().feed(content, 0.0)]
        identity = (number, zlib.crc32(content))
        if not frames:
            self._driver.refuse("no whole frame")
        elif identity in self._record.seen:
            self._driver.refuse("came before")
        else:
            self._store(replace(self._record, seen=(*self._record.seen, identity)[-MAX_STORED_MESSAGES:]))
            self._accept_when_stored(frames)

    def _refusal_reason(self, message: AuthenticatedFrame) -> str:
        """Return why a message is refused: repeated, too old or in the future; empty if it is accepted."""
        age_s, max_age_s = message.age_s(self._utc_s()), self._parameters()["SBD_MT_DAYS"] * _DAY_S
        if not self._record.window.admits(message.number):
            return "came before"
        if is_possible(self._utc_s()) and not -_MAX_LEAD_S <= age_s <= max_age_s:
            return "too old" if age_s > 0.0 else "written in the future"
        return ""

    def _accept_when_stored(self, frames: Sequence[tuple[bytes, bool]]) -> None:
        def accept(_is_stored: bool) -> None:  # noqa: FBT001 - callback; commands are accepted even if the disk fails
            self._accepted += frames
            if self._wake_fd >= 0:
                os.eventfd_write(self._wake_fd, 1)

        self._vault.when_stored(accept)

    # ------------------------------------------------------------------ the record

    def _store(self, record: Record) -> None:
        self._record = record
        self._vault.save(to_bytes(record))

    def _store_ledger(self, ledger: Ledger) -> None:
        self._store(replace(self._record, ledger=ledger))

    def _read_record(self) -> Record:
        """Return the stored record. If a part of it is lost, messages written before the present are not accepted."""
        stored, record = self._vault.load(), Record()
        is_complete = not stored.content and not stored.damage
        if stored.content:
            try:
                record, notes = from_bytes(stored.content)
                is_complete = not notes
                for note in notes:
                    self._report_event(Event(Severity.WARNING, f"Satellite record: {note}"))
            except ValueError as error:
                self._report_event(Event(Severity.WARNING, f"Satellite record damaged, new one started: {error}"))
        if not is_complete:
            present_number = max(0, int((self._utc_s() - EPOCH_S) * NUMBERS_HZ))
            record = replace(record, window=Window(floor=present_number))
            self._vault.save(to_bytes(record))  # immediately, since the next start might not detect the loss
        return record


def _settings(parameters: ParameterSet) -> Settings:
    limits = Limits(int(parameters["SBD_DAY_CRED"]), int(parameters["SBD_MONTH_CRED"]), int(parameters["SBD_CREDIT_B"]))
    return Settings(limits, int(parameters["SBD_CSQ_MIN"]), parameters["SBD_CHECK_H"] * _HOUR_S)
