"""Formatting of NMEA 0183 sentences, for the emulators only."""

from __future__ import annotations

import math
from datetime import UTC, datetime

_HUNDREDTHS_PER_DAY = 8_640_000


def whole_sentence(body: str) -> bytes:
    """Return a complete sentence with checksum for the text between `$` and `*`."""
    total = 0
    for byte in body.encode("ascii"):
        total ^= byte
    return f"${body}*{total:02X}\r\n".encode("ascii")


def decimals_of(resolution: float) -> int:
    """Return the number of decimals for a resolution: 0.1 gives 1, 0.5 gives 1, 1 gives 0."""
    return max(0, math.ceil(-math.log10(resolution) - 1e-9))


def bearing(angle_deg: float, resolution_deg: float) -> float:
    """Round an angle to the resolution and wrap it to [0, 360), never 360."""
    rounded_deg = round(angle_deg / resolution_deg) * resolution_deg % 360.0
    return 0.0 if 360.0 - rounded_deg < 0.5 * resolution_deg else rounded_deg


def hemisphere_letter(value: float, positive: str, negative: str) -> str:
    """Return the letter of a signed value; 0 counts as positive."""
    return negative if value < 0.0 else positive


def format_coordinate(angle_deg: float, *, degree_digits: int, letters: tuple[str, str]) -> str:
    """Return `ddmm.mmmmm,X`, rounded before it is split so that the minutes are never 60."""
    units = round(abs(angle_deg) * 60.0 * 1e5)
    degrees, remainder = divmod(units, 60 * 100_000)
    minutes, fraction = divmod(remainder, 100_000)
    return f"{degrees:0{degree_digits}d}{minutes:02d}.{fraction:05d},{hemisphere_letter(angle_deg, *letters)}"


def format_clock_and_date(utc_s: float) -> tuple[str, str]:
    """Return `hhmmss.ss` and `ddmmyy`, rounded together so that the date belongs to the time."""
    day, hundredths = divmod(round(utc_s * 100.0), _HUNDREDTHS_PER_DAY)
    seconds, remainder = divmod(hundredths, 100)
    hours, minutes = seconds // 3600, seconds // 60 % 60
    date = datetime.fromtimestamp(day * 86_400, tz=UTC)
    return f"{hours:02d}{minutes:02d}{seconds % 60:02d}.{remainder:02d}", date.strftime("%d%m%y")
