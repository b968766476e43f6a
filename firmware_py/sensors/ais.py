"""Driver of an AIS receiver or transponder, on its own port or on the port of another NMEA device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_py.common.driver import INTERFACE, Driver
from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, DeviceRole
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.common.vessels import VesselReport
from firmware_py.sensors.ais_messages import MAX_MMSI, decode_reports
from firmware_py.sensors.ais_payload import read_payload
from firmware_py.sensors.ais_sentences import Assembler, Message, SentenceFinder
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import RANGE, MessageError
from firmware_py.sensors.vessel_queue import VesselQueue

# The two channels have 75 time slots a second; the burst is what the slowest loop reads in one tick.
MAX_SENTENCES_HZ, MAX_SENTENCE_BURST = 80.0, 100
SILENT_AFTER_S = 600.0  # for minutes, no other vessel may be in range


@dataclass(frozen=True, slots=True)
class AisOptions:
    """Options of the vehicle file for AIS."""

    own_mmsi: int = option(
        "MMSI of the boat; reports of other stations with this MMSI are rejected. 0: taken from the boat's transponder",
        default=0,
        minimum=0,
        maximum=MAX_MMSI,
    )

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)


class AisReceiver:
    """Decodes the reports of other vessels; a queue holds the newest report of each vessel, in order of arrival.

    The loop reads AIS once a tick after all sensors for steering, and AIS data do not wake it. Reads (4096 bytes a
    tick), sentences and pending reports are limited; sentences and reports beyond that are dropped and counted. Pending
    identities of one vessel are merged.
    The boat's own transmissions (VDO) are not reports; its MMSI from another station is rejected.
    """

    def __init__(self, line: ByteLine, options: AisOptions) -> None:
        """Store the line and the options."""
        self._line = line
        self._own_mmsi = options.own_mmsi
        self._learns_own_mmsi = not options.own_mmsi
        self._monitor = DeviceMonitor(line, DeviceRole.AIS, SILENT_AFTER_S)
        self._sentence_finder, self._assembler = SentenceFinder(), Assembler()
        self._sentence_budget = TokenBucket(MAX_SENTENCE_BURST, MAX_SENTENCES_HZ)
        self._queue = VesselQueue()

    def fileno(self) -> int:
        """Return -1: AIS data do not wake the loop."""
        return -1

    def receive(self, now_s: float) -> None:
        """Read and decode the received bytes within the sentence budget; now_s is their time stamp."""
        if self._monitor.notice_reopening():
            self._sentence_finder, self._assembler = SentenceFinder(), Assembler()
        data = self._line.read()
        if not data:
            return
        self._monitor.note_bytes(now_s)
        dropped = 0
        for body, checksum in self._sentence_finder.feed(data):
            if self._sentence_budget.spend_one(now_s):
                self._handle_sentence(body, checksum, now_s)
            else:
                dropped += 1
        if dropped:
            self._monitor.reject(now_s, "too many sentences, some dropped", dropped)

    def poll(self) -> Sequence[VesselReport]:
        """Return the first reports of the queue, a limited number; positions first, as in the log."""
        return self._queue.take()

    def health(self, now_s: float) -> DeviceHealth:
        """Return the health of the device; messages with a report and own messages count as accepted."""
        return self._monitor.health(now_s)

    def _handle_sentence(self, body: bytes, checksum: int, now_s: float) -> None:
        try:
            message = self._assembler.add(body, checksum, now_s)
            reports = () if message is None else self._decode_message(message, now_s)
        except MessageError as error:
            self._monitor.reject(now_s, str(error))
            return
        if not reports:
            return
        self._monitor.accept(now_s)
        for report in reports:
            if not self._queue.add(report):
                self._monitor.reject(now_s, "too many vessels, some dropped")

    def _decode_message(self, message: Message, now_s: float) -> tuple[VesselReport, ...]:
        """Return the reports of a message; a message of the boat itself has none and gives its MMSI."""
        payload = read_payload(message.payload, message.fill_bits)
        if payload is None:
            return ()
        if message.is_own:
            if self._learns_own_mmsi:
                self._own_mmsi = payload.mmsi
            self._monitor.accept(now_s)
            return ()
        if payload.mmsi == self._own_mmsi:
            raise MessageError(RANGE, f"another station uses the boat's MMSI {payload.mmsi:09d}")
        return decode_reports(payload, now_s)


DRIVER = Driver(
    interface=INTERFACE,
    device="AIS receivers and transponders (VDM, VDO), also mixed with sentences of other devices",
    options=AisOptions,
    make=AisReceiver,
)
