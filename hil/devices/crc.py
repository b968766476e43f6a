"""CRC-16 of the emulated devices, with their own tables.

The drivers use a library; the emulators do not, so that two errors cannot cancel. Both polynomials are computed most
significant bit first, not reflected.
"""

from __future__ import annotations

_MASK = 0xFFFF


def _make_table(polynomial: int) -> tuple[int, ...]:
    """Return the 256 remainders of one byte shifted through the polynomial."""
    rows = []
    for byte in range(256):
        remainder = byte << 8
        for _ in range(8):
            remainder = (remainder << 1) ^ (polynomial if remainder & 0x8000 else 0)
        rows.append(remainder & _MASK)
    return tuple(rows)


_TABLE_1021 = _make_table(0x1021)
_TABLE_8005 = _make_table(0x8005)


def _remainder(table: tuple[int, ...], data: bytes, initial: int) -> int:
    remainder = initial
    for byte in data:
        remainder = ((remainder << 8) & _MASK) ^ table[(remainder >> 8) ^ byte]
    return remainder


def crc16_1021(data: bytes, initial: int = 0) -> int:
    """Return the CRC of x^16 + x^12 + x^5 + 1 (PNI starts from 0)."""
    return _remainder(_TABLE_1021, data, initial)


def crc16_8005(data: bytes, initial: int = 0) -> int:
    """Return the CRC of x^16 + x^15 + x^2 + 1 (Dynamixel starts from 0, Volz from 0xFFFF)."""
    return _remainder(_TABLE_8005, data, initial)
