"""Frames as they go into a message: each in its shortest form, and how much it matters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from firmware_py.link.satellite.budget import Kind
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import checksum

HEAD_BYTES = TEXT_PLACE = 10
HIGH_LATENCY2, STATUSTEXT, COMMAND_ACK = 235, 253, 77
# Payloads of MAVLink 1, which has no extension fields and a header that is four bytes shorter: HIGH_LATENCY2 then is 50
# bytes, and so one credit, where MAVLink 2 makes it 54 and two.
_MAVLINK1_BYTES: Mapping[int, int] = {HIGH_LATENCY2: 42, COMMAND_ACK: 3}
# Severity and so much of a text, that it makes one credit.
_TEXT_BYTES = 1 + 37
_CHUNK = 53  # place of the number of the part of a long text
# Of HIGH_LATENCY2, on the wire: custom_mode, failure_flags, and custom2, whose first bit says that she is armed.
_MODE, _FAILURES, _BITS = slice(12, 14), slice(22, 24), 41


def frames_of(data: bytes) -> Iterator[bytes]:
    """Return the frames of MAVLink 2 that were put together, without their signatures."""
    start = 0
    while start < len(data):
        end = start + HEAD_BYTES + data[start + 1] + 2
        yield data[start:end]
        start = end + (13 if data[start + 2] & 1 else 0)


def is_text(frame: bytes) -> bool:
    """Return whether a frame of MAVLink 2 is a text for the operator."""
    return _number(frame) == STATUSTEXT


def shortest(frame: bytes) -> bytes | None:
    """Return an unsigned frame in the form that costs least; None for what is not worth it.

    Signatures are left away: the boat's own messages would cost a credit more each.
    """
    number, payload = _number(frame), frame[HEAD_BYTES:-2]
    if is_text(frame):
        if any(payload[_CHUNK:]):
            return None  # the rest of a text whose beginning was sent
        payload = payload[:_TEXT_BYTES]
    seed = bytes((mavlink.mavlink_map[number].crc_extra,))
    size = _MAVLINK1_BYTES.get(number)
    payload = payload.rstrip(b"\0") or b"\0"
    body = bytes((len(payload), 0, 0)) + frame[4:HEAD_BYTES] + payload
    if size is not None and size + 8 <= len(payload) + 12:
        body = bytes((size, *frame[4:7], number)) + payload[:size].ljust(size, b"\0")
        return b"\xfe" + body + checksum(body, seed).to_bytes(2, "little")
    return b"\xfd" + body + checksum(body, seed).to_bytes(2, "little")


class Importance:
    """Tells reports from events: one with another mode, arming or failures than the one before is an event."""

    def __init__(self) -> None:
        """Begin with nothing sent."""
        self._state: bytes | None = None

    def kind_of(self, frame: bytes) -> Kind:
        """Return what an unsigned frame of MAVLink 2 is."""
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
