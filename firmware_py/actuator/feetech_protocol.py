"""Codec of the Feetech STS and SMS servos: frames and registers, without I/O and time.

Frame: FF FF | id | length | instruction, or the status in a reply | parameters | inverted sum of all bytes after the
header. Words are little-endian; bit 15 of position and current is the sign. Sources: Feetech, "Servo SCS communication
protocol" and the "Memory table" of the STS and of the SMS series.

A reply does not name its request, so each block that is read has another length. The echo of an instruction of the
driver has 2, 3 or 5 parameters, as no reply has, so that it is skipped.
"""

from __future__ import annotations

import re
import struct

import msgspec

from firmware_py.common.angles import TWO_PI

READ, WRITE = 2, 3
HEADER = b"\xff\xff"

# Addresses of registers.
FIRMWARE, BYTE_ORDER, MODEL, RESPONSE_LEVEL, ANGLE_LIMITS, OPERATING_MODE = 0, 2, 3, 8, 9, 33
TORQUE, ACCELERATION, GOAL, LOCK = 40, 41, 42, 55
# Blocks of addresses that are read in one exchange; the states end with the same registers. Their lengths differ by 3
# or more: after damage that makes a length larger by 1 or 2, the header of the next frame would give a correct sum.
SETTINGS = range(40)
STATES = tuple(range(first, 71) for first in (40, 37, 34, 28, 25))
REPLY_SIZES = (0, len(SETTINGS), *map(len, STATES))

COUNTS_PER_TURN, CENTRE_COUNTS, MAX_COUNTS = 4096, 2048, 4095
RADIANS_PER_COUNT = TWO_PI / COUNTS_PER_TURN
AMPERES_PER_COUNT, MAX_CURRENT_COUNTS = 6.5e-3, 2047
VOLTS_PER_COUNT, MIN_VOLTAGE_COUNTS = 0.1, 20
ENCODER_ERROR, OVERHEATING_ERROR = 0x02, 0x04
STATUS_BITS = {
    0x01: "voltage",
    ENCODER_ERROR: "encoder",
    OVERHEATING_ERROR: "overheating",
    0x08: "overcurrent",
    0x20: "overload",
}
_STATE = struct.Struct("<BBH11xBH4xBbxB3xH")  # addresses 40 to 70


def instruction(device_id: int, code: int, *parameters: int) -> bytes:
    """Return the frame of an instruction."""
    body = bytes((device_id, len(parameters) + 2, code, *parameters))
    return HEADER + body + bytes((~sum(body) & 0xFF,))


class Reply(msgspec.Struct, frozen=True):
    """A reply with a valid checksum."""

    status: int
    data: bytes


class ReplyParser:
    """Finds the replies of one servo in any stream of bytes; never raises.

    The sum detects any damage to one byte. It does not detect the loss of a byte that equals the first byte after the
    frame, so the driver clears the parser when it sends a request. `rejected` is the number of damaged replies.
    """

    __slots__ = ("_buffer", "_head", "rejected")

    def __init__(self, device_id: int) -> None:
        """Store the id of the servo."""
        lengths = bytes(size + 2 for size in REPLY_SIZES)
        self._head = re.compile(re.escape(HEADER + bytes((device_id,))) + b"[" + re.escape(lengths) + b"]")
        self._buffer = bytearray()
        self.rejected = 0

    @property
    def pending(self) -> int:
        """The number of bytes of an unfinished frame."""
        return len(self._buffer)

    def clear(self) -> None:
        """Discard the bytes of an unfinished frame."""
        self._buffer.clear()

    def feed(self, data: bytes) -> list[Reply]:
        """Add bytes; return the completed replies."""
        buffer = self._buffer
        buffer += data
        replies: list[Reply] = []
        start = 0
        while (head := self._head.search(buffer, start)) is not None:
            start = head.start()
            end = start + 4 + buffer[start + 3]
            if (next_head := self._head.search(buffer, start + 4, end - 1)) is not None:  # this reply is truncated
                self.rejected += 1
                start = next_head.start()
            elif end > len(buffer):
                break
            elif sum(buffer[start + 2 : end]) & 0xFF != 0xFF:
                self.rejected += 1
                start += 1
            else:
                replies.append(Reply(buffer[start + 4], bytes(buffer[start + 5 : end - 1])))
                start = end
        else:
            start = max(start, len(buffer) - 3)  # the last bytes may be the start of a header
        del buffer[:start]
        return replies


class State(msgspec.Struct, frozen=True):
    """The registers of a state block, `goal` in counts; measurements converted, None if out of range."""

    torque: int
    acceleration: int
    goal: int
    lock: int
    status: int
    shaft_rad: float | None
    current_a: float | None
    voltage_v: float | None
    temperature_c: float | None

    @property
    def invalid_values(self) -> int:
        """The number of measurements out of range."""
        return (self.shaft_rad, self.current_a, self.voltage_v, self.temperature_c).count(None)


def decode_state(data: bytes) -> State:
    """Return the registers at the end of a state block.

    Ranges: one turn and a quarter turn on either side, the current of the register, 2 V, below which no servo replies,
    and -40 to 125 deg C, the range of the electronics.
    """
    torque, acceleration, goal, lock, *measured = _STATE.unpack(data[-_STATE.size :])
    position, voltage, temperature, status, current = measured
    counts, current_counts = _signed(position), _signed(current)
    is_position = -COUNTS_PER_TURN // 4 <= counts <= COUNTS_PER_TURN * 5 // 4
    return State(
        *(torque, acceleration, goal, lock, status),
        (counts - CENTRE_COUNTS) * RADIANS_PER_COUNT if is_position else None,
        current_counts * AMPERES_PER_COUNT if abs(current_counts) <= MAX_CURRENT_COUNTS else None,
        voltage * VOLTS_PER_COUNT if voltage >= MIN_VOLTAGE_COUNTS else None,
        float(temperature) if -40 <= temperature <= 125 else None,
    )


def angle_limits(settings: bytes | None) -> tuple[int, int]:
    """Return the minimum and maximum angle of a settings block in counts; one turn for none or contradictory ones."""
    low, high = (0, MAX_COUNTS) if settings is None else struct.unpack_from("<HH", settings, ANGLE_LIMITS)
    return (low, high) if low < high <= MAX_COUNTS else (0, MAX_COUNTS)


def status_text(bits: int) -> str:
    """Return the names of the errors in a status byte."""
    unknown = bits & ~sum(STATUS_BITS)
    names = [name for bit, name in STATUS_BITS.items() if bits & bit]
    return ", ".join(names + ([f"unknown 0x{unknown:02x}"] if unknown else []))


def _signed(word: int) -> int:
    """Return a word whose bit 15 is the sign of its magnitude."""
    return -(word & 0x7FFF) if word & 0x8000 else word
