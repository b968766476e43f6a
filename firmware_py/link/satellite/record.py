"""What a satellite link keeps over restarts: what was spent, and which messages have counted."""

from __future__ import annotations

from typing import Final

import msgspec
from msgspec.structs import astuple

from firmware_py.common import record_codec
from firmware_py.link.satellite.budget import Ledger
from firmware_py.link.satellite.keyed import Window

KEPT_MESSAGES = 32
_VERSION: Final = 1
MOST_COUNT: Final = 1 << 40  # the numbers of messages have 5 bytes
LAST_DAY: Final = 1_000_000  # since 1970: in the calendar of Python


class Record(msgspec.Struct, frozen=True):
    """`seen` are number and checksum of the last messages without a key: the network may hand one over twice."""

    ledger: Ledger = Ledger()
    window: Window = Window()
    seen: tuple[tuple[int, int], ...] = ()


def to_bytes(record: Record) -> bytes:
    """Return the record as it is stored."""
    return record_codec.encode(record, _VERSION)


def from_bytes(content: bytes) -> tuple[Record, tuple[str, ...]]:
    """Return what `to_bytes` wrote, by this version or another, and notes on it; ValueError says why there is none."""
    record, notes = record_codec.decode(Record, content, _VERSION)
    used = record.window.used
    counts = (*astuple(record.ledger), record.window.floor, *used)
    if min(counts) < 0 or list(used) != sorted(set(used)):
        raise ValueError("a count is negative, or the numbers are not in order")
    if max(counts) > MOST_COUNT or record.ledger.day > LAST_DAY:
        raise ValueError("a count or a day is beyond all bounds")
    return record, notes
