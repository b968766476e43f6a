"""Converts between records and log messages by tables of columns.

An absent number is stored as NaN (drivers reject NaN), an absent flag as -1. A text is divided into pieces of 64 bytes;
each piece is a message that repeats the columns.

Columns are found by label, so that logs of other versions are readable. If a column is missing or its value is
unknown, the field has its default; without a default, the record is omitted. Unknown columns are ignored. Missing
columns and omitted records are noted.
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
    """One column of a message and the field of the record that it stores.

    `value`, `unit` and `multiplier` are characters of the DataFlash format, `field` is a dotted path from the record,
    `absent` the stored value for None (None: not allowed), and `read` converts the stored value.
    """

    label: str
    value: str
    unit: str
    multiplier: str
    field: str
    absent: float | None = None
    read: Callable[[Any], Any] | None = None


def float_column(label: str, unit: str, field: str) -> Column:
    """Return the column of a number that is always present."""
    return Column(label, "d", unit, "0", field)


def optional_column(label: str, unit: str, field: str, read: Callable[[Any], Any] | None = None) -> Column:
    """Return the column of a number that may be absent."""
    return Column(label, "d", unit, "0", field, math.nan, read)


def integer_column(label: str, value: str, field: str, unit: str = "-") -> Column:
    """Return the column of an integer; `value` is its value character."""
    return Column(label, value, unit, "-", field)


def flag_column(label: str, field: str) -> Column:
    """Return the column of a boolean."""
    return Column(label, "B", "-", "-", field, None, bool)


def optional_flag_column(label: str, field: str) -> Column:
    """Return the column of a boolean that may be absent."""
    return Column(label, "b", "-", "-", field, -1, lambda number: None if number < 0 else bool(number))


def enum_column(label: str, field: str, kind: type[IntEnum], unit: str = "-") -> Column:
    """Return the column of a member of an enumeration."""
    return Column(label, "B", unit, "-", field, None, kind)


TIME: Final = Column("TimeUS", "Q", "s", "F", "")
TEXT: Final = (
    integer_column("Part", "H", ""),
    integer_column("Parts", "H", ""),
    integer_column("Len", "B", ""),
    integer_column("Text", "Z", ""),
)
MAX_MICROSECONDS: Final = 1e18


def microseconds(t_s: float) -> int:
    """Convert a time in seconds to TimeUS; 0 if it is negative, NaN or above MAX_MICROSECONDS."""
    time_us = t_s * 1e6
    return int(time_us) if 0.0 <= time_us < MAX_MICROSECONDS else 0


class Row:
    """One message type: columns of a record, optionally followed by a text.

    `make` builds the record from keyword arguments. If it is a Struct, the arguments are the columns that are fields of
    it, otherwise there are none; a text is the argument `text`. With `has_notes`, `make` returns the record and notes.
    """

    def __init__(
        self,
        number: int,
        name: str,
        columns: Sequence[Column],
        make: Callable[..., Any],
        *,
        text: bool = False,
        has_notes: bool = False,
    ) -> None:
        """Build the message type; `columns` has at least two items."""
        all_columns = (TIME, *columns, *(TEXT if text else ()))
        labels = ",".join(column.label for column in all_columns)
        values, units, multipliers = (
            "".join(getattr(column, part) for column in all_columns) for part in ("value", "unit", "multiplier")
        )
        self.type = MessageType(number, name, labels, values, units, multipliers)
        self.make = make
        self.text = text
        kind: Any = make
        fields = {field.name: field for field in msgspec.structs.fields(kind)} if isinstance(kind, type) else {}
        self.has_notes = has_notes
        self.fields = tuple((name, column) for column in columns if (name := column.field.rpartition(".")[2]) in fields)
        self.defaulted = {name for name, field in fields.items() if field.default is not msgspec.NODEFAULT}
        self._values = attrgetter(*(column.field for column in columns))
        # Checking all columns for None would double the time.
        self._absent_values = tuple(
            (at, column.absent) for at, column in enumerate(columns) if column.absent is not None
        )

    def pack(self, t_s: float, record: object) -> bytes:
        """Return the message of a record; raises struct.error for a value that does not fit."""
        return self.type.pack(microseconds(t_s), *self._columns(record))

    def pack_text(self, t_s: float, record: object, text: str) -> bytes:
        """Return the messages of a record and a text; raises struct.error for a text above 4 MB."""
        data = text.encode("utf-8", "surrogatepass")
        pieces = [data[start : start + TEXT_BYTES] for start in range(0, len(data), TEXT_BYTES)] or [b""]
        first_values, pack = (microseconds(t_s), *self._columns(record)), self.type.pack
        return b"".join(pack(*first_values, part, len(pieces), len(piece), piece) for part, piece in enumerate(pieces))

    def _columns(self, record: object) -> Sequence[Any]:
        values: Sequence[Any] = self._values(record)
        if self._absent_values:
            values = list(values)
            for at, absent in self._absent_values:
                if values[at] is None:
                    values[at] = absent
        return values


_CONVERTIBLE: Final = ("bBhHiIqQM", "fd", "Z")  # value characters of the same kind and different size


def _is_convertible(value: str, other_value: str) -> bool:
    return any(value in kind and other_value in kind for kind in _CONVERTIBLE)


class RowReader:
    """Builds records from the messages of one row in one file; builds none if columns are `missing`."""

    __slots__ = ("_columns", "_defaulted", "_has_notes", "_location", "_make", "_pieces", "_text", "_unpack", "missing")

    def __init__(self, row: Row, file_format: Format, notes: dict[str, None]) -> None:
        """Find the columns of the row in the file by label; add missing ones to `notes`."""
        self._location = Location(f"message {file_format.name}", notes)
        self._make, self._has_notes, self._defaulted = row.make, row.has_notes, row.defaulted
        self._unpack = file_format.unpack
        self._pieces: list[bytes] = []
        missing = []
        self._columns: list[tuple[str, Column, int]] = []
        for name, column in row.fields:
            index = _index_of(column, file_format, self._location)
            if index is not None:
                self._columns.append((name, column, index))
            elif name in self._defaulted:
                self._location.note(f"column {column.label} is missing, its default is taken")
            else:
                missing.append(column.label)
        indices = {column.label: _index_of(column, file_format, self._location) for column in TEXT if row.text}
        missing += [label for label, index in indices.items() if index is None]
        self._text = [index for index in indices.values() if index is not None]
        self.missing = tuple(missing)
        if missing:
            self._location.note(f"column {', '.join(missing)} is missing, its records are left out")

    def read(self, buffer: Buffer, at: int) -> Any:
        """Return the record at an offset; None if its text is incomplete so far or the record is omitted.

        Raises ValueError if a piece of a text is missing.
        """
        if self.missing:
            return None
        values = self._unpack(buffer, at)
        fields: dict[str, Any] = {}
        if self._text:
            text = self._join_text(*(values[index] for index in self._text))
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
                    consequence = "its default is taken" if has_default else "the record is left out"
                    self._location.note(f"{column.label} {value!r} is not known here, {consequence}")
                    if has_default:
                        continue
                    return None
            fields[name] = value
        return self._make_record(fields)

    def _make_record(self, fields: dict[str, Any]) -> Any:
        try:
            result = self._make(**fields)
        except ValueError as error:
            self._location.note(f"{error}; the record is left out")
            return None
        if not self._has_notes:
            return result
        record, notes = result
        for note in notes:
            self._location.note(note)
        return record

    def _join_text(self, part: int, parts: int, length: int, piece: bytes) -> str | None:
        if part == 0:
            self._pieces.clear()
        if part != len(self._pieces) or part >= parts or length > len(piece):
            raise ValueError("a piece of a text is missing")
        self._pieces.append(piece[:length])
        if part + 1 < parts:
            return None
        text = b"".join(self._pieces).decode("utf-8", "surrogatepass")
        self._pieces.clear()
        return text


def _index_of(column: Column, file_format: Format, location: Location) -> int | None:
    """Return the index of a column in the file; None if no column has its label and a convertible value character."""
    if column.label not in file_format.labels:
        return None
    index = file_format.labels.index(column.label)
    value = file_format.values[index]
    if value != column.value:
        location.note(f"column {column.label} is stored as {value!r}, here as {column.value!r}")
    return index if _is_convertible(value, column.value) else None
