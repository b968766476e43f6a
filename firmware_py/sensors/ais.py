"""Reads a receiver or transponder of AIS, on a port of its own or among the sentences of another device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, DeviceRole
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.common.vessels import VesselIdentity, VesselReport, merged
from firmware_py.sensors.ais_messages import MOST_MMSI, reports_of
from firmware_py.sensors.ais_payload import read_payload
from firmware_py.sensors.ais_sentences import Assembler, Message, SentenceFinder
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import RANGE, MessageError

# The two channels have 75 slots a second; a tick of the slowest loop holds what one read gives.
MOST_SENTENCES_HZ, MOST_SENTENCES_AT_ONCE = 80.0, 100
MOST_REPORTS = 40  # handed to one tick
MOST_WAITING = 256
SILENT_AFTER_S = 600.0  # at sea there may be nobody


@dataclass(frozen=True, slots=True)
class AisOptions:
    """What the vehicle file may say of AIS."""

    own_mmsi: int = option(
        "the boat's own number: whoever else sends it is refused; 0: learned from what her transponder says of itself",
        default=0,
        minimum=0,
        maximum=MOST_MMSI,
    )

    def __post_init__(self) -> None:
        """Check the number."""
        check(self)


class AisReceiver:
    """Gives what other vessels say of themselves, the newest of each, in the order in which they were first heard.

    It is read once a tick, behind all that steers, and never wakes the loop. One read (4096 bytes) a tick, so many
    sentences a second, so many reports a tick: what is more is dropped and counted. Two reports of one vessel that
    wait are one. What is sent from here (VDO) is not another vessel; who else sends the boat's own number is refused.
    """

    def __init__(self, line: ByteLine, options: AisOptions) -> None:
        """Read the line."""
        self._line = line
        self._own_mmsi = options.own_mmsi
        self._learns = not options.own_mmsi
        self._monitor = DeviceMonitor(line, DeviceRole.AIS, SILENT_AFTER_S)
        self._finder, self._assembler = SentenceFinder(), Assembler()
        self._budget = TokenBucket(MOST_SENTENCES_AT_ONCE, MOST_SENTENCES_HZ)
        self._waiting: dict[tuple[type[VesselReport], int], VesselReport] = {}

    def fileno(self) -> int:
        """Nothing to wait for: other ships can wait until the tick."""
        return -1

    def receive(self, now_s: float) -> None:
        """Read what has arrived and decode it, stamped now_s, as far as the budget goes."""
        if self._monitor.notice_reopening():
            self._finder, self._assembler = SentenceFinder(), Assembler()
        data = self._line.read()
        if not data:
            return
        self._monitor.note_bytes(now_s)
        dropped = 0
        for body, checksum in self._finder.feed(data):
            if self._budget.spend_one(now_s):
                self._handle(body, checksum, now_s)
            else:
                dropped += 1
        if dropped:
            self._monitor.reject(now_s, "more than she reads, dropped", dropped)

    def poll(self) -> Sequence[VesselReport]:
        """Hand over reports since the last poll, at most MOST_REPORTS, oldest first; positions first, as in the log."""
        if not self._waiting:
            return ()
        keys = sorted(islice(self._waiting, MOST_REPORTS), key=lambda key: key[0] is VesselIdentity)
        return [self._waiting.pop(key) for key in keys]

    def health(self, now_s: float) -> DeviceHealth:
        """The state; every message that tells something counts."""
        return self._monitor.health(now_s)

    def _handle(self, body: bytes, checksum: int, now_s: float) -> None:
        try:
            message = self._assembler.take(body, checksum, now_s)
            reports = () if message is None else self._reports(message, now_s)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        if not reports:
            return
        self._monitor.accept(now_s)
        for report in reports:
            key = (type(report), report.mmsi)
            if key not in self._waiting and len(self._waiting) >= MOST_WAITING:
                self._monitor.reject(now_s, "more vessels than she takes in, dropped")
                continue
            before = self._waiting.get(key)
            if isinstance(before, VesselIdentity) and isinstance(report, VesselIdentity):
                self._waiting[key] = merged(before, report)
            else:
                self._waiting[key] = report

    def _reports(self, message: Message, now_s: float) -> tuple[VesselReport, ...]:
        """Return what a message tells of another vessel; of the boat itself only its number is kept."""
        payload = read_payload(message.payload, message.fill_bits)
        if payload is None:
            return ()
        if message.own:
            if self._learns:
                self._own_mmsi = payload.mmsi
            self._monitor.accept(now_s)
            return ()
        if payload.mmsi == self._own_mmsi:
            raise MessageError(RANGE, f"another ship sends her number {payload.mmsi:09d}")
        return reports_of(payload, now_s)
