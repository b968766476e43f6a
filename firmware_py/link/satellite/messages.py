"""Frames in messages by satellite: their shortest form, the keyed form of commands, and the queue."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from hmac import compare_digest

import msgspec
from msgspec.structs import replace

from firmware_py.link.satellite.modem import LONGEST_OUT
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import checksum


class Kind(IntEnum):
    """Priority of messages."""

    EVENT = 0  # faults and mode changes
    REPORT = 1
    ANSWER = 2
    MAILBOX = 3  # nothing is sent: a check for messages ashore


HEAD_BYTES = TEXT_PLACE = 10
HIGH_LATENCY2, STATUSTEXT, COMMAND_ACK = 235, 253, 77
# Payloads sent as MAVLink 1, whose header is four bytes shorter: HIGH_LATENCY2 takes 50 bytes and one credit, as
# MAVLink 2 it would take 54 bytes and two credits.
_MAVLINK1_BYTES: Mapping[int, int] = {HIGH_LATENCY2: 42, COMMAND_ACK: 3}
# Severity and the part of a text that fits into one credit.
_TEXT_BYTES = 1 + 37
_CHUNK = 53  # offset of the chunk number of a long text
# Offsets in HIGH_LATENCY2: custom_mode, failure_flags, and custom2, whose first bit is set while armed.
_MODE, _FAILURES, _BITS = slice(12, 14), slice(22, 24), 41

MARK = 0xB5
CODE_BYTES = 8
KEPT_NUMBERS = 128
UNITS_HZ = 100.0
EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
_CONTEXT = b"sbd short form 1"
_NUMBER = slice(1, 6)
_HEAD_BYTES = 10

_DEPTHS: Mapping[Kind, int] = {Kind.EVENT: 16, Kind.REPORT: 24, Kind.ANSWER: 16}


def frames_of(data: bytes) -> Iterator[bytes]:
    """Yield the MAVLink 2 frames of a batch, without their signatures."""
    start = 0
    while start < len(data):
        end = start + HEAD_BYTES + data[start + 1] + 2
        yield data[start:end]
        start = end + (13 if data[start + 2] & 1 else 0)


def is_text(frame: bytes) -> bool:
    """Return whether a frame of MAVLink 2 is a text for the operator."""
    return _number(frame) == STATUSTEXT


def shortest(frame: bytes) -> bytes | None:
    """Return an unsigned frame in its cheapest form; None for one that is not sent by satellite.

    Messages of the boat are sent unsigned, since a signature would cost one more credit each.
    """
    number, payload = _number(frame), frame[HEAD_BYTES:-2]
    if is_text(frame):
        if any(payload[_CHUNK:]):
            return None  # a later chunk of a text whose first chunk was sent
        payload = payload[:_TEXT_BYTES]
    seed = bytes((mavlink.mavlink_map[number].crc_extra,))
    size = _MAVLINK1_BYTES.get(number)
    payload = payload.rstrip(b"\0") or b"\0"
    body = bytes((len(payload), 0, 0)) + frame[4:HEAD_BYTES] + payload
    if size is not None and size + 8 <= len(payload) + 12:
        body = bytes((size, *frame[4:7], number)) + payload[:size].ljust(size, b"\0")
        return b"\xfe" + body + checksum(body, seed).to_bytes(2, "little")
    return b"\xfd" + body + checksum(body, seed).to_bytes(2, "little")


class FrameClassifier:
    """Classifies frames: a report with a change of mode, arming or failures is an event."""

    def __init__(self) -> None:
        """Start without a report."""
        self._state: bytes | None = None

    def kind_of(self, frame: bytes) -> Kind:
        """Return the priority of an unsigned MAVLink 2 frame."""
        number = _number(frame)
        if is_text(frame):
            return Kind.EVENT
        if number != HIGH_LATENCY2:
            return Kind.ANSWER
        payload = frame[HEAD_BYTES:-2].ljust(42, b"\0")
        before, self._state = self._state, payload[_MODE] + payload[_FAILURES] + bytes((payload[_BITS] & 1,))
        return Kind.REPORT if before in (None, self._state) else Kind.EVENT


def _number(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


class Keyed(msgspec.Struct, frozen=True):
    """A frame in the short form with a valid code; `frame` is the same as MAVLink 2.

    The short form (docs/reference/satellite-messages.md): mark 0xB5, number (5 bytes), system, component, message id (2
    bytes), payload without its last zeros, code (8 bytes), little-endian. The number is the time of writing in
    hundredths of a second since 2015, or the last one plus 1. The code is the start of the HMAC-SHA256 by the boat's
    key over the text `sbd short form 1`, the modem's IMEI and the message before the code. A number counts once, in any
    order.
    """

    number: int
    frame: bytes

    def age_s(self, utc_s: float) -> float:
        """Return the age of the message in seconds."""
        return utc_s - EPOCH_S - self.number / UNITS_HZ


def open_keyed(message: bytes, imei: str, code: Callable[[bytes], bytes | None]) -> Keyed | str:
    """Return the frame of a message in the short form, or the reason of a refusal; `code` returns an HMAC or None."""
    if len(message) < _HEAD_BYTES + CODE_BYTES:
        return "cut short"
    covered, received_code = message[:-CODE_BYTES], message[-CODE_BYTES:]
    right = code(_CONTEXT + imei.encode() + covered)
    if right is None:
        return "there is no key"
    if not compare_digest(right[:CODE_BYTES], received_code):
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
    """The latest used numbers, in order; numbers up to `floor` are refused."""

    floor: int = 0
    used: tuple[int, ...] = ()

    def admits(self, number: int) -> bool:
        """Return whether a number is not used yet."""
        return number > self.floor and number not in self.used

    def with_number(self, number: int) -> Window:
        """Return the window with one more used number."""
        place = bisect_left(self.used, number)
        used = (*self.used[:place], number, *self.used[place:])
        if len(used) <= KEPT_NUMBERS:
            return replace(self, used=used)
        return Window(max(self.floor, used[0]), used[1:])


class Bundle(msgspec.Struct, frozen=True):
    """Frames of one message."""

    frames: tuple[tuple[Kind, bytes], ...] = ()

    @property
    def content(self) -> bytes:
        """The message."""
        return b"".join(frame for _, frame in self.frames)


class MessageQueue:
    """Queued frames by priority, bounded; frames leave by `remove`, or are counted in `dropped`.

    A report that finds the queue full replaces the oldest one, since the latest position is the most useful.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._queues: Mapping[Kind, deque[bytes]] = {kind: deque() for kind in _DEPTHS}
        self.dropped: dict[Kind, int] = dict.fromkeys(_DEPTHS, 0)

    def __len__(self) -> int:
        """Return the number of queued frames."""
        return sum(len(queue) for queue in self._queues.values())

    def offer(self, kind: Kind, frame: bytes) -> None:
        """Queue a frame, or drop one and count it."""
        queue = self._queues[kind]
        if len(queue) >= _DEPTHS[kind]:
            self.dropped[kind] += 1
            if kind is not Kind.REPORT:
                return
            queue.popleft()
        queue.append(frame)

    def compose(self, fits: Callable[[Kind, int], bool]) -> Bundle:
        """Return the next message: events, then the newest reports, then answers, as far as `fits` allows.

        `fits` takes the priority of the last frame and the bytes of the whole message.
        """
        frames: list[tuple[Kind, bytes]] = []
        size = 0
        for kind, frame in self._in_order():
            longer = size + len(frame)
            if longer <= LONGEST_OUT and fits(kind, longer):
                frames.append((kind, frame))
                size = longer
        return Bundle(tuple(frames))

    def _in_order(self) -> Iterator[tuple[Kind, bytes]]:
        for kind, queue in self._queues.items():
            for frame in reversed(queue) if kind is Kind.REPORT else queue:
                yield kind, frame

    def remove(self, bundle: Bundle) -> None:
        """Remove the frames that were sent; a report may have been replaced meanwhile."""
        for kind, frame in bundle.frames:
            if frame in self._queues[kind]:
                self._queues[kind].remove(frame)
