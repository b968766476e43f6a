"""Finds AIS sentences in a stream of NMEA 0183 and joins multi-part messages with limited memory."""

from __future__ import annotations

import functools
import operator
import re
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, MessageError

MAX_SENTENCE_LENGTH = 120  # 82 in the standard; some stations send longer ones
MAX_PARTS = 5
MAX_INCOMPLETE = 16  # incomplete messages; then the oldest is dropped
MAX_MESSAGE_S = 10.0  # from the first to the last part of a message

_DIGITS = frozenset(b"%d" % digit for digit in range(10))
_SENTENCE = re.compile(rb"!([A-Z]{2}VD[MO],[0-9A-Za-z:;<=>?@`,]{1,%d})\*([0-9A-Fa-f]{2})" % MAX_SENTENCE_LENGTH)


class Message(msgspec.Struct, frozen=True):
    """The payload of a message and its number of fill bits; `is_own`: sent by this boat."""

    payload: bytes
    fill_bits: int
    is_own: bool


class SentenceFinder:
    """Finds the AIS sentences of a stream and skips everything else."""

    def __init__(self) -> None:
        """Start with an empty buffer."""
        self._incomplete_sentence = b""

    def feed(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Add bytes; yield the body and the checksum of each complete sentence."""
        buffer = self._incomplete_sentence + data
        end = 0
        for match in _SENTENCE.finditer(buffer):
            end = match.end()
            yield match[1], int(match[2], 16)
        start = buffer.rfind(b"!", max(end, len(buffer) - MAX_SENTENCE_LENGTH - 10))
        self._incomplete_sentence = buffer[start:] if start >= 0 else b""


@dataclass(slots=True)
class _IncompleteMessage:
    """A message with missing parts; `parts` is the number received."""

    started_s: float
    payload: bytes
    parts: int


class Assembler:
    """Joins the parts of messages, which arrive in order, possibly interleaved with other messages."""

    def __init__(self) -> None:
        """Start without incomplete messages."""
        self._incomplete: dict[tuple[bytes, ...], _IncompleteMessage] = {}

    def add(self, body: bytes, checksum: int, now_s: float) -> Message | None:
        """Return the message that a sentence completes, None while parts are missing; raises MessageError."""
        if functools.reduce(operator.xor, body) != checksum:
            raise MessageError(CHECKSUM, "checksum")
        fields = body.split(b",")
        if len(fields) != 7 or not all(number in _DIGITS for number in (fields[1], fields[2], fields[6][:1])):
            raise MessageError(MALFORMED, "not a sentence of seven fields")
        address, count, part, payload = fields[0], int(fields[1]), int(fields[2]), fields[5]
        fill_bits = int(fields[6][:1])
        if not (1 <= part <= count <= MAX_PARTS and fill_bits <= 5):
            raise MessageError(MALFORMED, "part number or number of fill bits is invalid")
        is_own = address.endswith(b"VDO")
        if count == 1:
            return Message(payload, fill_bits, is_own)
        key = (address, fields[1], fields[3], fields[4])  # with number of parts, message id and channel
        joined_payload = self._join(key, part, payload, now_s)
        if part < count:
            return None
        del self._incomplete[key]
        return Message(joined_payload, fill_bits, is_own)

    def _join(self, key: tuple[bytes, ...], part: int, payload: bytes, now_s: float) -> bytes:
        """Add a part to its message and return the payload so far."""
        incomplete = self._incomplete.get(key)
        if part == 1:
            if len(self._incomplete) >= MAX_INCOMPLETE and incomplete is None:
                del self._incomplete[min(self._incomplete, key=lambda oldest: self._incomplete[oldest].started_s)]
            self._incomplete[key] = _IncompleteMessage(now_s, payload, 1)
            return payload
        if incomplete is None or incomplete.parts != part - 1 or now_s - incomplete.started_s > MAX_MESSAGE_S:
            self._incomplete.pop(key, None)
            raise MessageError(MALFORMED, "earlier parts of the message are missing")
        incomplete.payload += payload
        incomplete.parts = part
        return incomplete.payload
