"""`@PARAM/param.pck`, ArduPilot's packed parameter list: two thirds of a kilobyte for what takes seconds otherwise.

Source: ArduPilot, libraries/AP_Filesystem/README.md. A row is a byte of type and flags, a byte of name lengths,
the part of the name that differs from the row before, the value, and the default where it is asked for and differs.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping

from firmware_py.common.parameter_row import Kind, ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet
from firmware_py.link.parameters.metadata import declared_kind

PLAIN, WITH_DEFAULTS = 0x671B, 0x671C
_HEAD = struct.Struct("<HHH")
_TYPES = {Kind.INTEGER: (3, "i"), Kind.REAL: (4, "f")}
_FORMATS = {1: "b", 2: "h", 3: "i", 4: "f"}
_HAS_DEFAULT = 0x10
_MOST_COMMON = 15


def pack(values: ParameterSet, query: Mapping[str, str], autopilot: int) -> bytes:
    """Return the file; the query may hold start, count and withdefaults, and what it says wrong is not heeded.

    The types are those that PARAM_VALUE declares for a boat that says it is this autopilot: stations keep them.
    """
    start, count = _whole(query.get("start"), 0), _whole(query.get("count"), len(TABLE))
    with_defaults = _whole(query.get("withdefaults"), 0) != 0
    rows = range(start, min(start + count, len(TABLE)))
    parts = [_HEAD.pack(WITH_DEFAULTS if with_defaults else PLAIN, len(rows), len(TABLE))]
    before = ""
    for index in rows:
        row, value = TABLE[index], values.values()[index]
        number, form = _TYPES[declared_kind(row, autopilot)]
        common = _common(before, row.name)
        ending = row.name[common:].encode("ascii")
        shown = [value]
        if with_defaults and value != row.default:
            number |= _HAS_DEFAULT
            shown.append(row.default)
        numbers = [int(number) if form == "i" else number for number in shown]
        parts.append(bytes((number, common | (len(ending) - 1) << 4)) + ending)
        parts.append(struct.pack(f"<{len(numbers)}{form}", *numbers))
        before = row.name
    return b"".join(parts)


def unpack(content: bytes) -> dict[str, float]:
    """Read an uploaded file into {name: checked value}, or raise ParameterError: all of it is right, or nothing.

    The third number of the head is the length of the file, as ArduPilot wants it of uploads.
    """
    if len(content) < _HEAD.size:
        raise ParameterError("shorter than its head")
    magic, count, length = _HEAD.unpack_from(content)
    if magic != PLAIN:
        raise ParameterError(f"begins with {magic:#06x} instead of {PLAIN:#06x}")
    if length != len(content):
        raise ParameterError(f"{len(content)} bytes of {length} have come")
    values: dict[str, float] = {}
    rows = 0
    for name, value in _rows(content):
        index = INDEX.get(name)
        if index is None:
            raise ParameterError(f"unknown parameter {name[:16]!r}")
        row = TABLE[index]
        if row.read_only:
            raise ParameterError(f"{name} is read-only")
        values[name] = row.check(value)
        rows += 1
    if rows != count:
        raise ParameterError(f"{rows} parameters instead of {count}")
    return values


def _rows(content: bytes) -> Iterator[tuple[str, float]]:
    position, before = _HEAD.size, b""
    while position < len(content):
        if content[position] == 0:
            position += 1  # padding
            continue
        form = _FORMATS.get(content[position])
        if form is None or position + 1 >= len(content):
            raise ParameterError(f"byte {position} begins no parameter")
        lengths = content[position + 1]
        start = position + 2
        end = start + (lengths >> 4) + 1
        if (lengths & 0x0F) > len(before) or end + struct.calcsize(form) > len(content):
            raise ParameterError(f"the parameter at byte {position} is cut off")
        before = before[: lengths & 0x0F] + content[start:end]
        (value,) = struct.unpack_from(f"<{form}", content, end)
        position = end + struct.calcsize(form)
        yield before.decode("ascii", "replace"), float(value)


def _common(before: str, name: str) -> int:
    limit = min(len(before), len(name) - 1, _MOST_COMMON)
    return next((index for index in range(limit) if before[index] != name[index]), limit)


def _whole(text: str | None, otherwise: int) -> int:
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 6 else otherwise
