"""Reads the messages of an NMEA 2000 bus from a line: the common part of the NMEA 2000 drivers."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.options import check, option
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.nmea2000_frames import ADDRESS_CLAIM, MAX_ADDRESS, FrameJoiner, Message
from firmware_py.sensors.nmea2000_gateways import (
    START_COMMAND,
    ActisenseGateway,
    Gateway,
    SocketCanGateway,
    YachtDevicesGateway,
)
from firmware_py.sensors.nmea2000_source import AUTOMATIC, SourceSelection
from firmware_py.sensors.nmea2000_table import LAYOUTS

START_INTERVAL_S = 5.0  # between two start commands while no message is used
# A bus transmits at most 1900 frames a second. A read has up to 85 lines, so the line is read again, at most
# MAX_READS times per call, after a read of at least FULL_READ_BYTES.
MAX_READS, FULL_READ_BYTES = 8, 2048
MAX_MESSAGES_HZ, MAX_MESSAGE_BURST = 500.0, 200  # of one driver

ACTISENSE, YACHT_DEVICES = "actisense", "yd_raw"


@dataclass(frozen=True, slots=True)
class Nmea2000Options:
    """Options of the vehicle file for a device on an NMEA 2000 bus; raises ValueError."""

    source: int = option(
        "address of the device on the bus, as 0x23; -1: the first one that sends, until it is silent",
        default=AUTOMATIC,
        minimum=AUTOMATIC,
        maximum=MAX_ADDRESS,
    )
    gateway: str = option(
        "form of the data: actisense (NGT-1 and compatible) or yd_raw (Yacht Devices RAW). auto: actisense on a serial"
        " port, yd_raw on udp: and tcp:; can: has a form of its own",
        default="auto",
        choices=("auto", ACTISENSE, YACHT_DEVICES),
    )

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)


class Nmea2000Reader:
    """Returns the messages of the selected PGNs; follows address claims and starts an Actisense gateway.

    A gateway that was switched on may forward only a part of the messages, so the start command is repeated while no
    message is used. It goes to the gateway; nothing is transmitted on the bus.
    """

    def __init__(
        self,
        line: ByteLine,
        monitor: DeviceMonitor,
        options: Nmea2000Options,
        pgns: Collection[int],
        selection: SourceSelection,
    ) -> None:
        """Select PGNs of the table; address claims go to `selection`."""
        self._line = line
        self._monitor = monitor
        self._pgns = frozenset(pgns)
        self._form = _form_of(line.name, options.gateway)
        self._selection = selection
        self._gateway = self._create_gateway()
        self._rejected = 0
        self._budget = TokenBucket(MAX_MESSAGE_BURST, MAX_MESSAGES_HZ)
        self._start_due_s = -math.inf

    def restart(self) -> None:
        """Discard incomplete messages and start the gateway: the line was opened again."""
        self._gateway = self._create_gateway()
        self._rejected = 0
        self._start_due_s = -math.inf
        self._selection.restart()

    def note_used(self, now_s: float) -> None:
        """Note that a message was used: the gateway forwards what the driver needs."""
        self._start_due_s = now_s + START_INTERVAL_S

    def read(self, now_s: float) -> list[Message]:
        """Return the messages of the selected PGNs that have arrived, with the limits of one driver."""
        if self._form == ACTISENSE and now_s >= self._start_due_s and self._line.connected:
            self._start_due_s = now_s + START_INTERVAL_S
            self._line.write(START_COMMAND)
        messages: list[Message] = []
        dropped = 0
        for _ in range(MAX_READS):
            data = self._line.read()
            if not data:
                break
            self._monitor.note_bytes(now_s)
            for message in self._gateway.feed(data, now_s):
                if not self._budget.spend_one(now_s):
                    dropped += 1
                elif message.pgn != ADDRESS_CLAIM:
                    messages.append(message)
                elif len(message.data) == 8:
                    self._selection.handle_claim(message.source, message.data, now_s)
            if len(data) < FULL_READ_BYTES:
                break
        self._report(dropped, now_s)
        return messages

    def report_source(self, now_s: float) -> None:
        """Report a change of the source, or a second source, once, and a missing source while it is missing."""
        if text := self._selection.missing_text:
            self._monitor.note_unused(text)
        if text := self._selection.take_text():
            self._monitor.reject(now_s, text, count=0)

    def _report(self, dropped: int, now_s: float) -> None:
        if self._gateway.has_frames:
            self._monitor.note_unused("bus running, without the messages of this device")
        if (rejected := self._gateway.rejected) != self._rejected:
            self._monitor.reject(now_s, "damaged or incomplete message", rejected - self._rejected)
            self._rejected = rejected
        if dropped:
            self._monitor.reject(now_s, "too many messages, some dropped", dropped)

    def _create_gateway(self) -> Gateway:
        return create_gateway(self._form, {*self._pgns, ADDRESS_CLAIM})


def create_gateway(form: str, pgns: Collection[int]) -> Gateway:
    """Return the decoder of a form (ACTISENSE, YACHT_DEVICES, otherwise SocketCAN)."""
    if form == ACTISENSE:
        return ActisenseGateway(pgns)
    fast = {pgn for pgn in pgns if pgn in LAYOUTS and LAYOUTS[pgn].is_fast}
    joiner = FrameJoiner(set(pgns) - fast, fast)
    return YachtDevicesGateway(joiner, pgns) if form == YACHT_DEVICES else SocketCanGateway(joiner)


def _form_of(port: str, gateway: str) -> str:
    if port.startswith("can:"):
        return ""
    if gateway != "auto":
        return gateway
    return YACHT_DEVICES if port.startswith(("udp:", "tcp:")) else ACTISENSE
