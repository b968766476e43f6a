"""Credits of a satellite link, and what it stores over restarts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import date
from typing import Final

import msgspec
from msgspec.structs import astuple, replace

from firmware_py.common import record_codec
from firmware_py.link.satellite.messages import Kind, Window

_DAY_S = 86400.0
_EPOCH_DAY = date(1970, 1, 1).toordinal()
_LATEST_S = 1e11  # a later clock is invalid

KEPT_MESSAGES = 32
_VERSION: Final = 1
MAX_COUNT: Final = 1 << 40  # the numbers of messages have 5 bytes
LAST_DAY: Final = 1_000_000  # since 1970: in the calendar of Python


# The share of the budget for each priority, so that credits are left for urgent messages late in the day, and for
# commands when nothing more is sent.
_SHARES: Mapping[Kind, float] = {Kind.EVENT: 0.95, Kind.REPORT: 0.9, Kind.ANSWER: 0.7, Kind.MAILBOX: 1.0}


class Limits(msgspec.Struct, frozen=True):
    """Credits for a day and a month of UTC, 0 for no limit, and how many bytes one credit carries."""

    day: int
    month: int
    credit_bytes: int

    def cost(self, size_bytes: int) -> int:
        """Return the credits of a message; a mailbox check costs as much as the shortest one."""
        return max(1, math.ceil(size_bytes / self.credit_bytes))


class Ledger(msgspec.Struct, frozen=True):
    """Credits of this day and this month (both counted from 1970), and since the start of the record."""

    day: int = 0
    month: int = 0
    day_used: int = 0
    month_used: int = 0
    total: int = 0

    def at(self, utc_s: float, under_way: int = 0) -> Ledger:
        """Return the ledger at a time: a new day starts with the credits `under_way`, an earlier day keeps all.

        So a clock that is set back does not increase the budget.
        """
        day = int(utc_s // _DAY_S) if math.isfinite(utc_s) and 0.0 <= utc_s < _LATEST_S else self.day
        date_ = date.fromordinal(_EPOCH_DAY + day)
        months = (date_.year - 1970) * 12 + date_.month - 1
        if (day, months) == (self.day, self.month):
            return self
        return replace(
            self,
            day=day,
            month=months,
            day_used=min(self.day_used, under_way) if day > self.day else self.day_used,
            month_used=min(self.month_used, under_way) if months > self.month else self.month_used,
        )

    def charged(self, credits_: int) -> Ledger:
        """Return the ledger with more credits spent, or refunded (negative)."""
        return replace(
            self,
            day_used=max(0, self.day_used + credits_),
            month_used=max(0, self.month_used + credits_),
            total=max(0, self.total + credits_),
        )

    def room(self, limits: Limits, kind: Kind) -> float:
        """Return the credits that may be spent now on a message of a priority."""
        pairs = ((limits.day, self.day_used), (limits.month, self.month_used))
        return min((math.floor(limit * _SHARES[kind]) - used if limit else math.inf) for limit, used in pairs)


class Record(msgspec.Struct, frozen=True):
    """`seen` are number and checksum of the last messages without a key: the network may hand one over twice."""

    ledger: Ledger = Ledger()
    window: Window = Window()
    seen: tuple[tuple[int, int], ...] = ()


def to_bytes(record: Record) -> bytes:
    """Return the record as it is stored."""
    return record_codec.encode(record, _VERSION)


def from_bytes(content: bytes) -> tuple[Record, tuple[str, ...]]:
    """Return the record and notes on its decoding, from this or another version; ValueError if it is invalid."""
    record, notes = record_codec.decode(Record, content, _VERSION)
    used = record.window.used
    counts = (*astuple(record.ledger), record.window.floor, *used)
    if min(counts) < 0 or list(used) != sorted(set(used)):
        raise ValueError("a count is negative, or the numbers are not in order")
    if max(counts) > MAX_COUNT or record.ledger.day > LAST_DAY:
        raise ValueError("a count or a day is beyond all bounds")
    return record, notes
