"""Encoding of AIS messages: values to bits, to 6-bit characters, to NMEA 0183 sentences.

Written from ITU-R M.1371-5 and IEC 61162-1, independent of the firmware's decoder.
"""

from __future__ import annotations

MAX_CHARACTERS = 60  # of the payload of one sentence
NOT_UNDER_WAY = (1, 5)  # at anchor, moored
NO_TURN, NO_SPEED, NO_COURSE, NO_HEADING, NO_LATITUDE_DEG, NO_LONGITUDE_DEG = -128, 102.3, 360.0, 511, 91.0, 181.0

Dimensions = tuple[int, int, int, int]  # from the antenna to bow, stern, port and starboard side, m


class Bits:
    """A string of bits, built field by field, most significant bit first."""

    def __init__(self) -> None:
        """Start empty."""
        self._digits: list[str] = []

    def whole(self, value: int, width: int) -> Bits:
        """Add an integer; a negative one as two's complement."""
        self._digits.append(format(value % (1 << width), f"0{width}b"))
        return self

    def text(self, text: str, letters: int) -> Bits:
        """Add a text of capital letters, digits and signs, padded with @."""
        for letter in text[:letters].ljust(letters, "@"):
            self.whole(ord(letter) % 64, 6)
        return self

    def letters(self) -> tuple[str, int]:
        """Return the payload and the number of padding bits in its last character."""
        digits = "".join(self._digits)
        fill = -len(digits) % 6
        digits += "0" * fill
        numbers = (int(digits[start : start + 6], 2) for start in range(0, len(digits), 6))
        return "".join(chr(number + (48 if number < 40 else 56)) for number in numbers), fill


def _place(bits: Bits, latitude_deg: float, longitude_deg: float) -> Bits:
    return bits.whole(round(longitude_deg * 600_000.0), 28).whole(round(latitude_deg * 600_000.0), 27)


def _tenths(value: float, maximum: int) -> int:
    return min(round(value * 10.0), maximum)


def position_a(
    mmsi: int,
    latitude_deg: float,
    longitude_deg: float,
    speed_kn: float,
    course_deg: float,
    heading_deg: int,
    *,
    status: int = 0,
    second: int = 60,
) -> Bits:
    """Return a position report of class A (message 1)."""
    bits = Bits().whole(1, 6).whole(0, 2).whole(mmsi, 30).whole(status, 4).whole(NO_TURN, 8)
    bits.whole(_tenths(speed_kn, 1023), 10).whole(1, 1)
    _place(bits, latitude_deg, longitude_deg)
    return bits.whole(_tenths(course_deg, 4095), 12).whole(heading_deg, 9).whole(second, 6).whole(0, 2 + 3 + 1 + 19)


def position_b(
    mmsi: int, latitude_deg: float, longitude_deg: float, speed_kn: float, course_deg: float, *, second: int = 60
) -> Bits:
    """Return a position report of class B (message 18), without a heading."""
    bits = Bits().whole(18, 6).whole(0, 2).whole(mmsi, 30).whole(0, 8).whole(_tenths(speed_kn, 1023), 10).whole(0, 1)
    _place(bits, latitude_deg, longitude_deg)
    bits.whole(_tenths(course_deg, 4095), 12).whole(NO_HEADING, 9).whole(second, 6)
    return bits.whole(0, 2 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 20)


def _dimensions(bits: Bits, dimensions_m: Dimensions) -> Bits:
    to_bow, to_stern, to_port, to_starboard = dimensions_m
    return bits.whole(to_bow, 9).whole(to_stern, 9).whole(to_port, 6).whole(to_starboard, 6)


def static_a(mmsi: int, name: str, call_sign: str, ship_type: int, dimensions_m: Dimensions) -> Bits:
    """Return static data of class A (message 5)."""
    bits = Bits().whole(5, 6).whole(0, 2).whole(mmsi, 30).whole(0, 2).whole(0, 30).text(call_sign, 7).text(name, 20)
    _dimensions(bits.whole(ship_type, 8), dimensions_m)
    return bits.whole(1, 4).whole(0, 20).whole(50, 8).text("SEA", 20).whole(0, 2)


def static_b(mmsi: int, name: str, call_sign: str, ship_type: int, dimensions_m: Dimensions) -> tuple[Bits, Bits]:
    """Return static data of class B, parts A and B (message 24)."""
    first = Bits().whole(24, 6).whole(0, 2).whole(mmsi, 30).whole(0, 2).text(name, 20)
    second = Bits().whole(24, 6).whole(0, 2).whole(mmsi, 30).whole(1, 2).whole(ship_type, 8).whole(0, 42)
    return first, _dimensions(second.text(call_sign, 7), dimensions_m).whole(0, 6)


def mark(mmsi: int, name: str, latitude_deg: float, longitude_deg: float) -> Bits:
    """Return a report of an aid to navigation (message 21), a buoy."""
    bits = Bits().whole(21, 6).whole(0, 2).whole(mmsi, 30).whole(14, 5).text(name, 20).whole(0, 1)
    _place(bits, latitude_deg, longitude_deg)
    return bits.whole(0, 30).whole(1, 4).whole(60, 6).whole(0, 1 + 8 + 1 + 1 + 1 + 1)


def sentences(bits: Bits, *, channel: str = "A", sequence: int = 0, own: bool = False) -> bytes:
    """Return the sentences of a message, received (AIVDM) or the boat's own (AIVDO)."""
    payload, fill = bits.letters()
    pieces = [payload[start : start + MAX_CHARACTERS] for start in range(0, len(payload), MAX_CHARACTERS)]
    address, group = "AIVDO" if own else "AIVDM", str(sequence % 10) if len(pieces) > 1 else ""
    lines = []
    for number, piece in enumerate(pieces, start=1):
        body = f"{address},{len(pieces)},{number},{group},{channel},{piece},{fill if number == len(pieces) else 0}"
        check = 0
        for byte in body.encode("ascii"):
            check ^= byte
        lines.append(f"!{body}*{check:02X}\r\n")
    return "".join(lines).encode("ascii")
