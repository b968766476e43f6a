"""Receives the packets of a binary protocol and keeps the headings of a compass until the next poll."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceRole, HeadingSample
from firmware_py.sensors.binary_framing import Packet, PacketFramer
from firmware_py.sensors.device_monitor import SILENT_AFTER_S, DeviceMonitor
from firmware_py.sensors.message_error import CHECKSUM

MAX_SAMPLES = 512  # between two polls


class PacketReceiver:
    """Common part of the drivers of compasses with a binary protocol.

    The driver calls `notice_reopening` and then `read` in each cycle, and appends headings to `samples`.
    """

    def __init__(
        self, line: ByteLine, create_framer: Callable[[], PacketFramer], silent_after_s: float = SILENT_AFTER_S
    ) -> None:
        """Store the line; `silent_after_s` is the minimum timeout of the monitor."""
        self.monitor = DeviceMonitor(line, DeviceRole.COMPASS, silent_after_s)
        self.samples: deque[HeadingSample] = deque(maxlen=MAX_SAMPLES)
        self._line = line
        self._create_framer = create_framer
        self._framer = create_framer()

    def notice_reopening(self) -> bool:
        """Return whether the line was opened since the last call; if so, discard an incomplete packet."""
        if not self.monitor.notice_reopening():
            return False
        self._framer = self._create_framer()
        return True

    def read(self, now_s: float) -> Sequence[Packet]:
        """Return the packets and skipped bytes that are complete; count those with a wrong checksum."""
        data = self._line.read()
        if not data:
            return ()
        self.monitor.note_bytes(now_s)
        packets = self._framer.feed(data)
        for packet in packets:
            # Skipped bytes without a header are noise or another protocol.
            if packet.fault == CHECKSUM:
                self.monitor.reject(now_s, CHECKSUM)
        return packets

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        samples = tuple(self.samples)
        self.samples.clear()
        return samples
