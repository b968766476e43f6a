"""Commands by satellite with the boat's key: the short form of a frame, and which numbers have been used.

A message ashore to her (docs/reference/satellite-messages.md) is MAVLink frames as they are, which are judged as on any
link, or one frame in the short form:

    mark 0xB5, number (5 bytes), system, component, message id (2 bytes), payload without its last zeros, code (8 bytes)

little-endian as MAVLink. The number is the time of writing in hundredths of a second since 2015, or one more than the
last; the code is the beginning of the HMAC-SHA256 by the boat's key over the text `sbd short form 1`, the modem's
IMEI and all of the message before it. A number counts once, in whatever order the messages come.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from hmac import compare_digest

import msgspec
from msgspec.structs import replace

from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import checksum

MARK = 0xB5
CODE_BYTES = 8
KEPT_NUMBERS = 128
UNITS_HZ = 100.0
EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
_CONTEXT = b"sbd short form 1"
_NUMBER = slice(1, 6)
_HEAD_BYTES = 10


class Keyed(msgspec.Struct, frozen=True):
    """A frame of the short form whose code holds; `frame` is the same as MAVLink 2."""

    number: int
    frame: bytes

    def age_s(self, utc_s: float) -> float:
        """Return how long ago it was written."""
        return utc_s - EPOCH_S - self.number / UNITS_HZ


def open_keyed(message: bytes, imei: str, code: Callable[[bytes], bytes | None]) -> Keyed | str:
    """Return the frame of a message in the short form, or why it is none; `code` makes an HMAC, None without a key."""
    if len(message) < _HEAD_BYTES + CODE_BYTES:
        return "cut short"
    covered, told = message[:-CODE_BYTES], message[-CODE_BYTES:]
    right = code(_CONTEXT + imei.encode() + covered)
    if right is None:
        return "there is no key"
    if not compare_digest(right[:CODE_BYTES], told):
        return "false code"
    system, component, payload = covered[6], covered[7], covered[_HEAD_BYTES:] or b"\0"
    number = int.from_bytes(covered[8:10], "little")
    kind = mavlink.mavlink_map.get(number)
    if kind is None or len(payload) > kind.unpacker.size:
        return "unknown message"
    body = bytes((len(payload), 0, 0, 0, system, component)) + number.to_bytes(3, "little") + payload
    checked = checksum(body, bytes((kind.crc_extra,)))
    return Keyed(int.from_bytes(covered[_NUMBER], "little"), b"\xfd" + body + checked.to_bytes(2, "little"))


class Window(msgspec.Struct, frozen=True):
    """The latest numbers that have counted, in order, and `floor`: up to there none counts any more."""

    floor: int = 0
    used: tuple[int, ...] = ()

    def admits(self, number: int) -> bool:
        """Return whether a number has not counted yet."""
        return number > self.floor and number not in self.used

    def with_number(self, number: int) -> Window:
        """Return it after a number has counted."""
        place = bisect_left(self.used, number)
        used = (*self.used[:place], number, *self.used[place:])
        if len(used) <= KEPT_NUMBERS:
            return replace(self, used=used)
        return Window(max(self.floor, used[0]), used[1:])
