"""MAVLink frames in satellite messages: shortest form, authenticated short form of commands, and queue."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from hmac import compare_digest

import msgspec
from msgspec.structs import replace

from firmware_py.link.satellite.modem import MAX_SENT_BYTES
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import checksum


class Kind(IntEnum):
    """Priority of messages."""

    EVENT = 0  # faults and mode changes
    REPORT = 1  # HIGH_LATENCY2 without a change
    ANSWER = 2  # acknowledgements and all other messages
    MAILBOX = 3  # an empty message, which checks for received messages


HEADER_BYTES = TEXT_OFFSET = 10  # of a MAVLink 2 frame; severity and text of a STATUSTEXT follow
HIGH_LATENCY2, STATUSTEXT, COMMAND_ACK = 235, 253, 77
# Payload sizes of the messages that are sent as MAVLink 1, whose header is four bytes shorter: HIGH_LATENCY2 takes 50
# bytes and one credit, as MAVLink 2 it would take 54 bytes and two credits.
_MAVLINK1_BYTES: Mapping[int, int] = {HIGH_LATENCY2: 42, COMMAND_ACK: 3}
_MAX_TEXT_PAYLOAD_BYTES = 1 + 37  # severity, and the start of a text that fits into one credit
_CHUNK_NUMBER_OFFSET = 53  # of STATUSTEXT
# Of HIGH_LATENCY2: custom_mode, failure_flags, and custom2, whose first bit means armed.
_MODE, _FAILURES, _CUSTOM2_OFFSET = slice(12, 14), slice(22, 24), 41

# The short form, see AuthenticatedFrame.
SHORT_FORM_MARK = 0xB5
HMAC_BYTES = 8
MAX_STORED_NUMBERS = 128
NUMBERS_HZ = 100.0  # numbers per second
EPOCH_S = 1_420_070_400  # 2015-01-01 UTC
_HMAC_CONTEXT = b"sbd short form 1"
_NUMBER = slice(1, 6)
_SHORT_HEADER_BYTES = 10

_MAX_QUEUED: Mapping[Kind, int] = {Kind.EVENT: 16, Kind.REPORT: 24, Kind.ANSWER: 16}


def split_batch(data: bytes) -> Iterator[bytes]:
    """Yield the MAVLink 2 frames of a batch, without their signatures."""
    start = 0
    while start < len(data):
        end = start + HEADER_BYTES + data[start + 1] + 2
        yield data[start:end]
        start = end + (13 if data[start + 2] & 1 else 0)  # incompatibility flag 1: a signature follows


def is_text(frame: bytes) -> bool:
    """Return whether a MAVLink 2 frame is a STATUSTEXT."""
    return _message_number(frame) == STATUSTEXT


def shorten(frame: bytes) -> bytes | None:
    """Convert an unsigned MAVLink 2 frame to its shortest form; None for a frame that is not sent by satellite.

    Messages of the boat are not signed, since each signature would cost one more credit.
    """
    number, payload = _message_number(frame), frame[HEADER_BYTES:-2]
    if is_text(frame):
        if any(payload[_CHUNK_NUMBER_OFFSET:]):
            return None  # only the first chunk of a text is sent
        payload = payload[:_MAX_TEXT_PAYLOAD_BYTES]
    seed = bytes((mavlink.mavlink_map[number].crc_extra,))
    size = _MAVLINK1_BYTES.get(number)
    payload = payload.rstrip(b"\0") or b"\0"
    body = bytes((len(payload), 0, 0)) + frame[4:HEADER_BYTES] + payload
    # A frame has 8 bytes besides the payload in MAVLink 1, 12 in MAVLink 2.
    if size is not None and size + 8 <= len(payload) + 12:
        body = bytes((size, *frame[4:7], number)) + payload[:size].ljust(size, b"\0")
        return b"\xfe" + body + checksum(body, seed).to_bytes(2, "little")
    return b"\xfd" + body + checksum(body, seed).to_bytes(2, "little")


class FrameClassifier:
    """Determines the priority of frames. A report with a change of mode, arming or failures is an event."""

    def __init__(self) -> None:
        """Start without a report."""
        self._state: bytes | None = None

    def kind_of(self, frame: bytes) -> Kind:
        """Return the priority of an unsigned MAVLink 2 frame."""
        if is_text(frame):
            return Kind.EVENT
        if _message_number(frame) != HIGH_LATENCY2:
            return Kind.ANSWER
        payload = frame[HEADER_BYTES:-2].ljust(42, b"\0")
        is_armed = bytes((payload[_CUSTOM2_OFFSET] & 1,))
        previous, self._state = self._state, payload[_MODE] + payload[_FAILURES] + is_armed
        return Kind.REPORT if previous in (None, self._state) else Kind.EVENT


def _message_number(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


class AuthenticatedFrame(msgspec.Struct, frozen=True):
    """Frame received in the short form with a valid HMAC, as MAVLink 2, and its number.

    The short form (docs/reference/satellite-messages.md): mark 0xB5, number (5 bytes), system, component, message id (2
    bytes), payload without trailing zeros, HMAC (8 bytes), little-endian. The number is the time of writing in
    hundredths of a second since 2015, or the previous number plus 1. The HMAC is the start of the HMAC-SHA256 with the
    boat's key over the text `sbd short form 1`, the IMEI of the modem and the message before the HMAC. A number is
    accepted once; the order of the numbers is arbitrary.
    """

    number: int
    frame: bytes

    def age_s(self, utc_s: float) -> float:
        """Return the age of the message in seconds; negative for a time in the future."""
        return utc_s - EPOCH_S - self.number / NUMBERS_HZ


def open_short_form(
    message: bytes, imei: str, compute_hmac: Callable[[bytes], bytes | None]
) -> AuthenticatedFrame | str:
    """Authenticate a message in the short form; return its frame, or the reason of a refusal.

    `compute_hmac` returns the HMAC with the boat's key, or None without a key.
    """
    if len(message) < _SHORT_HEADER_BYTES + HMAC_BYTES:
        return "cut short"
    covered, received_hmac = message[:-HMAC_BYTES], message[-HMAC_BYTES:]
    expected_hmac = compute_hmac(_HMAC_CONTEXT + imei.encode() + covered)
    if expected_hmac is None:
        return "there is no key"
    if not compare_digest(expected_hmac[:HMAC_BYTES], received_hmac):
        return "false code"
    system, component, payload = covered[6], covered[7], covered[_SHORT_HEADER_BYTES:] or b"\0"
    message_number = int.from_bytes(covered[8:10], "little")
    message_class = mavlink.mavlink_map.get(message_number)
    if message_class is None or len(payload) > message_class.unpacker.size:
        return "unknown message"
    body = bytes((len(payload), 0, 0, 0, system, component)) + message_number.to_bytes(3, "little") + payload
    frame = b"\xfd" + body + checksum(body, bytes((message_class.crc_extra,))).to_bytes(2, "little")
    return AuthenticatedFrame(int.from_bytes(covered[_NUMBER], "little"), frame)


class Window(msgspec.Struct, frozen=True):
    """The latest used numbers of the short form in ascending order. Numbers up to `floor` count as used."""

    floor: int = 0
    used: tuple[int, ...] = ()

    def admits(self, number: int) -> bool:
        """Return whether a number is not used yet."""
        return number > self.floor and number not in self.used

    def with_number(self, number: int) -> Window:
        """Return the window with an additional used number."""
        index = bisect_left(self.used, number)
        used = (*self.used[:index], number, *self.used[index:])
        if len(used) <= MAX_STORED_NUMBERS:
            return replace(self, used=used)
        return Window(max(self.floor, used[0]), used[1:])


class Bundle(msgspec.Struct, frozen=True):
    """Frames with their priorities that are sent in one satellite message."""

    frames: tuple[tuple[Kind, bytes], ...] = ()

    @property
    def content(self) -> bytes:
        """The bytes of the satellite message."""
        return b"".join(frame for _, frame in self.frames)


class MessageQueue:
    """Bounded queues of frames by priority. A frame remains queued until `remove`.

    `dropped` counts the frames that were not queued or that a newer report has replaced.

    If the queue of reports is full, a new report replaces the oldest one, since the latest position is the most useful.
    """

    def __init__(self) -> None:
        """Start without frames."""
        self._queues: Mapping[Kind, deque[bytes]] = {kind: deque() for kind in _MAX_QUEUED}
        self.dropped: dict[Kind, int] = dict.fromkeys(_MAX_QUEUED, 0)

    def __len__(self) -> int:
        """Return the number of queued frames."""
        return sum(len(queue) for queue in self._queues.values())

    def offer(self, kind: Kind, frame: bytes) -> None:
        """Queue a frame; if the queue is full, drop this frame or the oldest report, and count it."""
        queue = self._queues[kind]
        if len(queue) >= _MAX_QUEUED[kind]:
            self.dropped[kind] += 1
            if kind is not Kind.REPORT:
                return
            queue.popleft()
        queue.append(frame)

    def compose(self, fits: Callable[[Kind, int], bool]) -> Bundle:
        """Compose the next message: events, then the newest reports, then answers.

        `fits` decides for each frame from its priority and the size of the message in bytes, including the frame.
        """
        frames: list[tuple[Kind, bytes]] = []
        size = 0
        for kind, frame in self._frames_by_priority():
            new_size = size + len(frame)
            if new_size <= MAX_SENT_BYTES and fits(kind, new_size):
                frames.append((kind, frame))
                size = new_size
        return Bundle(tuple(frames))

    def _frames_by_priority(self) -> Iterator[tuple[Kind, bytes]]:
        for kind, queue in self._queues.items():
            for frame in reversed(queue) if kind is Kind.REPORT else queue:
                yield kind, frame

    def remove(self, bundle: Bundle) -> None:
        """Remove the sent frames. A newer report may already have replaced one of them."""
        for kind, frame in bundle.frames:
            if frame in self._queues[kind]:
                self._queues[kind].remove(frame)
