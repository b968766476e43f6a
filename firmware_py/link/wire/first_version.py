"""MAVLink 1, for a correspondent that understands nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from firmware_py.link.wire.dialect import Packed, mavlink
from firmware_py.link.wire.framing import Frame

MAVLINK1, _MAVLINK2 = 0xFE, 0xFD
_MOST_NUMBER = 255  # it has no messages beyond
_RADIO_STATUS = 109  # of the modem, whoever is behind it
_PATIENCE_S = 10.0  # stations begin in MAVLink 1 and go over to the second once they have heard it
_FRAMES = 5

# Bytes of the payload without the fields that only MAVLink 2 carries, of all messages of the boat that have such.
_BASE_BYTES: Mapping[int, int] = {
    1: 31,
    24: 30,
    26: 22,
    31: 32,
    36: 21,
    39: 37,
    40: 4,
    42: 2,
    44: 4,
    47: 3,
    49: 12,
    51: 4,
    73: 37,
    77: 3,
    111: 16,
    147: 36,
    148: 60,
    162: 8,
    192: 44,
    242: 52,
    253: 51,
}


def in_first_version(packed: Packed) -> Packed | None:
    """Return a message as MAVLink 1, without the fields that it has not; None for one that it has not at all."""
    frame = packed.frame
    number = int.from_bytes(frame[7:10], "little")
    if number > _MOST_NUMBER:
        return None
    length = _BASE_BYTES.get(number) or mavlink.mavlink_map[number].unpacker.size
    payload = frame[10:-2][:length].ljust(length, b"\0")
    return Packed(bytes((MAVLINK1, length, 0)) + frame[5:7] + bytes((number,)) + payload + b"\0\0", packed.seed)


class VersionHeard:
    """Which version of MAVLink a correspondent understands, by what it goes on to send once it could have heard her."""

    __slots__ = ("_frames", "_since_s", "only_first")

    def __init__(self) -> None:
        """Take it for one that understands MAVLink 2."""
        self.only_first = False
        self._frames = 0
        self._since_s: float | None = None

    def hear(self, frames: Iterable[Frame], now_s: float) -> None:
        """Take frames from it, after something was sent to it."""
        for frame in frames:
            if frame.number == _RADIO_STATUS:
                continue
            if frame.data[0] == _MAVLINK2:
                self.only_first, self._frames, self._since_s = False, 0, None
                continue
            if self._since_s is None:
                self._since_s = now_s
            self._frames += 1
            if self._frames >= _FRAMES and now_s - self._since_s >= _PATIENCE_S:
                self.only_first = True
