"""Read the messages of a log, with values in degrees, metres and seconds."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Final, NamedTuple

from firmware_py.log.dataflash import FMT_TYPE, Buffer, Format, Parser, decode_text

# By the format character of a field in the log.
_SCALES: Final = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_TEXT_KINDS: Final = frozenset("nNZ")
_MICROSECOND_S: Final = 1e-6


class Message(NamedTuple):
    """A log record: name, process time in seconds, and values by column."""

    name: str
    t_s: float
    values: dict[str, Any]


def read_messages(buffer: Buffer, names: Collection[str] | None = None) -> Iterator[Message]:
    """Yield the records with these names, or all, that have a time and are not parts of longer texts."""
    selected: dict[int, tuple[Format, bool]] = {}  # by number, which a later file header may reuse
    for fmt, offset in Parser(buffer):
        if selected.get(fmt.number, (None,))[0] is not fmt:
            has_data = "TimeUS" in fmt.labels and "Part" not in fmt.labels and not fmt.name.startswith("FMT")
            selected[fmt.number] = (fmt, has_data and (names is None or fmt.name in names))
        if selected[fmt.number][1]:
            values = _unpack_values(fmt, buffer, offset)
            yield Message(fmt.name, values["TimeUS"] * _MICROSECOND_S, values)


def read_declared_names(buffer: Buffer) -> set[str]:
    """Return the names of all message formats in the header of a log."""
    names = set()
    for fmt, offset in Parser(buffer):
        if fmt.number != FMT_TYPE:
            break
        names.add(decode_text(fmt.unpack(buffer, offset)[2]))
    return names


def _unpack_values(fmt: Format, buffer: Buffer, offset: int) -> dict[str, Any]:
    """Return the values of a record by column, scaled, without arrays of bytes."""
    values: dict[str, Any] = {}
    for label, kind, value in zip(fmt.labels, fmt.values, fmt.unpack(buffer, offset), strict=True):
        if kind in _TEXT_KINDS:
            values[label] = decode_text(value)
        elif isinstance(value, bytes):
            continue
        else:
            values[label] = value * _SCALES[kind] if kind in _SCALES else value
    return values
