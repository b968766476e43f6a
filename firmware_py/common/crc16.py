"""CRC-16 checksums by fastcrc, and without it in Python: for a computer that no package of it is built for.

Names and parameters are those of the catalogue of CRC algorithms (reveng): polynomial, start value, and whether the
bits are taken the lowest first.
"""

from __future__ import annotations

from collections.abc import Callable

Checksum = Callable[[bytes], int]


def in_python(polynomial: int, start: int, *, reflected: bool) -> Checksum:
    """Return a checksum by a table of bytes; it takes 30 times as long as that of fastcrc."""
    table = [_entry(polynomial, byte, reflected=reflected) for byte in range(256)]

    def of_reflected(data: bytes) -> int:
        value = start
        for byte in data:
            value = value >> 8 ^ table[(value ^ byte) & 0xFF]
        return value

    def of_plain(data: bytes) -> int:
        value = start
        for byte in data:
            value = (value << 8 & 0xFFFF) ^ table[value >> 8 ^ byte]
        return value

    return of_reflected if reflected else of_plain


def _entry(polynomial: int, byte: int, *, reflected: bool) -> int:
    """Return the remainder of one byte; a reflected polynomial is given with its bits reversed."""
    value = byte if reflected else byte << 8
    for _ in range(8):
        if reflected:
            value = value >> 1 ^ (polynomial if value & 1 else 0)
        else:
            value = (value << 1 & 0xFFFF) ^ (polynomial if value & 0x8000 else 0)
    return value


try:
    from fastcrc import crc16 as _fast
except ImportError:
    _fast = None  # type: ignore[assignment]

cms: Checksum = in_python(0x8005, 0xFFFF, reflected=False) if _fast is None else _fast.cms
umts: Checksum = in_python(0x8005, 0x0000, reflected=False) if _fast is None else _fast.umts
xmodem: Checksum = in_python(0x1021, 0x0000, reflected=False) if _fast is None else _fast.xmodem
mcrf4xx: Checksum = in_python(0x8408, 0xFFFF, reflected=True) if _fast is None else _fast.mcrf4xx
