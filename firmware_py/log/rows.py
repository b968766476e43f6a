"""How a record becomes a message and a message a record, by a table of columns.

An absent number is stored as NaN (no driver lets a NaN in), an absent flag as -1. A text
follows the columns in pieces of 64 bytes, one message each.

A log outlives the version that wrote it, so columns are file_format by label. One that the file lacks,
or whose value is not known here, leaves the field at its default; where the field has none, the
records are left out. Columns not known here are passed over. What was lacking or left out is noted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from operator import attrgetter
from typing import Any, Final

import msgspec

from firmware_py.common.reading_notes import Spot
from firmware_py.log.dataflash import TEXT_BYTES, Buffer, Format, MessageType


class Column(msgspec.Struct, frozen=True):
    """One value: label, value, unit and multiplier characters, the field it holds, and how it is read."""

    label: str
    value: str
    unit: str
    multiplier: str
    field: str  # dotted, as seen from the record
    absent: float | None = None  # what stands for None, where None may be
    read: Callable[[Any], Any] | None = None  # from the stored value, where that is not the value itself


def real(label: str, unit: str, field: str) -> Column:
    """A number that is always there."""
    return Column(label, "d", unit, "0", field)


def maybe(label: str, unit: str, field: str, read: Callable[[Any], Any] | None = None) -> Column:
    """A number that may be absent."""
    return Column(label, "d", unit, "0", field, math.nan, read)


def whole(label: str, value: str, field: str, unit: str = "-") -> Column:
    """A whole number of the given value character."""
    return Column(label, value, unit, "-", field)


def flag(label: str, field: str) -> Column:
    """True or false."""
    return Column(label, "B", "-", "-", field, None, bool)


def maybe_flag(label: str, field: str) -> Column:
    """True, false or absent."""
    return Column(label, "b", "-", "-", field, -1, lambda stored: None if stored < 0 else bool(stored))


def choice(label: str, field: str, kind: type[IntEnum], unit: str = "-") -> Column:
    """A member of an enumeration."""
    return Column(label, "B", unit, "-", field, None, kind)


TIME: Final = Column("TimeUS", "Q", "s", "F", "")
TEXT: Final = (whole("Part", "H", ""), whole("Parts", "H", ""), whole("Len", "B", ""), whole("Text", "Z", ""))
MAX_MICROSECONDS: Final = 1e18


def microseconds(t_s: float) -> int:
    """Return the time as the tools want it; the exact time is a column of its own."""
    time_us = t_s * 1e6
    return int(time_us) if 0.0 <= time_us < MAX_MICROSECONDS else 0


class Row:
    """One message: columns taken from a record, perhaps with a text behind them.

    `make` rebuilds the record from keyword arguments: a Struct gets those columns that
    are fields of it, anything else gets none; the text comes as `text`. `noted`: it returns
    the record and notes.
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
        """Describe a message of two columns or more."""
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
        self.kept = tuple((name, column) for column in columns if (name := column.field.rpartition(".")[2]) in fields)
        self.defaulted = {name for name, field in fields.items() if field.default is not msgspec.NODEFAULT}
        self._values = attrgetter(*(column.field for column in columns))
        # Which may be None, and what stands for it: to look for None among numbers costs twice as much.
        self._absent = tuple((at, column.absent) for at, column in enumerate(columns) if column.absent is not None)

    def pack(self, t_s: float, record: object) -> bytes:
        """Return the message of a record; struct.error for a value that does not fit."""
        return self.type.pack(microseconds(t_s), *self._columns(record))

    def pack_text(self, t_s: float, record: object, text: str) -> bytes:
        """Return the messages of a record and a text; struct.error for one above 4 MB."""
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


# Value characters that hold the same sort of value, more or less of it.
_SORTS: Final = ("bBhHiIqQM", "fd", "Z")


def _alike(one: str, other: str) -> bool:
    return any(one in sort and other in sort for sort in _SORTS)


class RowReader:
    """Makes records of the messages of one row in one file; `lacking` names the columns without which it makes none."""

    __slots__ = ("_columns", "_defaulted", "_make", "_noted", "_pieces", "_spot", "_text", "_unpack", "lacking")

    def __init__(self, row: Row, file_format: Format, notes: dict[str, None]) -> None:
        """Find the columns of the row among those of the file by label; what is lacking is noted in `notes`."""
        self._spot = Spot(f"message {file_format.name}", notes)
        self._make, self._noted, self._defaulted = row.make, row.noted, row.defaulted
        self._unpack = file_format.unpack
        self._pieces: list[bytes] = []
        lacking = []
        self._columns: list[tuple[str, Column, int]] = []
        for name, column in row.kept:
            place = _position_of(column, file_format, self._spot)
            if place is not None:
                self._columns.append((name, column, place))
            elif name in self._defaulted:
                self._spot.note(f"column {column.label} is missing, its default is taken")
            else:
                lacking.append(column.label)
        places = {column.label: _position_of(column, file_format, self._spot) for column in TEXT if row.text}
        lacking += [label for label, place in places.items() if place is None]
        self._text = [place for place in places.values() if place is not None]
        self.lacking = tuple(lacking)
        if lacking:
            self._spot.note(f"column {', '.join(lacking)} is missing, its records are left out")

    def read(self, buffer: Buffer, at: int) -> Any:
        """Return the record at an offset; None while its text goes on, and when it is left out.

        ValueError when a part of a text is missing.
        """
        if self.lacking:
            return None
        values = self._unpack(buffer, at)
        fields: dict[str, Any] = {}
        if self._text:
            text = self._joined(*(values[place] for place in self._text))
            if text is None:
                return None
            fields["text"] = text
        for name, column, place in self._columns:
            value = values[place]
            if column.absent is not None and value != value:  # noqa: PLR0124 -- only NaN differs from itself
                value = None
            elif column.read is not None:
                try:
                    value = column.read(value)
                except (OverflowError, ValueError):
                    kept = name in self._defaulted
                    what = "its default is taken" if kept else "the record is left out"
                    self._spot.note(f"{column.label} {value!r} is not known here, {what}")
                    if kept:
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


def _position_of(column: Column, file_format: Format, spot: Spot) -> int | None:
    """Return where a column of this label stands in the file, None without one of its sort."""
    if column.label not in file_format.labels:
        return None
    place = file_format.labels.index(column.label)
    value = file_format.values[place]
    if value != column.value:
        spot.note(f"column {column.label} is stored as {value!r}, here as {column.value!r}")
    return place if _alike(value, column.value) else None
