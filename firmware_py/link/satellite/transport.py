"""MAVLink by messages over a satellite: an Iridium modem on a serial line, with one peer ashore."""

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
from firmware_py.link.satellite.messages import EPOCH_S, MARK, UNITS_HZ, Keyed, Window, open_keyed
from firmware_py.link.satellite.record import KEPT_MESSAGES, Ledger, Limits, Record, from_bytes, to_bytes
from firmware_py.link.wire.frames import Splitter
from firmware_py.link.wire.transport import Address
from firmware_py.link.wire.urls import LinkClass, LinkUrl

_SHORE: Address = "shore"
_BYTE_RATE = 30.0  # a session of 340 bytes takes ten seconds and more
_HOUR_S, _DAY_S = 3600.0, 86400.0
_AHEAD_S = _DAY_S  # maximum lead of the sender's clock
_TEXTS, _TEXTS_HZ = 6, 1.0 / 1800.0  # burst, and average
_SAME_TEXT_S = 3600.0


class SbdTransport:
    """The peer ashore; implements transport.MessageTransport.

    A message is handed on once its number is stored as used: after a power cut it does not count twice.
    """

    datagrams = False
    radio = True
    blocked_reason = ""  # see satellite_status
    exposed = True  # anyone may send messages to the modem
    byte_rate: float | None = _BYTE_RATE

    def __init__(
        self,
        url: LinkUrl,
        line: ByteLine,
        vault: Vault,
        utc_s: Callable[[], float],
        report: Callable[[Event], None],
    ) -> None:
        """Take the line of the modem, the storage of the record, the clock, and the function that reports an event."""
        self.name = url.text
        self.options = replace(url.options, link_class=LinkClass.MESSAGES)
        self._line, self._vault, self._utc_s, self._report_event = line, vault, utc_s, report
        self._record = self._read_record()
        self._driver = SatelliteDriver(self._record.ledger, _settings(ParameterSet()), self._store_ledger, report)
        self._parameters: Callable[[], ParameterSet] = ParameterSet
        self._code: Callable[[bytes], bytes | None] = lambda _covered: None
        self._vouch: Callable[[bytes], None] = lambda _frame: None
        self._classifier = messages.FrameClassifier()
        self._texts = TokenBucket(_TEXTS, _TEXTS_HZ)
        self._sent_s: dict[bytes, float] = {}
        self._ready: list[tuple[bytes, bool]] = []  # frames that count, and whether the key vouches for them
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._openings = line.openings
        self._now_s = 0.0

    def attach(
        self,
        parameters: Callable[[], ParameterSet],
        code: Callable[[bytes], bytes | None],
        vouch: Callable[[bytes], None],
    ) -> None:
        """Take the parameters in force, the HMAC by the boat's key, and the function that marks a frame as signed."""
        self._parameters, self._code, self._vouch = parameters, code, vouch

    # ------------------------------------------------------------------ transport.Transport

    def descriptors(self) -> Sequence[int]:
        """Return the line's descriptor while it is open, and the one that wakes for accepted messages."""
        descriptor = self._line.fileno()
        return (self._wake_fd,) if descriptor < 0 else (descriptor, self._wake_fd)

    def receive(self, descriptor: int) -> Sequence[tuple[Address, bytes]]:
        """Take bytes from the modem; return accepted frames."""
        if descriptor == self._wake_fd:
            with contextlib.suppress(BlockingIOError):
                os.eventfd_read(self._wake_fd)
            ready, self._ready = self._ready, []
            for frame, vouched in ready:
                if vouched:
                    self._vouch(frame)
            return [(_SHORE, frame) for frame, _ in ready]
        self._driver.feed(self._line.read(), self._now_s)
        self._go_on()
        return ()

    def send(self, address: Address, data: bytes) -> bool:  # noqa: ARG002 - it has one only
        """Queue frames for the next session; always True, since dropped ones are counted there."""
        for frame in messages.frames_of(data):
            kind, shortest = self._classifier.kind_of(frame), messages.shortest(frame)
            if shortest is None:
                continue
            if messages.is_text(frame) and not self._may_send_text(shortest):
                self._driver.queue.dropped[kind] += 1
            else:
                self._driver.queue.offer(kind, shortest)
        return True

    def _may_send_text(self, text: bytes) -> bool:
        """Return whether a text may be sent: not again within an hour, and at a limited rate."""
        same, now_s = text[messages.TEXT_PLACE : -2], self._now_s
        told_s = self._sent_s.get(same)
        if (told_s is not None and now_s - told_s < _SAME_TEXT_S) or not self._texts.spend_one(now_s):
            return False
        self._sent_s = {text: at_s for text, at_s in self._sent_s.items() if now_s - at_s < _SAME_TEXT_S}
        self._sent_s[same] = now_s
        return True

    def addresses(self) -> Sequence[Address]:
        """Return the peer ashore."""
        return (_SHORE,)

    def connections(self) -> Sequence[Address]:
        """Return no peers: a modem has no incoming connections."""
        return ()

    def host(self, address: Address) -> Address:
        """Return the peer itself."""
        return address

    def drop(self, address: Address) -> None:
        """Do nothing: the peer is permanent."""

    def poll(self, now_s: float) -> None:
        """Continue the dialogue with the modem."""
        self._now_s = now_s
        self._go_on()

    def close(self) -> None:
        """Close the wake-up descriptor, once; the opener closes the line."""
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

    def _go_on(self) -> None:
        if self._line.openings != self._openings:
            self._openings = self._line.openings
            self._driver.restart(self._now_s)
        self._driver.settings = _settings(self._parameters())
        out = self._driver.update(self._now_s, self._utc_s())
        if out:
            self._line.write(out)
        received, self._driver.received = self._driver.received, []
        for number, content in received:
            self._judge(number, content)

    # ------------------------------------------------------------------ received messages

    def _judge(self, number: int, content: bytes) -> None:
        """Hand on the frames of a message once its use is stored; refuse an invalid one."""
        if content[:1] == bytes((MARK,)):
            opened = open_keyed(content, self._driver.modem.imei, self._code)
            if isinstance(opened, str):
                self._driver.refuse(opened)
            elif problem := self._problem_of(opened):
                self._driver.refuse(problem)
            else:
                self._store(replace(self._record, window=self._record.window.with_number(opened.number)))
                self._hand_on([(opened.frame, True)])
            return
        frames = [(frame.data, False) for frame in Splitter().feed(content, 0.0)]
        check = (number, zlib.crc32(content))
        if not frames:
            self._driver.refuse("no whole frame")
        elif check in self._record.seen:
            self._driver.refuse("came before")
        else:
            self._store(replace(self._record, seen=(*self._record.seen, check)[-KEPT_MESSAGES:]))
            self._hand_on(frames)

    def _problem_of(self, opened: Keyed) -> str:
        age_s, oldest_s = opened.age_s(self._utc_s()), self._parameters()["SBD_MT_DAYS"] * _DAY_S
        if not self._record.window.admits(opened.number):
            return "came before"
        if is_possible(self._utc_s()) and not -_AHEAD_S <= age_s <= oldest_s:
            return "too old" if age_s > 0.0 else "written in the future"
        return ""

    def _hand_on(self, frames: Sequence[tuple[bytes, bool]]) -> None:
        def stored(_well: bool) -> None:  # noqa: FBT001 - the vault's callback; commands are accepted even if the disk fails
            self._ready += frames
            if self._wake_fd >= 0:
                os.eventfd_write(self._wake_fd, 1)

        self._vault.when_stored(stored)

    # ------------------------------------------------------------------ the record

    def _store(self, record: Record) -> None:
        self._record = record
        self._vault.save(to_bytes(record))

    def _store_ledger(self, ledger: Ledger) -> None:
        self._store(replace(self._record, ledger=ledger))

    def _read_record(self) -> Record:
        """Return the record of earlier runs; if a part of it is lost, no message from before now is accepted."""
        stored, record = self._vault.load(), Record()
        is_whole = not stored.content and not stored.damage
        if stored.content:
            try:
                record, notes = from_bytes(stored.content)
                is_whole = not notes
                for note in notes:
                    self._report_event(Event(Severity.WARNING, f"Satellite record: {note}"))
            except ValueError as error:
                self._report_event(Event(Severity.WARNING, f"Satellite record damaged, new one started: {error}"))
        if not is_whole:
            now = max(0, int((self._utc_s() - EPOCH_S) * UNITS_HZ))
            record = replace(record, window=Window(floor=now))
            self._vault.save(to_bytes(record))  # the next start may not detect the loss
        return record


def _settings(parameters: ParameterSet) -> Settings:
    limits = Limits(int(parameters["SBD_DAY_CRED"]), int(parameters["SBD_MONTH_CRED"]), int(parameters["SBD_CREDIT_B"]))
    return Settings(limits, int(parameters["SBD_CSQ_MIN"]), parameters["SBD_CHECK_H"] * _HOUR_S)
