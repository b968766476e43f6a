"""Common part of the drivers of devices on an NMEA 2000 bus."""

from __future__ import annotations

from collections.abc import Collection

from firmware_py.common.interfaces import ByteLine
from firmware_py.common.records import DeviceRole
from firmware_py.sensors.device_monitor import SILENT_AFTER_S
from firmware_py.sensors.message_error import MessageError
from firmware_py.sensors.nmea2000_frames import Message
from firmware_py.sensors.nmea2000_layout import Values, read_numbers
from firmware_py.sensors.nmea2000_reader import Nmea2000Options, Nmea2000Reader
from firmware_py.sensors.nmea2000_source import SourceSelection
from firmware_py.sensors.nmea2000_table import LAYOUTS
from firmware_py.sensors.sensor_driver import SampleT, SensorDriver


class Nmea2000Device(SensorDriver[SampleT]):
    """Reads the messages of some PGNs; a subclass makes samples of those of the selected device."""

    def __init__(
        self,
        line: ByteLine,
        options: Nmea2000Options,
        role: DeviceRole,
        quantity: str,
        pgns: Collection[int],
        source_timeout_s: float,
        silent_after_s: float = SILENT_AFTER_S,
    ) -> None:
        """Define the device: after `source_timeout_s` of silence, another one on the bus may take its place."""
        super().__init__(line, role, silent_after_s)
        self._selection = SourceSelection(quantity, options.source, source_timeout_s)
        self._reader = Nmea2000Reader(line, self._monitor, options, pgns, self._selection)
        self._source: int | None = None

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._reader.restart()
            self._source = None
        for message in self._reader.read(now_s):
            try:
                self._handle_message(message, now_s)
            except MessageError as error:
                self._monitor.reject(now_s, str(error))
        self._reader.report_source(now_s)

    def _is_used(self, message: Message, now_s: float) -> bool:
        """Return whether a message is of the selected device, or select its device."""
        if not self._selection.accepts(message.source, now_s):
            return False
        self._reader.note_used(now_s)
        if message.source != self._source:
            self._source = message.source
            self._forget(now_s)
        return True

    def _is_reported(self, message: Message) -> bool:
        """Return whether a message without a valid value is reported: of the selected device, or before there is one.

        Such a message does not select its device or keep it selected, because another device may have a value.
        """
        address = self._selection.address
        return message.source == address or (address is None and self._selection.is_candidate(message.source))

    def _handle_message(self, message: Message, now_s: float) -> None:
        """Process a message; may raise MessageError."""
        raise NotImplementedError

    def _forget(self, now_s: float) -> None:
        """Discard the values of the previous device."""


def numbers_of(message: Message) -> Values:
    """Return the numbers of a message; raises MessageError if it is too short."""
    return read_numbers(LAYOUTS[message.pgn], message.data)
