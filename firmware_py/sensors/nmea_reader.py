"""What the NMEA drivers have in common: from a line, or a capture, to the values of its sentences."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from firmware_py.common.interfaces import ByteLine
from firmware_py.sensors.decode import CaptureFormat, Result, chunks, values_of
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import NO_CHECKSUM, MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer, Sentence
from firmware_py.sensors.nmea_sentences import IGNORED, Decoded, decode_sentence

MOST_UNKNOWN = 32  # transducers that are remembered


def _unreported(decoded: Decoded, reported: set[str]) -> str:
    """Return the transducers of a sentence that are not known and not yet reported, "" for none, and note them."""
    fresh = [name for name in decoded.unknown if name not in reported] if len(reported) < MOST_UNKNOWN else []
    reported.update(fresh)
    return ", ".join(dict.fromkeys(fresh))


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
        self._reported: set[str] = set()

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
                if decoded.unknown and (names := _unreported(decoded, self._reported)):
                    self._monitor.reject(now_s, f"not known: {names}", count=0)
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
    framer, reported = NmeaFramer(), set[str]()
    for chunk in chunks(data):
        yield from (_result(sentence, reported) for sentence in framer.feed(chunk))
    yield from (_result(sentence, reported) for sentence in framer.finish())


def _result(sentence: Sentence, reported: set[str]) -> Result:
    head = {"line": sentence.line}
    name = {"sentence": sentence.address}
    if sentence.fault:
        return {**head, "type": "error", "error": sentence.fault, **name}
    try:
        decoded = decode_sentence(sentence)
    except MessageError as error:
        return {**head, "type": "error", "error": error.error, **name, "detail": str(error)}
    if decoded is None:
        ignored = IGNORED.get(sentence.kind)
        return {**head, "type": "other", **name, **({"detail": f"{ignored}: not used"} if ignored else {})}
    values = values_of(decoded.topic, decoded.numbers)
    new = _unreported(decoded, reported)
    return {**head, "type": decoded.topic, **name, **values, **decoded.letters, **({"unknown": new} if new else {})}


CAPTURE_FORMAT = CaptureFormat("nmea", _decode_capture)
