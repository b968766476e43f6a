"""Reads the fields of NMEA 2000 messages by the generated table (nmea2000_table.py).

The bits of a message are numbered from the lowest bit of its first byte; a field is an integer times its resolution.
The highest values of a field mean "not available", "error" and "reserved": the table states for each field the range of
integers that are a value, and every other integer is None. Sources: canboat, docs/decisions/0017-nmea-2000.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from firmware_py.sensors.message_error import MALFORMED, MessageError

Values = Mapping[str, float | int | None]

MAX_MESSAGE_BYTES = 223  # of a fast packet


class Field(NamedTuple):
    """A number: name with unit, first bit, width in bits, resolution in that unit, lowest and highest valid integer."""

    name: str
    first_bit: int
    width: int
    is_signed: bool
    resolution: float
    minimum: int
    maximum: int


class Layout(NamedTuple):
    """A message: name, least number of bytes, whether it is a fast packet, numbers, texts (name, first byte, bytes)."""

    name: str
    min_bytes: int
    is_fast: bool
    numbers: tuple[Field, ...]
    texts: tuple[tuple[str, int, int], ...] = ()


def read_numbers(layout: Layout, data: bytes) -> Values:
    """Return the numbers of a message, None for a value that is not available, reserved or out of range.

    Raises MessageError for a message that is too short.
    """
    if len(data) < layout.min_bytes:
        raise MessageError(MALFORMED, f"{layout.name}: {len(data)} bytes")
    bits, size = int.from_bytes(data, "little"), 8 * len(data)
    values: dict[str, float | int | None] = {}
    for name, first_bit, width, is_signed, resolution, minimum, maximum in layout.numbers:
        number = bits >> first_bit & ((1 << width) - 1)
        if is_signed and number >> (width - 1):
            number -= 1 << width
        # Some devices omit the last fields.
        is_valid = minimum <= number <= maximum and first_bit + width <= size
        values[name] = number * resolution if is_valid else None
    return values


def read_texts(layout: Layout, data: bytes) -> dict[str, str]:
    """Return the texts of a message as printable ASCII, empty if not available; @, NUL or 255 ends a text."""
    texts: dict[str, str] = {}
    for name, start, length in layout.texts:
        text = data[start : start + length]
        for end in (b"@", b"\x00", b"\xff"):
            text = text.partition(end)[0]
        texts[name] = "".join(chr(byte) if 32 <= byte < 127 else "?" for byte in text.rstrip())
    return texts
