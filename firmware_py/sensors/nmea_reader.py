"""What the NMEA drivers have in common: from a line to the values of the sentences that are wanted."""

from __future__ import annotations

from collections.abc import Collection

from firmware_py.common.interfaces import ByteLine
from firmware_py.sensors.device_monitor import DeviceMonitor
from firmware_py.sensors.message_error import NO_CHECKSUM, MessageError
from firmware_py.sensors.nmea_framing import NmeaFramer, Sentence
from firmware_py.sensors.nmea_sentences import Decoded, decode_sentence


class NmeaReader:
    """Reads a line, counts what is refused and returns what is wanted."""

    def __init__(
        self,
        line: ByteLine,
        condition: DeviceMonitor,
        wanted: Collection[str],
        *,
        talker: str | None = None,
        require_checksum: bool = True,
    ) -> None:
        """Take the kinds `wanted`, from one talker or all; without a checksum only if it is not required."""
        self._line = line
        self._condition = condition
        self._wanted = frozenset(wanted)
        self._talker = talker
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
        self._condition.heard(now_s)
        found: list[tuple[Sentence, Decoded]] = []
        for sentence in self._framer.feed(data):
            if not self._passes(sentence, now_s):
                continue
            try:
                decoded = decode_sentence(sentence)
            except MessageError as refusal:
                self._condition.bad(now_s, str(refusal))
                continue
            if decoded is not None:
                found.append((sentence, decoded))
        return found

    def _passes(self, sentence: Sentence, now_s: float) -> bool:
        """Whether a sentence is wanted and whole; what is damaged counts, whatever it was."""
        wanted = sentence.kind in self._wanted and self._talker in (None, sentence.talker)
        # A missing checksum is no damage, so it counts only where it costs something.
        if sentence.fault == NO_CHECKSUM and not (wanted and self._require_checksum):
            return wanted
        if sentence.fault:
            self._condition.bad(now_s, f"{sentence.address}: {sentence.fault}")
            return False
        return wanted
