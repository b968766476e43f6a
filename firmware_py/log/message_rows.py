"""Conversion between records and log messages by tables of columns.

An absent number is stored as NaN (drivers reject NaN), an absent flag as -1. A text follows the columns in pieces
of 64 bytes, one message each.

Columns are found by label, so that logs of other versions are readable. If a column is missing or its value is
unknown, the field takes its default; if it has no default, the record is left out. Unknown columns are ignored. Missing
columns and left-out records are noted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from operator import attrgetter
from typing import Any, Final

import msgspec

from firmware_py.common.reading_notes import Location
from firmware_py.log.dataflash import TEXT_BYTES, Buffer, Format, MessageType


class Column(msgspec.Struct, frozen=True):
    """One value: label, value, unit and multiplier characters, the field of the record, and its conversion."""

    label: str
    value: str
    unit: str
    multiplier: str
    field: str  # a dotted path from the record
    absent: float | None = None  # the stored value for None, if None is allowed
    read: Callable[[Any], Any] | None = None  # converts the stored value


def real(label: str, unit: str, field: str) -> Column:
    """Return the column of a number that is always present."""
    return Column(label, "d", unit, "0", field)


def maybe(label: str, unit: str, field: str, read: Callable[[Any], Any] | None = None) -> Column:
    """Return the column of a number that may be absent."""
    return Column(label, "d", unit, "0", field, math.nan, read)


def whole(label: str, value: str, field: str, unit: str = "-") -> Column:
    """Return the column of an integer with this value character."""
    return Column(label, value, unit, "-", field)


def flag(label: str, field: str) -> Column:
    """Return the column of a boolean."""
    return Column(label, "B", "-", "-", field, None, bool)


def maybe_flag(label: str, field: str) -> Column:
    """Return the column of a boolean that may be absent."""
    return Column(label, "b", "-", "-", field, -1, lambda stored: None if stored < 0 else bool(stored))


def choice(label: str, field: str, kind: type[IntEnum], unit: str = "-") -> Column:
    """Return the column of a member of an enumeration."""
    return Column(label, "B", unit, "-", field, None, kind)


TIME: Final = Column("TimeUS", "Q", "s", "F", "")
TEXT: Final = (whole("Part", "H", ""), whole("Parts", "H", ""), whole("Len", "B", ""), whole("Text", "Z", ""))
MAX_MICROSECONDS: Final = 1e18


def microseconds(t_s: float) -> int:
    """Return the time in microseconds for TimeUS; the exact time has its own column."""
    time_us = t_s * 1e6
    return int(time_us) if 0.0 <= time_us < MAX_MICROSECONDS else 0


class Row:
    """One message type: columns of a record, optionally followed by a text.

    `make` rebuilds the record from keyword arguments: those columns that are fields of it if it is a Struct, otherwise
    none; the text is the argument `text`. `noted`: `make` returns the record and notes.
    """

    def __init__(
        self,
        number: int,
        name: str,
        columns: Sequence[Column],
        make: Callable[..., Any],
        *,
        text: bool = False,
        noted: bool = False,
    ) -> None:
        """Describe a message of at least two columns."""
        stored = (TIME, *columns, *(TEXT if text else ()))
        labels = ",".join(column.label for column in stored)
        values, units, multipliers = (
            "".join(getattr(column, part) for column in stored) for part in ("value", "unit", "multiplier")
        )
        self.type = MessageType(number, name, labels, values, units, multipliers)
        self.make = make
        self.text = text
        kind: Any = make
        fields = {field.name: field for field in msgspec.structs.fields(kind)} if isinstance(kind, type) else {}
        self.noted = noted
        self.fields = tuple((name, column) for column in columns if (name := column.field.rpartition(".")[2]) in fields)
        self.defaulted = {name for name, field in fields.items() if field.default is not msgspec.NODEFAULT}
        self._values = attrgetter(*(column.field for column in columns))
        # Only these columns are checked for None: checking all costs twice as much.
        self._absent = tuple((at, column.absent) for at, column in enumerate(columns) if column.absent is not None)

    def pack(self, t_s: float, record: object) -> bytes:
        """Return the message of a record; raises struct.error for a value that does not fit."""
        return self.type.pack(microseconds(t_s), *self._columns(record))

    def pack_text(self, t_s: float, record: object, text: str) -> bytes:
        """Return the messages of a record and a text; raises struct.error for a text above 4 MB."""
        data = text.encode("utf-8", "surrogatepass")
        pieces = [data[start : start + TEXT_BYTES] for start in range(0, len(data), TEXT_BYTES)] or [b""]
        lead, pack = (microseconds(t_s), *self._columns(record)), self.type.pack
        return b"".join(pack(*lead, part, len(pieces), len(piece), piece) for part, piece in enumerate(pieces))

    def _columns(self, record: object) -> Sequence[Any]:
        values: Sequence[Any] = self._values(record)
        if self._absent:
            values = list(values)
            for at, absent in self._absent:
                if values[at] is None:
                    values[at] = absent
        return values


_CONVERTIBLE: Final = ("bBhHiIqQM", "fd", "Z")  # value characters of the same kind and different size


def _is_convertible(one: str, other: str) -> bool:
    return any(one in kind and other in kind for kind in _CONVERTIBLE)


class RowReader:
    """Builds records from the messages of one row in one file, none if there are `missing` columns."""

    __slots__ = ("_columns", "_defaulted", "_make", "_noted", "_pieces", "_spot", "_text", "_unpack", "missing")

    def __init__(self, row: Row, file_format: Format, notes: dict[str, None]) -> None:
        """Find the columns of the row in the file by label; add missing ones to `notes`."""
        self._spot = Location(f"message {file_format.name}", notes)
        self._make, self._noted, self._defaulted = row.make, row.noted, row.defaulted
        self._unpack = file_format.unpack
        self._pieces: list[bytes] = []
        missing = []
        self._columns: list[tuple[str, Column, int]] = []
        for name, column in row.fields:
            index = _index_of(column, file_format, self._spot)
            if index is not None:
                self._columns.append((name, column, index))
            elif name in self._defaulted:
                self._spot.note(f"column {column.label} is missing, its default is taken")
            else:
                missing.append(column.label)
        indices = {column.label: _index_of(column, file_format, self._spot) for column in TEXT if row.text}
        missing += [label for label, index in indices.items() if index is None]
        self._text = [index for index in indices.values() if index is not None]
        self.missing = tuple(missing)
        if missing:
            self._spot.note(f"column {', '.join(missing)} is missing, its records are left out")

    def read(self, buffer: Buffer, at: int) -> Any:
        """Return the record at an offset; None if its text continues or it is left out.

        Raises ValueError if a part of a text is missing.
        """
        if self.missing:
            return None
        values = self._unpack(buffer, at)
        fields: dict[str, Any] = {}
        if self._text:
            text = self._joined(*(values[index] for index in self._text))
            if text is None:
                return None
            fields["text"] = text
        for name, column, index in self._columns:
            value = values[index]
            if column.absent is not None and value != value:  # noqa: PLR0124 -- only NaN differs from itself
                value = None
            elif column.read is not None:
                try:
                    value = column.read(value)
                except (OverflowError, ValueError):
                    has_default = name in self._defaulted
                    what = "its default is taken" if has_default else "the record is left out"
                    self._spot.note(f"{column.label} {value!r} is not known here, {what}")
                    if has_default:
                        continue
                    return None
            fields[name] = value
        return self._made(fields)

    def _made(self, fields: dict[str, Any]) -> Any:
        try:
            made = self._make(**fields)
        except ValueError as error:
            self._spot.note(f"{error}; the record is left out")
            return None
        if not self._noted:
            return made
        record, notes = made
        for note in notes:
            self._spot.note(note)
        return record

    def _joined(self, part: int, parts: int, length: int, piece: bytes) -> str | None:
        if part == 0:
            self._pieces.clear()
        if part != len(self._pieces) or part >= parts or length > len(piece):
            raise ValueError("a part of a text is missing")
        self._pieces.append(piece[:length])
        if part + 1 < parts:
            return None
        text = b"".join(self._pieces).decode("utf-8", "surrogatepass")
        self._pieces.clear()
        return text


def _index_of(column: Column, file_format: Format, location: Location) -> int | None:
    """Return the index of a column in the file, None without one of this label and kind."""
    if column.label not in file_format.labels:
        return None
    index = file_format.labels.index(column.label)
    value = file_format.values[index]
    if value != column.value:
        location.note(f"column {column.label} is stored as {value!r}, here as {column.value!r}")
    return index if _is_convertible(value, column.value) else None
