"""Driver of OceanServer OS5000 compasses in their factory format: `$C320.5P0.2R-18.3T19.0*3C`.

Source: Digital Compass Users Guide, OS5000 Series, revision 5.0, "Format Type 0x01". C is the heading, P the pitch, R
the roll in degrees, T the temperature of the board; the two hexadecimal digits are the XOR of the bytes between $ and
*. Which fields are sent, and in which rate, is a setting of the device; the factory baud rate is 19200.
"""

from __future__ import annotations

import functools
import operator
import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Final

from firmware_py.common.driver import Driver
from firmware_py.common.interfaces import ByteLine, Compass
from firmware_py.common.options import check, option
from firmware_py.common.records import DeviceHealth, DeviceRole, HeadingSample, NorthReference
from firmware_py.sensors.device_monitor import DeviceMonitor

MAX_LINE_BYTES: Final = 160  # the longest sentence has about 100
_SENTENCE = re.compile(rb"\$(C[^*$]*)\*([0-9A-F]{2})\r?")
_FIELD = re.compile(r"([A-Z][a-z]?)(-?\d{1,6}(?:\.\d{1,4})?)")
# Range of each field that is used; others are ignored.
_RANGES: Final = {"C": (0.0, 360.0), "P": (-90.0, 90.0), "R": (-180.0, 180.0), "T": (-60.0, 120.0)}


@dataclass(frozen=True, slots=True)
class Os5000Options:
    """Options of the vehicle file; raises ValueError."""

    roll_sign: int = option("1 or -1: the driver multiplies the roll with it", default=1, minimum=-1, maximum=1)

    def __post_init__(self) -> None:
        """Check the range."""
        check(self)
        if self.roll_sign == 0:
            raise ValueError("roll_sign: expected 1 or -1")


def read_sentence(line: bytes) -> dict[str, float]:
    """Return the fields of a sentence by letter, degrees and degrees Celsius; raise ValueError with the reason."""
    match = _SENTENCE.fullmatch(line)
    if match is None:
        raise ValueError("no sentence of the $C format")
    body, checksum = match.groups()
    if functools.reduce(operator.xor, body) != int(checksum, 16):
        raise ValueError("checksum")
    text = body.decode("ascii", "replace")
    fields = _FIELD.findall(text)
    if "".join(letter + number for letter, number in fields) != text:
        raise ValueError("a field is not a number")
    values = {letter: float(number) for letter, number in fields}
    for letter, (low, high) in _RANGES.items():
        if letter in values and not low <= values[letter] <= high:
            raise ValueError(f"{letter} {values[letter]:g} is out of range")
    return values


class Os5000Compass:
    """An OS5000 that sends by itself; the driver writes nothing."""

    def __init__(self, line: ByteLine, options: Os5000Options) -> None:
        """Read from a line."""
        self._line = line
        self._options = options
        self._monitor = DeviceMonitor(line, DeviceRole.COMPASS)
        self._buffer = b""
        self._samples: list[HeadingSample] = []

    def fileno(self) -> int:
        """Return the descriptor to wait for, or -1."""
        return self._line.fileno()

    def receive(self, now_s: float) -> None:
        """Decode the received bytes with the time stamp now_s."""
        if self._monitor.notice_reopening():
            self._buffer = b""
        data = self._line.read()
        if data:
            self._monitor.note_bytes(now_s)
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        self._buffer = self._buffer[-MAX_LINE_BYTES:]
        for line in lines:
            self._handle_line(line[-MAX_LINE_BYTES:], now_s)

    def _handle_line(self, line: bytes, now_s: float) -> None:
        try:
            values = read_sentence(line)
        except ValueError as error:
            self._monitor.reject(now_s, str(error))
            return
        if "C" not in values:
            self._monitor.reject(now_s, "sentence without a heading")
            return
        self._monitor.accept(now_s)
        pitch_deg, roll_deg = values.get("P"), values.get("R")
        self._samples.append(
            HeadingSample(
                t_s=now_s,
                heading_rad=radians(values["C"] % 360.0),
                reference=NorthReference.MAGNETIC,
                roll_rad=None if roll_deg is None else radians(self._options.roll_sign * roll_deg),
                pitch_rad=None if pitch_deg is None else radians(pitch_deg),
                temperature_c=values.get("T"),
            )
        )

    def poll(self) -> Sequence[HeadingSample]:
        """Return the samples since the last poll, oldest first."""
        samples, self._samples = self._samples, []
        return samples

    def health(self, now_s: float) -> DeviceHealth:
        """Return the state of the compass."""
        return self._monitor.health(now_s)


DRIVER: Driver[Compass] = Driver(interface=1, device="OceanServer OS5000", options=Os5000Options, make=Os5000Compass)
