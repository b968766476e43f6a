"""ArduPilot's DataFlash format: self-describing binary records with units.

Every record is A3 95, a type byte and packed little-endian values. FMT records (type
128) give each type its name, length, value characters and column labels; FMTU, UNIT and
MULT add the units. Source: ArduPilot libraries/AP_Logger, README.md and LogStructure.h.
The writing side (MessageType, header) and the reading side (Format, Parser) share the
table of value characters only.
"""

from __future__ import annotations

import functools
import mmap
import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

MARK = b"\xa3\x95"
HEAD_BYTES = 3
FMT_TYPE = 128
FMT_BYTES = 89
MAX_COLUMNS = 16
MAX_LABELS = 64
TEXT_BYTES = 64  # size of one Z value

Buffer = bytes | mmap.mmap

# Value character -> struct code. The centi and degree characters (c C e E L) are unscaled
# integers in the file; the reader applies their factor (LogStructure.h).
STRUCT_CODES: Mapping[str, str] = {
    "a": "64s",
    "b": "b",
    "B": "B",
    "h": "h",
    "H": "H",
    "i": "i",
    "I": "I",
    "f": "f",
    "d": "d",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
    "c": "h",
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",
    "M": "B",
    "q": "q",
    "Q": "Q",
}

# The rows of log_Units and log_Multipliers that this program uses.
UNITS: Mapping[str, str] = {
    "-": "",
    "#": "instance",
    "%": "%",
    "A": "A",
    "D": "deglatitude",
    "E": "rad/s",
    "J": "J",
    "O": "degC",
    "S": "satellites",
    "U": "deglongitude",
    "W": "W",
    "Y": "us",
    "d": "deg",
    "h": "degheading",
    "i": "mAh",
    "k": "deg/s",
    "m": "m",
    "n": "m/s",
    "o": "m/s/s",
    "r": "rad",
    "s": "s",
    "v": "V",
    "z": "Hz",
}
MULTIPLIERS: Mapping[str, float] = {"-": 0.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}


class LogError(ValueError):
    """A log cannot be used; the text contains the reason and the remedy."""


class MessageType:
    """One type of record for writing."""

    __slots__ = ("labels", "multipliers", "name", "number", "pack", "size", "units", "values")

    def __init__(self, number: int, name: str, labels: str, values: str, units: str, multipliers: str) -> None:
        """Check the description against the limits of the format; raises ValueError beyond them."""
        count = len(labels.split(","))
        if not 1 <= len(name) <= 4 or count > MAX_COLUMNS or len(labels) > MAX_LABELS:
            raise ValueError(f"{name}: too long a name, or too many or too long labels")
        if not len(values) == len(units) == len(multipliers) == count:
            raise ValueError(f"{name}: labels, values, units and multipliers differ in number")
        if set(units) - UNITS.keys() or set(multipliers) - MULTIPLIERS.keys():
            raise ValueError(f"{name}: unknown unit or multiplier")
        self.number = number
        self.name = name
        self.labels = labels
        self.values = values
        self.units = units
        self.multipliers = multipliers
        layout = struct.Struct("<3s" + "".join(STRUCT_CODES[value] for value in values))
        self.size = layout.size
        if self.size > 255:
            raise ValueError(f"{name}: {self.size} bytes, the format allows 255")
        self.pack: Callable[..., bytes] = functools.partial(layout.pack, MARK + bytes((number,)))


FMT = MessageType(FMT_TYPE, "FMT", "Type,Length,Name,Format,Columns", "BBnNZ", "-----", "-----")
UNIT = MessageType(129, "UNIT", "TimeUS,Id,Label", "QbZ", "s--", "F--")
MULT = MessageType(130, "MULT", "TimeUS,Id,Mult", "Qbd", "s--", "F--")
FMTU = MessageType(131, "FMTU", "TimeUS,FmtType,UnitIds,MultIds", "QBNN", "s---", "F---")


