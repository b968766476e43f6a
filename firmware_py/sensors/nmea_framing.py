"""Finds NMEA 0183 sentences in a stream of bytes."""

from __future__ import annotations

import functools
import operator
import re

import msgspec

from firmware_py.sensors.message_error import CHECKSUM, MALFORMED, NO_CHECKSUM

# The limit of the standard is 82 bytes, but $PUBX,03 of u-blox has 500 and more.
MAX_BODY_LENGTH = 1024

_START = re.compile(rb"[$!]")
_BODY_END = re.compile(rb"[\x00-\x1f\x7f$!*]")
_ADDRESS = re.compile(rb"[A-Z][A-Z0-9]{2,7}(?=,|\Z)")
# Some plotters print a checksum below 16 with one digit; the line must end there.
_CHECKSUM = re.compile(rb"[0-9A-Fa-f](?:[0-9A-Fa-f]|(?=[\r\n]))")


class Sentence(msgspec.Struct, frozen=True):
    """The content between `$` or `!` and the checksum.

    `line` is the line number from 1; `fields` are those after the address; `fault` is empty, CHECKSUM, NO_CHECKSUM or
    MALFORMED (truncated or too long).
    """

    line: int
    address: str
    fields: tuple[str, ...]
    fault: str = ""

    @property
    def kind(self) -> str:
        """The sentence formatter, such as HDG; the whole address of a proprietary sentence."""
        return self.address if self.address[0] == "P" else self.address[2:]

    @property
    def talker(self) -> str:
        """The talker id, such as HC; P for every proprietary sentence."""
        return "P" if self.address[0] == "P" else self.address[:2]


class NmeaFramer:
    """Splits a stream into sentences and resynchronises after garbage.

    `$` and `!` always start a sentence, also inside another one, which is then MALFORMED. A start without an address of
    capitals and digits is skipped, like all bytes between sentences (binary protocols, time stamps of a logger). The
    result does not depend on how the stream is divided into calls of `feed`.
    """

    def __init__(self) -> None:
        """Start at line 1 with an empty buffer."""
        self._buffer = bytearray()
        self._line = 1

    def feed(self, data: bytes) -> list[Sentence]:
        """Add bytes; return the completed sentences."""
        buffer = self._buffer
        buffer += data
        sentences: list[Sentence] = []
        position = 0
        while match := _START.search(buffer, position):
            start = match.start()
            self._line += buffer.count(b"\n", position, start)
            position = start
            end = _BODY_END.search(buffer, start + 1)
            stop = end.start() if end else len(buffer)
            body = bytes(buffer[start + 1 : stop])
            if len(body) > MAX_BODY_LENGTH:
                self._append_sentence(sentences, body[:MAX_BODY_LENGTH], MALFORMED)
                position = stop
                continue
            if end is None or (buffer[stop] == ord("*") and len(buffer) < stop + 3):
                break
            self._append_sentence(sentences, body, self._find_fault(body, stop))
            position = stop
        else:
            self._line += buffer.count(b"\n", position)
            position = len(buffer)
        del buffer[:position]
        return sentences

    def finish(self) -> list[Sentence]:
        """Return the sentences that the end of a capture completes."""
        return self.feed(b"\n\n")

    def _append_sentence(self, sentences: list[Sentence], body: bytes, fault: str) -> None:
        match = _ADDRESS.match(body)
        if match:
            parts = body.decode("latin-1").split(",")
            sentences.append(Sentence(self._line, parts[0], tuple(parts[1:]), fault))

    def _find_fault(self, body: bytes, stop: int) -> str:
        """Return the fault of a body that ends at `stop`, empty for none."""
        end_byte = self._buffer[stop]
        if end_byte in b"\r\n":
            return NO_CHECKSUM
        if end_byte != ord("*"):
            return MALFORMED
        stated = _CHECKSUM.match(self._buffer, stop + 1)
        computed = functools.reduce(operator.xor, body, 0)
        return "" if stated and int(stated[0], 16) == computed else CHECKSUM
