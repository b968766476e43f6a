"""Decodes the bits of an AIS payload into numbers and texts by a table of fields.

Source: ITU-R M.1371-5, annex 8. The table contains only the fields that the autopilot uses, and for each message
type the lengths of messages that contain all of them.
"""

from __future__ import annotations

import binascii
from collections.abc import Mapping

import msgspec

from firmware_py.sensors.message_error import MALFORMED, MessageError

# The minimum contains message type, MMSI and part number; the maximum is five sentences of 62 characters.
MIN_CHARACTERS, MAX_CHARACTERS = 7, 5 * 62
_ARMOUR = b"0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw"
_BASE64 = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
_TO_BASE64 = bytes.maketrans(_ARMOUR, _BASE64)
_CHARACTERS = "@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_ !\"#$%&'()*+,-./0123456789:;<=>?"


class Layout(msgspec.Struct, frozen=True):
    """One message type: minimum and maximum length in bits, and the first bit and width of each field.

    A negative width marks a signed number.
    """

    min_bits: int
    max_bits: int
    fields: Mapping[str, tuple[int, int]]
    texts: Mapping[str, tuple[int, int]]


_NO_TEXTS: Mapping[str, tuple[int, int]] = {}
_CLASS_A = Layout(
    149,
    174,
    {
        "status": (38, 4),
        "turn": (42, -8),
        "speed": (50, 10),
        "accurate": (60, 1),
        "longitude": (61, -28),
        "latitude": (89, -27),
        "course": (116, 12),
        "heading": (128, 9),
    },
    _NO_TEXTS,
)
_CLASS_B = {
    "speed": (46, 10),
    "accurate": (56, 1),
    "longitude": (57, -28),
    "latitude": (85, -27),
    "course": (112, 12),
    "heading": (124, 9),
}


def _dimension_fields(start: int) -> dict[str, tuple[int, int]]:
    """Return the fields of the ship dimensions, which begin at bit `start`."""
    return {
        "to_bow": (start, 9),
        "to_stern": (start + 9, 9),
        "to_port": (start + 18, 6),
        "to_starboard": (start + 24, 6),
    }


# By message type: 1 to 3 position of class A, 4 base station, 5 static data of class A, 18 and 19 position of class B,
# 21 aid to navigation, 24 static data of class B, 27 long-range position. 25 stands for part B of type 24.
# Some stations omit the spare bits at the end or count them wrongly, and the name extension of an aid to navigation has
# fill bits, so each minimum length is that of the fields in the table.
TYPE_24_PART_B = 25
LAYOUTS: Mapping[int, Layout] = {
    1: _CLASS_A,
    2: _CLASS_A,
    3: _CLASS_A,
    4: Layout(149, 174, {"accurate": (78, 1), "longitude": (79, -28), "latitude": (107, -27)}, _NO_TEXTS),
    5: Layout(420, 426, {"ship_type": (232, 8), **_dimension_fields(240)}, {"call_sign": (70, 42), "name": (112, 120)}),
    18: Layout(148, 174, _CLASS_B, _NO_TEXTS),
    19: Layout(301, 318, {**_CLASS_B, "ship_type": (263, 8), **_dimension_fields(271)}, {"name": (143, 120)}),
    21: Layout(
        268,
        400,
        {
            "ship_type": (38, 5),
            "accurate": (163, 1),
            "longitude": (164, -28),
            "latitude": (192, -27),
            **_dimension_fields(219),
        },
        {"name": (43, 120)},
    ),
    24: Layout(160, 312, {}, {"name": (40, 120)}),
    TYPE_24_PART_B: Layout(162, 312, {"ship_type": (40, 8), **_dimension_fields(132)}, {"call_sign": (90, 42)}),
    27: Layout(
        94,
        168,
        {
            "accurate": (38, 1),
            "status": (40, 4),
            "longitude": (44, -18),
            "latitude": (62, -17),
            "speed": (79, 6),
            "course": (85, 9),
        },
        _NO_TEXTS,
    ),
}


class Payload(msgspec.Struct, frozen=True):
    """Numbers and texts of one message, in the units of the protocol; the type is TYPE_24_PART_B for part B of 24."""

    message_type: int
    mmsi: int
    numbers: Mapping[str, int]
    texts: Mapping[str, str]


def read_payload(characters: bytes, fill_bits: int) -> Payload | None:
    """Decode a payload; None for a type that is not used; raises MessageError for an invalid one."""
    if not characters:
        return None  # some receivers report an empty time slot this way
    if not MIN_CHARACTERS <= len(characters) <= MAX_CHARACTERS or characters.translate(None, _ARMOUR):
        raise MessageError(MALFORMED, "payload has invalid characters or an invalid length")
    bit_count = 6 * len(characters) - fill_bits
    packed = binascii.a2b_base64(characters.translate(_TO_BASE64) + b"A" * (-len(characters) % 4))
    packed_bits = int.from_bytes(packed)
    packed_width = 8 * len(packed)

    def read_number(start: int, signed_width: int) -> int:
        width = abs(signed_width)
        value = packed_bits >> (packed_width - start - width) & ((1 << width) - 1)
        return value - (1 << width) if signed_width < 0 and value >> (width - 1) else value

    message_type = read_number(0, 6)
    part = read_number(38, 2) if message_type == 24 else 0
    if part > 1 or message_type == TYPE_24_PART_B:
        return None
    message_type += part
    layout = LAYOUTS.get(message_type)
    if layout is None:
        return None
    if not layout.min_bits <= bit_count <= layout.max_bits:
        raise MessageError(
            MALFORMED,
            f"{bit_count} bits for a message of type {24 if message_type == TYPE_24_PART_B else message_type}",
        )
    numbers = {name: read_number(*bits) for name, bits in layout.fields.items()}
    texts = {name: _decode_text(read_number(*bits), bits[1]) for name, bits in layout.texts.items()}
    return Payload(message_type, read_number(8, 30), numbers, texts)


def _decode_text(value: int, width: int) -> str:
    """Decode a text of six-bit characters; the first @ ends it."""
    characters = (_CHARACTERS[value >> shift & 63] for shift in range(width - 6, -1, -6))
    return "".join(characters).partition("@")[0].rstrip()
