"""MAVLink frames: finds them in received bytes, decodes, packs and stamps them, and converts them to MAVLink 1.

pymavlink's own stream parser is not used: it keeps every byte while reads end in the middle of a frame, skips a whole
claimed frame (up to 280 good bytes) after one false marker, and waits forever for the rest of a frame that was never
sent. `Splitter` steps over a false marker by one byte, holds less than one frame, and gives up on an incomplete frame:
soon if another whole frame is found behind its start, otherwise late, since a modem may deliver a frame in pieces.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from firmware_py.common.crc16 import mcrf4xx
from firmware_py.link.wire.dialect import Message, mavlink, payload_of_addition

STALE_S = 0.5  # an incomplete frame is dropped after this if another is found behind its start
LATE_S = 10.0  # and in any case after this, on a slow line later
_LONGEST_FRAME = 280
_MARKER = re.compile(b"[\xfd\xfe]")
MAVLINK1, _MAVLINK2 = 0xFE, 0xFD
_HEADER = {0xFD: 10, 0xFE: 6}
_SIGNED = 0x01
_SIGNATURE = 13
_WAIT = 0  # may be a frame, when more bytes come
_FALSE = -1  # not the start of a frame

_MAX_MAVLINK1_NUMBER = 255
_RADIO_STATUS = 109  # sent by the modem, not by the peer behind it
_VERSION1_S = 10.0  # stations start with MAVLink 1 and change to MAVLink 2 once they have received it
_VERSION1_FRAMES = 5

# Payload bytes without extension fields, of all messages of the boat that have such fields.
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


_SEEDS = {number: bytes((kind.crc_extra,)) for number, kind in mavlink.mavlink_map.items()}


class Packed(NamedTuple):
    """A message ready to be stamped with a peer's sequence number."""

    frame: bytes  # whole, with sequence number 0 and, until it is stamped, no checksum
    seed: bytes  # crc_extra, one byte; empty for a routed frame, which keeps its number and signature


def checksum(covered: bytes, seed: bytes) -> int:
    """Return the checksum of a frame without its first byte, its checksum and its signature."""
    return mcrf4xx(covered + seed)


def stamp(packed: Packed, sequence: int) -> bytes:
    """Return the frame with this sequence number and its checksum: a tenth of the cost of packing it again."""
    frame = packed.frame
    place = 4 if frame[0] == _MAVLINK2 else 2
    covered = frame[1:place] + bytes((sequence,)) + frame[place + 1 : -2]
    return frame[:1] + covered + checksum(covered, packed.seed).to_bytes(2, "little")


def _payload_alone(_mav: object, _seed: int, payload: bytes, force_mavlink1: bool = False) -> bytes:  # noqa: ARG001, FBT001, FBT002 - pymavlink's signature
    return payload


def _samples() -> tuple[Message, ...]:
    """Return messages with different layouts: zeros at the end, a text, an array, one of the additions."""
    return (
        mavlink.MAVLink_attitude_message(5, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0),
        mavlink.MAVLink_statustext_message(4, b"text", 3, 1),
        mavlink.MAVLink_battery_status_message(0, 0, 1, 2510, [12345] + [0xFFFF] * 9, -120, 5, -1, 80),
        mavlink.mavlink_map[436](3, 15, 0),
    )


class Codec:
    """Packs the messages of one system and component, and decodes received ones."""

    def __init__(self, system: int, component: int) -> None:
        """Take the MAVLink address that outgoing frames carry."""
        self._address = bytes((system, component))
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.quick = self._packs_quickly()

    def pack(self, message: Message) -> Packed:
        """Return the packed message; struct.error for a field that does not fit.

        pymavlink packs the payload; the header is added here, which takes a third of pymavlink's time.
        """
        return self._pack_quickly(message) if self.quick else self._pack_whole(message)

    def _packs_quickly(self) -> bool:
        """Return whether packing by pymavlink's private names gives its own result: another version may differ."""
        try:
            return all(self._pack_quickly(message) == self._pack_whole(message) for message in _samples())
        except Exception:  # noqa: BLE001 - whatever it does instead
            return False

    def _pack_whole(self, message: Message) -> Packed:
        number, added = type(message).id, payload_of_addition(message)
        if added is not None:
            return self.pack_payload(number, added)
        return Packed(bytes(message.pack(self._mav))[:-2] + b"\0\0", _SEEDS[number])

    def _pack_quickly(self, message: Message) -> Packed:
        message._pack = _payload_alone  # noqa: SLF001 - the last that its classes do when they pack
        try:
            payload = message.pack(None)
        finally:
            del message._pack  # noqa: SLF001
        return self.pack_payload(type(message).id, payload)  # a field may be named id

    def pack_payload(self, number: int, payload: bytes) -> Packed:
        """Return a packed payload as a message: half the cost of `pack`, for long transfers.

        The checksum is left to `stamp`, as is the sequence number.
        """
        payload = payload.rstrip(b"\0") or b"\0"
        head = bytes((0xFD, len(payload), 0, 0, 0)) + self._address + number.to_bytes(3, "little")
        return Packed(head + payload + b"\0\0", _SEEDS[number])

    def decode(self, frame: bytes) -> Message | None:
        """Decode one whole frame with a valid checksum; None if that fails."""
        try:
            return self._mav.decode(bytearray(frame))
        except mavlink.MAVError:
            return None


