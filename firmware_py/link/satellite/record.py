"""Credits of a satellite link, and the record that is stored for the next start."""

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
_MAX_UTC_S = 1e11  # a later clock is invalid

MAX_STORED_MESSAGES = 32  # of Record.seen
_VERSION: Final = 1
MAX_COUNT: Final = 1 << 40  # the numbers of messages have 5 bytes
MAX_DAY: Final = 1_000_000  # days since 1970; a day in the calendar of Python

# Share of the budget that each priority may use, so that credits are left for urgent messages late in the day and for
# the reception of commands.
_SHARES: Mapping[Kind, float] = {Kind.EVENT: 0.95, Kind.REPORT: 0.9, Kind.ANSWER: 0.7, Kind.MAILBOX: 1.0}


class Limits(msgspec.Struct, frozen=True):
    """Credits per day and per month of UTC (0: no limit), and bytes per credit."""

    day: int
    month: int
    credit_bytes: int

    def cost(self, size_bytes: int) -> int:
        """Return the credits of a message. A mailbox check costs as much as the shortest message."""
        return max(1, math.ceil(size_bytes / self.credit_bytes))


class Ledger(msgspec.Struct, frozen=True):
    """Credits used on a day, in a month, and since the first start."""

    day: int = 0  # days since 1970-01-01
    month: int = 0  # months since January 1970
    day_used: int = 0
    month_used: int = 0
    total: int = 0

    def at(self, utc_s: float, under_way: int = 0) -> Ledger:
        """Return the ledger at a time. A new day or month starts with the credits of the session under way.

        An earlier day keeps the used credits, so that a clock that is set back does not increase the budget.
        """
        day = int(utc_s // _DAY_S) if math.isfinite(utc_s) and 0.0 <= utc_s < _MAX_UTC_S else self.day
        date_ = date.fromordinal(_EPOCH_DAY + day)
        month = (date_.year - 1970) * 12 + date_.month - 1
        if (day, month) == (self.day, self.month):
            return self
        return replace(
            self,
            day=day,
            month=month,
            day_used=min(self.day_used, under_way) if day > self.day else self.day_used,
            month_used=min(self.month_used, under_way) if month > self.month else self.month_used,
        )

    def charged(self, credits_: int) -> Ledger:
        """Return the ledger with additional credits used; a negative number is a refund."""
        return replace(
            self,
            day_used=max(0, self.day_used + credits_),
            month_used=max(0, self.month_used + credits_),
            total=max(0, self.total + credits_),
        )

    def available(self, limits: Limits, kind: Kind) -> float:
        """Return the credits that a message of this priority may use now; infinity without limits."""
        pairs = ((limits.day, self.day_used), (limits.month, self.month_used))
        return min((math.floor(limit * _SHARES[kind]) - used if limit else math.inf) for limit, used in pairs)


class Record(msgspec.Struct, frozen=True):
    """Stored record of a satellite link.

    `seen` are network number and checksum of the latest messages without HMAC, since the network may deliver a message
    twice.
    """

    ledger: Ledger = Ledger()
    window: Window = Window()
    seen: tuple[tuple[int, int], ...] = ()


def to_bytes(record: Record) -> bytes:
    """Encode a record."""
    return record_codec.encode(record, _VERSION)


def from_bytes(content: bytes) -> tuple[Record, tuple[str, ...]]:
    """Decode a record of this or another version; return it with notes. Raise ValueError if it is invalid."""
    record, notes = record_codec.decode(Record, content, _VERSION)
    used = record.window.used
    counts = (*astuple(record.ledger), record.window.floor, *used)
    if min(counts) < 0 or list(used) != sorted(set(used)):
        raise ValueError("a count is negative, or the numbers are not in order")
    if max(counts) > MAX_COUNT or record.ledger.day > MAX_DAY:
        raise ValueError("a count or a day is out of range")
    return record, notes
