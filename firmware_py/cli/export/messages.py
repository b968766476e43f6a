"""The messages of a log in plain units."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, Final, NamedTuple

from firmware_py.log.dataflash import FMT_TYPE, Buffer, Format, Parser, text_of

_SCALES: Final = {"c": 0.01, "C": 0.01, "e": 0.01, "E": 0.01, "L": 1e-7}
_TEXTS: Final = frozenset("nNZ")
_MICROSECONDS: Final = 1e-6


class Message(NamedTuple):
    """One record: name, process time, and values by column."""

    name: str
    t_s: float
    values: dict[str, Any]


def messages(buffer: Buffer, names: Collection[str] | None = None) -> Iterator[Message]:
    """Yield the records that have a time, of the given names or of all, without parts of longer texts."""
    selected: dict[int, tuple[Format, bool]] = {}  # by number; a later file header may reuse it
    for found, at in Parser(buffer):
        selection = selected.get(found.number)
        if selection is None or selection[0] is not found:
            whole = "TimeUS" in found.labels and "Part" not in found.labels and not found.name.startswith("FMT")
            selection = selected[found.number] = (found, whole and (names is None or found.name in names))
        if selection[1]:
            values = _values(found, buffer, at)
            yield Message(found.name, values["TimeUS"] * _MICROSECONDS, values)


def declared(buffer: Buffer) -> set[str]:
    """Return the names of all message formats in the header of a log."""
    names = set()
    for found, at in Parser(buffer):
        if found.number != FMT_TYPE:
            break
        names.add(text_of(found.unpack(buffer, at)[2]))
    return names


def _values(found: Format, buffer: Buffer, at: int) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for label, kind, value in zip(found.labels, found.values, found.unpack(buffer, at), strict=True):
        if kind in _TEXTS:
            values[label] = text_of(value)
        elif isinstance(value, bytes):
            continue
        else:
            values[label] = value * _SCALES[kind] if kind in _SCALES else value
    return values
