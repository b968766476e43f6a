"""What the NMEA drivers have in common: from a line, or a capture, to the values of its sentences."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from firmware_py.common.interfaces import ByteLine
from firmware_py.sensors.decode import CaptureFormat, Result, chunks, values_of
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import NO_CHECKSUM, MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer, Sentence
from firmware_py.sensors.nmea_sentences import Decoded, decode_sentence


class NmeaReader:
    """Reads a line, counts what is refused and returns what is wanted."""

    def __init__(
        self,
        line: ByteLine,
        monitor: DeviceMonitor,
        wanted: Collection[str],
        *,
        require_checksum: bool = True,
    ) -> None:
        """Take the kinds `wanted`; without a checksum only if it is not required."""
        self._line = line
        self._monitor = monitor
        self._wanted = frozenset(wanted)
        self._require_checksum = require_checksum
        self._framer = NmeaFramer()

    def restart(self) -> None:
        """Forget a sentence that was begun."""
        self._framer = NmeaFramer()

    def read(self, now_s: float) -> list[tuple[Sentence, Decoded]]:
        """Return the wanted sentences that have arrived, all of them without fault."""
        data = self._line.read()
        if not data:
            return []
        self._monitor.note_bytes(now_s)
        sentences: list[tuple[Sentence, Decoded]] = []
        for sentence in self._framer.feed(data):
            if not self._passes(sentence, now_s):
                continue
            try:
                decoded = decode_sentence(sentence)
            except MessageError as error:
                self._monitor.reject(now_s, str(error))
                continue
            if decoded is not None:
                sentences.append((sentence, decoded))
        return sentences

    def _passes(self, sentence: Sentence, now_s: float) -> bool:
        """Whether a sentence is wanted and whole; what is damaged counts, whatever it was."""
        wanted = sentence.kind in self._wanted
        # A missing checksum is no damage, so it counts only where it costs something.
        if sentence.fault == NO_CHECKSUM and not (wanted and self._require_checksum):
            return wanted
        if sentence.fault:
            remedy = "; require_checksum = false takes it" if sentence.fault == NO_CHECKSUM else ""
            self._monitor.reject(now_s, f"{sentence.address}: {sentence.fault}{remedy}")
            return False
        if not wanted:
            self._monitor.pass_over(f"only {sentence.address} and the like: another device's port?")
        return wanted


def _decode_capture(data: bytes) -> Iterator[Result]:
    framer = NmeaFramer()
    for chunk in chunks(data):
        yield from map(_result, framer.feed(chunk))
    yield from map(_result, framer.finish())


def _result(sentence: Sentence) -> Result:
    head = {"line": sentence.line}
    name = {"sentence": sentence.address}
    if sentence.fault:
        return {**head, "type": "error", "error": sentence.fault, **name}
    try:
        decoded = decode_sentence(sentence)
    except MessageError as error:
        return {**head, "type": "error", "error": error.error, **name, "detail": str(error)}
    if decoded is None:
        return {**head, "type": "other", **name}
    return {**head, "type": decoded.topic, **name, **values_of(decoded.topic, decoded.numbers), **decoded.letters}


CAPTURE_FORMAT = CaptureFormat("nmea", _decode_capture)
