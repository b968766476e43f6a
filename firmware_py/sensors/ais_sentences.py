"""Finds AIS sentences in any stream of NMEA 0183 and joins those that belong together, within bounds."""

from __future__ import annotations

import functools
import operator
import re
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, MessageError

LONGEST_SENTENCE = 120  # the standard says 82; some stations write longer ones
MOST_PARTS = 5
MOST_WAITING = 16  # messages that have begun, the oldest is given up
PART_WAIT_S = 10.0

_SENTENCE = re.compile(rb"!([A-Z]{2}VD[MO],[0-9A-Za-z:;<=>?@`,]{1,%d})\*([0-9A-Fa-f]{2})" % LONGEST_SENTENCE)


class Message(msgspec.Struct, frozen=True):
    """The payload of a message and how many of its last bits fill up; `own`: it is the one that this boat sends."""

    payload: bytes
    fill_bits: int
    own: bool


class SentenceFinder:
    """Cuts a stream into sentences; what is no AIS is passed over at the price of a search."""

    def __init__(self) -> None:
        """Begin with nothing in the buffer."""
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[tuple[bytes, int]]:
        """Yield the body and the stated checksum of each sentence that more bytes complete."""
        buffer = self._rest + data
        end = 0
        for match in _SENTENCE.finditer(buffer):
            end = match.end()
            yield match[1], int(match[2], 16)
        start = buffer.rfind(b"!", max(end, len(buffer) - LONGEST_SENTENCE - 10))
        self._rest = buffer[start:] if start >= 0 else b""


@dataclass(slots=True)
class _Begun:
    """A message of which parts have come."""

    begun_s: float
    payload: bytes
    parts: int


class Assembler:
    """Joins the parts of messages, which come in order, those of others perhaps between them."""

    def __init__(self) -> None:
        """Start with nothing begun."""
        self._begun: dict[tuple[bytes, ...], _Begun] = {}

    def take(self, body: bytes, stated: int, now_s: float) -> Message | None:
        """Return the message that a sentence completes, None while parts are lacking; MessageError for a bad one."""
        if functools.reduce(operator.xor, body) != stated:
            raise MessageError(CHECKSUM, "checksum")
        fields = body.split(b",")
        if len(fields) != 7 or not all(number in _DIGITS for number in (fields[1], fields[2], fields[6][:1])):
            raise MessageError(MALFORMED, "not a sentence of seven fields")
        address, count, part, payload = fields[0], int(fields[1]), int(fields[2]), fields[5]
        fill_bits = int(fields[6][:1])
        if not (1 <= part <= count <= MOST_PARTS and fill_bits <= 5):
            raise MessageError(MALFORMED, "part of too many, or too many bits to fill")
        own = address.endswith(b"VDO")
        if count == 1:
            return Message(payload, fill_bits, own)
        key = (address, fields[1], fields[3], fields[4])
        joined = self._join(key, part, payload, now_s)
        if part < count:
            return None
        del self._begun[key]
        return Message(joined, fill_bits, own)

    def _join(self, key: tuple[bytes, ...], part: int, payload: bytes, now_s: float) -> bytes:
        """Add a part to its message and return all so far."""
        begun = self._begun.get(key)
        if part == 1:
            if len(self._begun) >= MOST_WAITING and begun is None:
                del self._begun[min(self._begun, key=lambda one: self._begun[one].begun_s)]
            self._begun[key] = _Begun(now_s, payload, 1)
            return payload
        if begun is None or begun.parts != part - 1 or now_s - begun.begun_s > PART_WAIT_S:
            self._begun.pop(key, None)
            raise MessageError(MALFORMED, "a part without those before it")
        begun.payload += payload
        begun.parts = part
        return begun.payload


_DIGITS = frozenset(b"%d" % digit for digit in range(10))
