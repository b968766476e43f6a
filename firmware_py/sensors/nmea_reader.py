"""Reads the sentences of a line or a capture: the common part of the NMEA drivers."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from firmware_py.common.driver import CaptureFormat
from firmware_py.common.interfaces import ByteLine
from firmware_py.sensors.decode import Result, round_values, split_chunks
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import NO_CHECKSUM, MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer, Sentence
from firmware_py.sensors.nmea_sentences import IGNORED, DecodedSentence, decode_sentence

MAX_UNKNOWN_TRANSDUCERS = 32  # number of reported names; others are not reported


def _add_unknown_transducers(decoded: DecodedSentence, reported_names: set[str]) -> str:
    """Add the unknown transducers of a sentence to `reported_names`; return the added ones as text, else empty."""
    if len(reported_names) >= MAX_UNKNOWN_TRANSDUCERS:
        return ""
    new_names = [name for name in decoded.unknown if name not in reported_names]
    reported_names.update(new_names)
    return ", ".join(dict.fromkeys(new_names))


class NmeaReader:
    """Reads a line, counts rejected sentences and returns those of the selected kinds."""

    def __init__(
        self,
        line: ByteLine,
        monitor: DeviceMonitor,
        kinds: Collection[str],
        *,
        require_checksum: bool = True,
        by_option: bool = False,
    ) -> None:
        """Select kinds of sentences; `require_checksum` rejects sentences without a checksum.

        `by_option`: the kinds are those of the option `sentences`, which the text about other sentences then names.
        """
        self._line = line
        self._monitor = monitor
        self._kinds = frozenset(kinds)
        self._require_checksum = require_checksum
        self._remedy = "correct port or sentences" if by_option else "port of another device?"
        self._framer = NmeaFramer()
        self._reported_names: set[str] = set()

    def restart(self) -> None:
        """Discard an incomplete sentence: the line was reopened."""
        self._framer = NmeaFramer()

    def read(self, now_s: float) -> list[tuple[Sentence, DecodedSentence]]:
        """Return the valid sentences of the selected kinds that have arrived."""
        data = self._line.read()
        if not data:
            return []
        self._monitor.note_bytes(now_s)
        sentences: list[tuple[Sentence, DecodedSentence]] = []
        for sentence in self._framer.feed(data):
            if not self._is_usable(sentence, now_s):
                continue
            try:
                decoded = decode_sentence(sentence)
            except MessageError as error:
                self._monitor.reject(now_s, str(error))
                continue
            if decoded is not None:
                if decoded.unknown and (names := _add_unknown_transducers(decoded, self._reported_names)):
                    self._monitor.reject(now_s, f"unknown transducer: {names}", count=0)
                sentences.append((sentence, decoded))
        return sentences

    def _is_usable(self, sentence: Sentence, now_s: float) -> bool:
        """Return whether a sentence has a selected kind and no fault; faults of all kinds are counted."""
        is_selected = sentence.kind in self._kinds
        # A missing checksum does not prove damage, so it is counted only for the selected kinds.
        if sentence.fault == NO_CHECKSUM and not (is_selected and self._require_checksum):
            return is_selected
        if sentence.fault:
            remedy = "; accept it with require_checksum = false" if sentence.fault == NO_CHECKSUM else ""
            self._monitor.reject(now_s, f"{sentence.address}: {sentence.fault}{remedy}")
            return False
        if not is_selected:
            self._monitor.note_unused(f"only {sentence.address} and similar: {self._remedy}")
        return is_selected


def _decode_capture(data: bytes) -> Iterator[Result]:
    framer, reported_names = NmeaFramer(), set[str]()
    for chunk in split_chunks(data):
        yield from (_decode_sentence(sentence, reported_names) for sentence in framer.feed(chunk))
    yield from (_decode_sentence(sentence, reported_names) for sentence in framer.finish())


def _decode_sentence(sentence: Sentence, reported_names: set[str]) -> Result:
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
    values = round_values(decoded.topic, decoded.numbers)
    new_names = _add_unknown_transducers(decoded, reported_names)
    return {
        **head,
        "type": decoded.topic,
        **name,
        **values,
        **decoded.letters,
        **({"unknown": new_names} if new_names else {}),
    }


CAPTURE_FORMAT = CaptureFormat("nmea", _decode_capture)
