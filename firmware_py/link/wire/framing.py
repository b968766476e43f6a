"""Finds MAVLink frames in a stream of hostile bytes.

pymavlink's own stream parser is not used: it keeps every byte for as long as reads end
in the middle of a frame, skips a whole claimed frame (up to 280 good bytes) after one
false marker, and waits for ever for the rest of a frame that was never sent. This one
steps over a false marker by one byte, holds less than one frame, and gives up on the
rest of a frame that does not come: soon where another frame has come meanwhile, which a
true one cannot hold, else late, since a modem may deliver one in pieces, seconds apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from firmware_py.link.wire.dialect import checksum, mavlink

STALE_S = 0.5  # a frame that has not come whole after this is none if another is found behind its beginning
LATE_S = 10.0  # and in any case after this; on a slow line, later
_LONGEST_FRAME = 280
_MARKER = re.compile(b"[\xfd\xfe]")
_V2 = 0xFD
_HEADER = {0xFD: 10, 0xFE: 6}
_SIGNED = 0x01
_SIGNATURE = 13
_WAIT = 0  # may be a frame, when more bytes come
_FALSE = -1  # no frame starts here


class Frame(NamedTuple):
    """One frame with a right checksum."""

    number: int  # message id
    data: bytes


class Splitter:
    """Takes the bytes of one peer as they come and gives its frames."""

    __slots__ = ("_held", "_held_since_s", "_late_s", "rejected")

    def __init__(self, byte_rate: float | None = None) -> None:
        """Start with nothing held; `byte_rate` is the line's, in bytes a second."""
        self._late_s = LATE_S if byte_rate is None else max(LATE_S, 2.0 * _LONGEST_FRAME / byte_rate)
        self._held = b""
        self._held_since_s = 0.0
        self.rejected = 0  # markers that looked like a frame and had a wrong checksum

    def feed(self, data: bytes, now_s: float) -> list[Frame]:
        """Take bytes that arrived at now_s and return the frames they complete."""
        open_since_s = self._held_since_s if self._held else now_s
        whole = self._held + data
        frames = list(self._scan(whole))
        # Counted from its beginning: what comes later must not keep a false frame alive.
        if not (self._held and len(self._held) == len(whole)):
            self._held_since_s = now_s
        elif now_s - open_since_s > STALE_S:
            frames = self._doubt(now_s - open_since_s)
            if self._held != whole:
                self._held_since_s = now_s
        else:
            self._held_since_s = open_since_s
        return frames

    def _doubt(self, age_s: float) -> list[Frame]:
        """Give up on the beginning that is held if it is false, or too late; return the frames that it hid."""
        held = self._held
        hidden = _first_frame(held)
        if hidden is None and age_s <= self._late_s:
            return []  # nothing waits behind it
        return list(self._scan(held[1 if hidden is None else hidden :]))

    def _scan(self, data: bytes) -> Iterator[Frame]:
        position = 0
        self._held = b""
        while (marker := _MARKER.search(data, position)) is not None:
            start = marker.start()
            size = _claimed_size(data, start)
            if size == _WAIT:
                self._held = data[start:]
                return
            position = start + 1
            if size == _FALSE:
                continue
            frame = _checked(data[start : start + size])
            if frame is None:
                self.rejected += 1
            else:
                position = start + size
                yield frame


def _first_frame(data: bytes) -> int | None:
    """Return where the first whole frame behind the first byte begins, whatever beginnings stand before it."""
    position = 1
    while (marker := _MARKER.search(data, position)) is not None:
        start = marker.start()
        size = _claimed_size(data, start)
        if size > 0 and _checked(data[start : start + size]) is not None:
            return start
        position = start + 1
    return None


def _claimed_size(data: bytes, start: int) -> int:
    """Return the size of the whole frame that starts here, _WAIT or _FALSE."""
    available = len(data) - start
    marker = data[start]
    flags = data[start + 2] if marker == _V2 and available > 2 else 0
    if flags & ~_SIGNED:
        return _FALSE
    header = _HEADER[marker]
    if available < header:
        return _WAIT
    length = data[start + 1]
    kind = mavlink.mavlink_map.get(_number(data, start))
    # MAVLink 2 may carry extension fields newer than this dialect; MAVLink 1 has none.
    if kind is None or (marker != _V2 and length > kind.unpacker.size):
        return _FALSE
    size = header + length + 2 + (_SIGNATURE if flags else 0)
    return size if available >= size else _WAIT


def _number(data: bytes, start: int) -> int:
    if data[start] == _V2:
        return int.from_bytes(data[start + 7 : start + 10], "little")
    return data[start + 5]


def _checked(frame: bytes) -> Frame | None:
    tail = 2 + (_SIGNATURE if frame[0] == _V2 and frame[2] & _SIGNED else 0)
    number = _number(frame, 0)
    seed = bytes((mavlink.mavlink_map[number].crc_extra,))
    end = len(frame) - tail
    if checksum(frame[1:end], seed) != int.from_bytes(frame[end : end + 2], "little"):
        return None
    return Frame(number, frame)
