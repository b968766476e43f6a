"""What a satellite link keeps over restarts: what was spent, and which messages have counted."""

from __future__ import annotations

import re

import msgspec

from firmware_py.link.satellite.budget import Ledger
from firmware_py.link.satellite.keyed import KEPT_NUMBERS, Window

KEPT_MESSAGES = 32
_NUMBER = r"\d{1,15}"
_TEXT = re.compile(
    rf"ledger ({_NUMBER}) ({_NUMBER}) ({_NUMBER}) ({_NUMBER}) ({_NUMBER})\n"
    rf"floor ({_NUMBER})\nused((?: {_NUMBER}){{0,{KEPT_NUMBERS}}})\n"
    rf"seen((?: \d{{1,5}}:\d{{1,10}}){{0,{KEPT_MESSAGES}}})\n"
)


class Record(msgspec.Struct, frozen=True):
    """`seen` are number and checksum of the last messages without a key: the network may hand one over twice."""

    ledger: Ledger = msgspec.field(default_factory=Ledger)
    window: Window = msgspec.field(default_factory=Window)
    seen: tuple[tuple[int, int], ...] = ()


def to_text(record: Record) -> bytes:
    """Write it for the disk."""
    ledger, window = record.ledger, record.window
    counts = (ledger.day, ledger.month, ledger.day_used, ledger.month_used, ledger.total)
    lines = (
        " ".join(map(str, ("ledger", *counts))),
        f"floor {window.floor}",
        " ".join(map(str, ("used", *window.used))),
        " ".join(("seen", *(f"{number}:{check}" for number, check in record.seen))),
    )
    return ("\n".join(lines) + "\n").encode()


def from_text(text: bytes) -> Record:
    """Read what `to_text` has written, or raise ValueError."""
    match = _TEXT.fullmatch(text.decode("ascii", "replace"))
    if match is None:
        raise ValueError("what is stored is no record of a satellite link")
    counts = [int(word) for word in match.groups()[:5]]
    used = tuple(sorted({int(word) for word in match[7].split()}))
    pairs = (word.split(":") for word in match[8].split())
    return Record(Ledger(*counts), Window(int(match[6]), used), tuple((int(a), int(b)) for a, b in pairs))