class Frame(NamedTuple):
    """One frame with a valid checksum."""

    number: int  # message id
    data: bytes


class Splitter:
    """Splits the received bytes of one peer into frames."""

    __slots__ = ("_held", "_held_since_s", "_late_s", "rejected")

    def __init__(self, byte_rate: float | None = None) -> None:
        """Start empty; `byte_rate` is that of the line, in bytes a second."""
        self._late_s = LATE_S if byte_rate is None else max(LATE_S, 2.0 * _LONGEST_FRAME / byte_rate)
        self._held = b""
        self._held_since_s = 0.0
        self.rejected = 0  # frames with a wrong checksum

    def feed(self, data: bytes, now_s: float) -> list[Frame]:
        """Take bytes that arrived at now_s and return the frames they complete."""
        open_since_s = self._held_since_s if self._held else now_s
        whole = self._held + data
        frames = list(self._scan(whole))
        # Counted from its start: later bytes must not keep a false frame alive.
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
        """Drop the held start of a frame if it is false or too old; return the frames behind it."""
        held = self._held
        hidden = _first_frame(held)
        if hidden is None and age_s <= self._late_s:
            return []  # no frame behind it
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
    """Return the offset of the first whole frame behind the first byte, past other markers."""
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
    flags = data[start + 2] if marker == _MAVLINK2 and available > 2 else 0
    if flags & ~_SIGNED:
        return _FALSE
    header = _HEADER[marker]
    if available < header:
        return _WAIT
    length = data[start + 1]
    kind = mavlink.mavlink_map.get(_number(data, start))
    # MAVLink 2 may carry extension fields newer than this dialect; MAVLink 1 has none.
    if kind is None or (marker != _MAVLINK2 and length > kind.unpacker.size):
        return _FALSE
    size = header + length + 2 + (_SIGNATURE if flags else 0)
    return size if available >= size else _WAIT


def _number(data: bytes, start: int) -> int:
    if data[start] == _MAVLINK2:
        return int.from_bytes(data[start + 7 : start + 10], "little")
    return data[start + 5]


def _checked(frame: bytes) -> Frame | None:
    tail = 2 + (_SIGNATURE if frame[0] == _MAVLINK2 and frame[2] & _SIGNED else 0)
    number = _number(frame, 0)
    seed = bytes((mavlink.mavlink_map[number].crc_extra,))
    end = len(frame) - tail
    if checksum(frame[1:end], seed) != int.from_bytes(frame[end : end + 2], "little"):
        return None
    return Frame(number, frame)


def to_mavlink1(packed: Packed) -> Packed | None:
    """Return a message as MAVLink 1, without extension fields; None for a message that MAVLink 1 lacks."""
    frame = packed.frame
    number = int.from_bytes(frame[7:10], "little")
    if number > _MAX_MAVLINK1_NUMBER:
        return None
    length = _BASE_BYTES.get(number) or mavlink.mavlink_map[number].unpacker.size
    payload = frame[10:-2][:length].ljust(length, b"\0")
    return Packed(bytes((MAVLINK1, length, 0)) + frame[5:7] + bytes((number,)) + payload + b"\0\0", packed.seed)


class VersionDetector:
    """Detects a peer that understands MAVLink 1 only: it continues to send MAVLink 1 after frames of the boat."""

    __slots__ = ("_frames", "_since_s", "version1_only")

    def __init__(self) -> None:
        """Start with MAVLink 2."""
        self.version1_only = False
        self._frames = 0
        self._since_s: float | None = None

    def update(self, frames: Iterable[Frame], now_s: float) -> None:
        """Take received frames, after something was sent to the peer."""
        for frame in frames:
            if frame.number == _RADIO_STATUS:
                continue
            if frame.data[0] == _MAVLINK2:
                self.version1_only, self._frames, self._since_s = False, 0, None
                continue
            if self._since_s is None:
                self._since_s = now_s
            self._frames += 1
            if self._frames >= _VERSION1_FRAMES and now_s - self._since_s >= _VERSION1_S:
                self.version1_only = True
