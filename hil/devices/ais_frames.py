"""Encoding of AIS messages: values to bits, to 6-bit characters, to NMEA 0183 sentences.

Written from ITU-R M.1371-5 and IEC 61162-1, independent of the firmware's decoder.
"""

from __future__ import annotations

MAX_CHARACTERS = 60  # of the payload of one sentence
# Values that mean "not available": raw rate of turn, knots, degrees.
NO_TURN, NO_SPEED, NO_COURSE, NO_HEADING, NO_LATITUDE_DEG, NO_LONGITUDE_DEG = -128, 102.3, 360.0, 511, 91.0, 181.0

Dimensions = tuple[int, int, int, int]  # from the antenna to bow, stern, port and starboard side, m


class Bits:
    """A string of bits, built field by field, most significant bit first."""

    def __init__(self) -> None:
        """Start empty."""
        self._digits: list[str] = []

    def add(self, value: int, width: int) -> Bits:
        """Add an integer; a negative one as two's complement."""
        self._digits.append(format(value % (1 << width), f"0{width}b"))
        return self

    def add_text(self, text: str, length: int) -> Bits:
        """Add 6-bit characters (capital letters, digits and signs), truncated to the length or padded with @."""
        for character in text[:length].ljust(length, "@"):
            self.add(ord(character) % 64, 6)
        return self

    def payload(self) -> tuple[str, int]:
        """Return the payload and the number of padding bits in its last character."""
        digits = "".join(self._digits)
        fill = -len(digits) % 6
        digits += "0" * fill
        numbers = (int(digits[start : start + 6], 2) for start in range(0, len(digits), 6))
        return "".join(chr(number + (48 if number < 40 else 56)) for number in numbers), fill


def _add_position(bits: Bits, latitude_deg: float, longitude_deg: float) -> Bits:
    return bits.add(round(longitude_deg * 600_000.0), 28).add(round(latitude_deg * 600_000.0), 27)


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
    """Return a position report of class A (message 1); second 60: the time is not available."""
    bits = Bits().add(1, 6).add(0, 2).add(mmsi, 30).add(status, 4).add(NO_TURN, 8)
    bits.add(_tenths(speed_kn, 1023), 10).add(1, 1)
    _add_position(bits, latitude_deg, longitude_deg)
    return bits.add(_tenths(course_deg, 4095), 12).add(heading_deg, 9).add(second, 6).add(0, 2 + 3 + 1 + 19)


def position_b(
    mmsi: int, latitude_deg: float, longitude_deg: float, speed_kn: float, course_deg: float, *, second: int = 60
) -> Bits:
    """Return a position report of class B (message 18), without a heading."""
    bits = Bits().add(18, 6).add(0, 2).add(mmsi, 30).add(0, 8).add(_tenths(speed_kn, 1023), 10).add(0, 1)
    _add_position(bits, latitude_deg, longitude_deg)
    bits.add(_tenths(course_deg, 4095), 12).add(NO_HEADING, 9).add(second, 6)
    return bits.add(0, 2 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 20)


def _add_dimensions(bits: Bits, dimensions_m: Dimensions) -> Bits:
    to_bow, to_stern, to_port, to_starboard = dimensions_m
    return bits.add(to_bow, 9).add(to_stern, 9).add(to_port, 6).add(to_starboard, 6)


def static_a(mmsi: int, name: str, call_sign: str, ship_type: int, dimensions_m: Dimensions) -> Bits:
    """Return static data of class A (message 5)."""
    bits = Bits().add(5, 6).add(0, 2).add(mmsi, 30).add(0, 2).add(0, 30).add_text(call_sign, 7).add_text(name, 20)
    _add_dimensions(bits.add(ship_type, 8), dimensions_m)
    # Position by GPS, no time of arrival, draught of 5.0 m, destination.
    return bits.add(1, 4).add(0, 20).add(50, 8).add_text("SEA", 20).add(0, 2)


def static_b(mmsi: int, name: str, call_sign: str, ship_type: int, dimensions_m: Dimensions) -> tuple[Bits, Bits]:
    """Return static data of class B, parts A and B (message 24)."""
    part_a = Bits().add(24, 6).add(0, 2).add(mmsi, 30).add(0, 2).add_text(name, 20)
    part_b = Bits().add(24, 6).add(0, 2).add(mmsi, 30).add(1, 2).add(ship_type, 8).add(0, 42)
    return part_a, _add_dimensions(part_b.add_text(call_sign, 7), dimensions_m).add(0, 6)


def mark(mmsi: int, name: str, latitude_deg: float, longitude_deg: float) -> Bits:
    """Return the report of an aid to navigation (message 21)."""
    # 14: beacon, starboard hand; second 60: no time.
    bits = Bits().add(21, 6).add(0, 2).add(mmsi, 30).add(14, 5).add_text(name, 20).add(0, 1)
    _add_position(bits, latitude_deg, longitude_deg)
    return bits.add(0, 30).add(1, 4).add(60, 6).add(0, 1 + 8 + 1 + 1 + 1 + 1)


def sentences(bits: Bits, *, channel: str = "A", sequence: int = 0, own: bool = False) -> bytes:
    """Return the sentences of a message, received (AIVDM) or the boat's own (AIVDO)."""
    payload, fill = bits.payload()
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