def header(messages: Sequence[MessageType], time_us: int) -> bytes:
    """Return the header of a file: formats, units, multipliers, and the units and multipliers of each column."""
    all_messages = (FMT, UNIT, MULT, FMTU, *messages)
    parts = [
        FMT.pack(row.number, row.size, row.name.encode(), row.values.encode(), row.labels.encode())
        for row in all_messages
    ]
    # pymavlink interprets the first column of FMTU as the type when it walks a file, so the time
    # must not be a valid type number.
    stamp_us = time_us if time_us > 255 else 0
    parts += [UNIT.pack(stamp_us, ord(character), text.encode()) for character, text in UNITS.items()]
    parts += [MULT.pack(stamp_us, ord(character), factor) for character, factor in MULTIPLIERS.items()]
    parts += [FMTU.pack(stamp_us, row.number, row.units.encode(), row.multipliers.encode()) for row in all_messages]
    return b"".join(parts)


class Format:
    """One type of record as described by a file, for reading."""

    __slots__ = ("labels", "length", "name", "number", "unpack", "values")

    def __init__(self, number: int, length: int, name: str, values: str, labels: str) -> None:
        """Store the values of an FMT record; raises ValueError if they contradict each other."""
        self.number = number
        self.length = length
        self.name = name
        self.labels = tuple(labels.split(",")) if labels else ()
        self.values = values
        if not set(values) <= STRUCT_CODES.keys():
            raise ValueError(f"{name}: unknown value character in {values!r}")
        layout = struct.Struct("<3x" + "".join(STRUCT_CODES[value] for value in values))
        if layout.size != length or len(self.labels) != len(values):
            raise ValueError(f"{name}: length or labels do not fit the format {values!r}")
        self.unpack: Callable[[Buffer, int], tuple[Any, ...]] = layout.unpack_from


def decode_text(data: bytes) -> str:
    """Return the text of a name or format column up to its first NUL."""
    return data.partition(b"\0")[0].decode("utf-8", "replace")


_FMT_FORMAT = Format(FMT_TYPE, FMT_BYTES, FMT.name, FMT.values, FMT.labels)


class Parser:
    """Iterator over the records of a buffer, which may contain other bytes.

    After the iteration, `garbage_bytes` is the number of bytes between records and `tail_bytes` the number of bytes
    after the last whole record.
    """

    def __init__(self, buffer: Buffer) -> None:
        """Parse a buffer, which must not shrink during the iteration."""
        self._buffer = buffer
        self._formats: dict[int, Format] = {FMT_TYPE: _FMT_FORMAT}
        self.garbage_bytes = 0
        self.tail_bytes = 0

    def __iter__(self) -> Iterator[tuple[Format, int]]:
        """Yield the format and the offset of every whole record in order, including FMT records."""
        buffer, size = self._buffer, len(self._buffer)
        records_end = offset = self.garbage_bytes = 0
        while True:
            offset = buffer.find(MARK, offset, size - 1)  # a type byte follows the mark
            if offset < 0:
                break
            file_format = self._formats.get(buffer[offset + 2])
            end = offset + file_format.length if file_format is not None else size + 1
            # Garbage may contain the two bytes of a mark, so the record after it must also end at the next mark or
            # at the end of the buffer.
            if file_format is None or end > size or (offset != records_end and not self._is_record_start(end)):
                offset += 1
                continue
            self.garbage_bytes += offset - records_end
            if file_format.number == FMT_TYPE:
                self._add_format(file_format.unpack(buffer, offset))
            yield file_format, offset
            records_end = offset = end
        self.tail_bytes = size - records_end

    def _is_record_start(self, offset: int) -> bool:
        return offset == len(self._buffer) or self._buffer[offset : offset + 2] == MARK

    def _add_format(self, values: tuple[Any, ...]) -> None:
        number, length = values[0], values[1]
        if number == FMT_TYPE:
            return
        name, characters, labels = (decode_text(value) for value in values[2:])
        try:
            self._formats[number] = Format(number, length, name, characters, labels)
        except ValueError:  # of another program or damaged; its length suffices to skip its records
            if length > HEAD_BYTES:
                self._formats[number] = _opaque_format(number, length, name)


def size_of_whole_records(buffer: Buffer) -> int:
    """Return the number of bytes of a buffer up to the end of its last whole record."""
    parser = Parser(buffer)
    for _ in parser:
        pass
    return len(buffer) - parser.tail_bytes


def _opaque_format(number: int, length: int, name: str) -> Format:
    return Format(number, length, re.sub(r"\W", "?", name), "B" * (length - HEAD_BYTES), "?," * (length - 4) + "?")
