"""MAVLink frames: splitting of received bytes, decoding, packing, sequence numbers, and conversion to MAVLink 1.

The stream parser of pymavlink is not used. It stores all bytes while reads end in the middle of a frame, skips up to
280 valid bytes after one false marker, and waits without limit for the rest of an incomplete frame. `Splitter` skips
one byte after a false marker and stores less than one frame. It drops an incomplete frame after STALE_S if a complete
frame follows its start, and otherwise after LATE_S, since a modem may deliver a frame in pieces.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from firmware_py.common.crc16 import mcrf4xx
from firmware_py.link.wire.dialect import Message, mavlink, payload_of_addition

STALE_S = 0.5  # maximum age of an incomplete frame that a complete frame follows
LATE_S = 10.0  # maximum age of any incomplete frame; longer on a slow line
MAX_FRAME_BYTES = 280
_MARKER = re.compile(b"[\xfd\xfe]")
MAVLINK1, _MAVLINK2 = 0xFE, 0xFD
_HEADER_BYTES = {_MAVLINK2: 10, MAVLINK1: 6}
_SIGNED_FLAG = 0x01
_SIGNATURE_BYTES = 13
_INCOMPLETE = 0  # size of a possible frame whose end is missing

_MAX_MAVLINK1_NUMBER = 255
_RADIO_STATUS = 109  # sent by the modem, not by the peer
_MIN_MAVLINK1_S = 10.0  # some stations start with MAVLink 1 and change when they receive MAVLink 2
_MIN_MAVLINK1_FRAMES = 5

# Message id: payload bytes without extension fields, for the messages of the boat that have such fields.
_BASE_BYTES: Mapping[int, int] = {
    1: 31,  # SYS_STATUS
    24: 30,  # GPS_RAW_INT
    31: 32,  # ATTITUDE_QUATERNION
    36: 21,  # SERVO_OUTPUT_RAW
    39: 37,  # MISSION_ITEM
    40: 4,  # MISSION_REQUEST
    42: 2,  # MISSION_CURRENT
    44: 4,  # MISSION_COUNT
    47: 3,  # MISSION_ACK
    49: 12,  # GPS_GLOBAL_ORIGIN
    51: 4,  # MISSION_REQUEST_INT
    73: 37,  # MISSION_ITEM_INT
    77: 3,  # COMMAND_ACK
    111: 16,  # TIMESYNC
    147: 36,  # BATTERY_STATUS
    148: 60,  # AUTOPILOT_VERSION
    162: 8,  # FENCE_STATUS
    192: 44,  # MAG_CAL_REPORT
    242: 52,  # HOME_POSITION
    253: 51,  # STATUSTEXT
}


# The seed of the checksum of a message (crc_extra), by message id.
_SEEDS = {number: bytes((kind.crc_extra,)) for number, kind in mavlink.mavlink_map.items()}


class Packed(NamedTuple):
    """Message frame without sequence number and checksum, which differ between peers."""

    frame: bytes  # complete, with zeros for sequence number and checksum
    seed: bytes  # crc_extra, one byte; empty for a routed frame, which keeps its sequence number and signature


def checksum(covered: bytes, seed: bytes) -> int:
    """Return the checksum of a frame; `covered` excludes the marker, the checksum and the signature."""
    return mcrf4xx(covered + seed)


def stamp(packed: Packed, sequence: int) -> bytes:
    """Insert sequence number and checksum, at a tenth of the cost of packing the message again."""
    frame = packed.frame
    offset = 4 if frame[0] == _MAVLINK2 else 2
    covered = frame[1:offset] + bytes((sequence,)) + frame[offset + 1 : -2]
    return frame[:1] + covered + checksum(covered, packed.seed).to_bytes(2, "little")


def _return_payload(_mav: object, _seed: int, payload: bytes, force_mavlink1: bool) -> bytes:  # noqa: ARG001, FBT001 - pymavlink's signature
    return payload


def _sample_messages() -> tuple[Message, ...]:
    """Return messages with different layouts: trailing zeros, a text, an array, an addition."""
    return (
        mavlink.MAVLink_attitude_message(*range(7)),
        mavlink.MAVLink_statustext_message(1, b"text"),
        mavlink.MAVLink_battery_status_message(*range(4), range(10), *range(4)),
        mavlink.mavlink_map[436](*range(3)),  # CURRENT_MODE
    )


class Codec:
    """Packs the messages of one system and component, and decodes received ones."""

    def __init__(self, system: int, component: int) -> None:
        """Store the source address of outgoing frames."""
        self._address = bytes((system, component))
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.packs_payload_only = self._can_pack_payload_only()

    def pack(self, message: Message) -> Packed:
        """Pack a message; raise struct.error for a field out of range.

        pymavlink packs the payload only; `pack_payload` adds the header, in a third of the time of pymavlink.
        """
        return self._pack_payload_only(message) if self.packs_payload_only else self._pack_complete(message)

    def _can_pack_payload_only(self) -> bool:
        """Return whether packing with a private name of pymavlink is correct; another version may differ."""
        try:
            return all(
                self._pack_payload_only(message) == self._pack_complete(message) for message in _sample_messages()
            )
        except Exception:  # noqa: BLE001 - another version may raise any exception
            return False

    def _pack_complete(self, message: Message) -> Packed:
        number, payload = type(message).id, payload_of_addition(message)
        if payload is not None:
            return self.pack_payload(number, payload)
        return Packed(bytes(message.pack(self._mav))[:-2] + b"\0\0", _SEEDS[number])

    def _pack_payload_only(self, message: Message) -> Packed:
        message._pack = _return_payload  # noqa: SLF001 - pack() calls it with the packed payload
        try:
            payload = message.pack(None)
        finally:
            del message._pack  # noqa: SLF001
        return self.pack_payload(type(message).id, payload)  # of the class, since a field may be named id

    def pack_payload(self, number: int, payload: bytes) -> Packed:
        """Add the header to a packed payload. For long transfers this costs half of `pack`."""
        payload = payload.rstrip(b"\0") or b"\0"
        header = bytes((0xFD, len(payload), 0, 0, 0)) + self._address + number.to_bytes(3, "little")
        return Packed(header + payload + b"\0\0", _SEEDS[number])

    def decode(self, frame: bytes) -> Message | None:
        """Decode one complete frame with a valid checksum; return None if that fails."""
        try:
            return self._mav.decode(bytearray(frame))
        except mavlink.MAVError:
            return None


class Frame(NamedTuple):
    """Frame with a valid checksum."""

    number: int  # message id
    data: bytes


class Splitter:
    """Splits the received bytes of one peer into frames."""

    __slots__ = ("_buffer", "_buffered_since_s", "_late_s", "rejected")

    def __init__(self, byte_rate: float | None = None) -> None:
        """Start with an empty buffer; `byte_rate` is the rate of the line in bytes per second, None for a network."""
        self._late_s = LATE_S if byte_rate is None else max(LATE_S, 2.0 * MAX_FRAME_BYTES / byte_rate)
        self._buffer = b""  # the start of an incomplete frame
        self._buffered_since_s = 0.0
        self.rejected = 0  # frames with a wrong checksum

    def feed(self, data: bytes, now_s: float) -> list[Frame]:
        """Add bytes received at `now_s`; return the frames that they complete."""
        start_s = self._buffered_since_s if self._buffer else now_s
        available = self._buffer + data
        frames = list(self._scan(available))
        # The age counts from the start of the incomplete frame, so that later bytes do not prolong a false frame.
        if not (self._buffer and len(self._buffer) == len(available)):
            self._buffered_since_s = now_s
        elif now_s - start_s > STALE_S:
            frames = self._drop_stale_start(now_s - start_s)
            if self._buffer != available:
                self._buffered_since_s = now_s
        else:
            self._buffered_since_s = start_s
        return frames

    def _drop_stale_start(self, age_s: float) -> list[Frame]:
        """Drop the incomplete frame if a complete one follows or it is too old; return the frames after it."""
        buffer = self._buffer
        offset = _next_frame_offset(buffer)
        if offset is None and age_s <= self._late_s:
            return []
        return list(self._scan(buffer[1 if offset is None else offset :]))

    def _scan(self, data: bytes) -> Iterator[Frame]:
        """Yield the complete frames; store the incomplete frame at the end in the buffer."""
        self._buffer = b""
        end = 0  # of the latest frame
        for marker in _MARKER.finditer(data):
            start = marker.start()
            if start < end:
                continue
            size = _frame_size(data, start)
            if size == _INCOMPLETE:
                self._buffer = data[start:]
                return
            if size is None:
                continue
            frame = _check(data[start : start + size])
            if frame is None:
                self.rejected += 1
            else:
                end = start + size
                yield frame


def _next_frame_offset(data: bytes) -> int | None:
    """Return the offset of the first complete frame after the first byte; None if there is none."""
    for marker in _MARKER.finditer(data, 1):
        start = marker.start()
        size = _frame_size(data, start)
        if size and _check(data[start : start + size]) is not None:
            return start
    return None


def _frame_size(data: bytes, start: int) -> int | None:
    """Return the size of the frame that starts at a marker, _INCOMPLETE, or None at a false marker."""
    available = len(data) - start
    marker = data[start]
    header_bytes = _HEADER_BYTES[marker]
    if available < header_bytes:
        return _INCOMPLETE
    flags = data[start + 2] if marker == _MAVLINK2 else 0
    if flags & ~_SIGNED_FLAG:
        return None
    payload_bytes = data[start + 1]
    message_class = mavlink.mavlink_map.get(_message_number(data, start))
    # A MAVLink 2 frame may have extension fields newer than this dialect; MAVLink 1 has none.
    if message_class is None or (marker != _MAVLINK2 and payload_bytes > message_class.unpacker.size):
        return None
    size = header_bytes + payload_bytes + 2 + (_SIGNATURE_BYTES if flags else 0)
    return size if available >= size else _INCOMPLETE


def _message_number(data: bytes, start: int) -> int:
    if data[start] == _MAVLINK2:
        return int.from_bytes(data[start + 7 : start + 10], "little")
    return data[start + 5]


def _check(frame: bytes) -> Frame | None:
    """Return the frame with its message id; None if the checksum is wrong."""
    signature_bytes = _SIGNATURE_BYTES if frame[0] == _MAVLINK2 and frame[2] & _SIGNED_FLAG else 0
    number = _message_number(frame, 0)
    end = len(frame) - 2 - signature_bytes
    if checksum(frame[1:end], _SEEDS[number]) != int.from_bytes(frame[end : end + 2], "little"):
        return None
    return Frame(number, frame)


def to_mavlink1(packed: Packed) -> Packed | None:
    """Convert a message to MAVLink 1, without extension fields; return None if MAVLink 1 lacks the message."""
    frame = packed.frame
    number = int.from_bytes(frame[7:10], "little")
    if number > _MAX_MAVLINK1_NUMBER:
        return None
    length = _BASE_BYTES.get(number) or mavlink.mavlink_map[number].unpacker.size
    payload = frame[10:-2][:length].ljust(length, b"\0")
    return Packed(bytes((MAVLINK1, length, 0)) + frame[5:7] + bytes((number,)) + payload + b"\0\0", packed.seed)


class VersionDetector:
    """Detection of a peer that supports MAVLink 1 only: it still sends MAVLink 1 after it received MAVLink 2."""

    __slots__ = ("_first_s", "_frame_count", "is_mavlink1_only")

    def __init__(self) -> None:
        """Start with MAVLink 2."""
        self.is_mavlink1_only = False
        self._frame_count = 0  # MAVLink 1 frames since the latest MAVLink 2 frame
        self._first_s: float | None = None  # time of the first of them

    def update(self, frames: Iterable[Frame], now_s: float) -> None:
        """Evaluate received frames; the caller has sent MAVLink 2 frames to the peer before."""
        for frame in frames:
            if frame.number == _RADIO_STATUS:
                continue
            if frame.data[0] == _MAVLINK2:
                self.is_mavlink1_only, self._frame_count, self._first_s = False, 0, None
                continue
            if self._first_s is None:
                self._first_s = now_s
            self._frame_count += 1
            if self._frame_count >= _MIN_MAVLINK1_FRAMES and now_s - self._first_s >= _MIN_MAVLINK1_S:
                self.is_mavlink1_only = True
