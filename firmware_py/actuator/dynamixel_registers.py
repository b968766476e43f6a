"""The part of the Dynamixel X control table that a rudder needs, and what its values mean.

Source: Robotis e-Manual, XW540-T260. Addresses below 64 are EEPROM, which is locked while
the torque is on.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import msgspec

from firmware_py.common.angles import TWO_PI, clamp

RAM_BEGINS = 64

COUNTS_PER_TURN = 4096
CENTRE_COUNTS = 2048
LARGEST_COUNTS = 4095
RADIANS_PER_COUNT = TWO_PI / COUNTS_PER_TURN
AMPERES_PER_COUNT = 2.69e-3
VOLTS_PER_COUNT = 0.1

POSITION_MODE = 3
ANSWER_EVERYTHING = 2  # status return level
WATCHDOG_TRIPPED = -1

AT_LIMIT = "goal is at a position limit of the servo's own"
AT_LIMIT_COUNTS = 12  # a degree
HARDWARE_ERRORS = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "encoder",
    0x10: "electrical shock",
    0x20: "overload",
}
ENCODER_ERROR, OVERHEATING_ERROR = 0x08, 0x04


class Block(msgspec.Struct, frozen=True, eq=False):  # each is one of its kind: looked up by identity, many times a tick
    """A range that is read in one exchange.

    Every block has a length of its own (and a ping has 3): a status packet does not say
    what it answers, so its length tells a late one from the one awaited. The goal is asked
    for again and again, and each answer means another goal: LOOKS are the ranges by which
    it is asked for, each from a register further on before it.
    """

    name: str
    address: int
    length: int


SETTINGS = Block("settings", 8, 6)
LIMITS = Block("position limits", 48, 8)
STATE = Block("state", 64, 7)
WATCHDOG = Block("bus watchdog", 98, 1)
TELEMETRY = Block("telemetry", 126, 21)
GOAL_AND_TELEMETRY = Block("goal position and telemetry", 116, 31)
# From registers that every X has: not from 102, where those without a goal current have nothing.
LOOKS = (GOAL_AND_TELEMETRY, *(Block("goal position and more", first, 147 - first) for first in (112, 108, 104, 100)))
WHOLE = Block("state, goal position and telemetry", 64, 83)  # asked for in place of a look, where there is time for it

# Present current at 126, position at 132, voltage at 144, temperature at 146.
_TELEMETRY = struct.Struct("<h4xi8xHb")
_LIMITS = struct.Struct("<II")  # the largest position at 48, the smallest at 52

Image = Mapping[Block, bytes]


class Register(msgspec.Struct, frozen=True):
    """One value of a block."""

    name: str
    block: Block
    address: int
    size: int
    signed: bool = False

    @property
    def eeprom(self) -> bool:
        """Whether it can only be written with the torque off, and not for ever."""
        return self.address < RAM_BEGINS

    def value(self, image: Image) -> int | None:
        """Return the value last read, None when its block is not known."""
        data = image.get(self.block)
        return None if data is None else self.decoded(data)

    def decoded(self, data: bytes) -> int:
        """Return the value within the bytes of its block."""
        offset = self.address - self.block.address
        return int.from_bytes(data[offset : offset + self.size], "little", signed=self.signed)

    def encoded(self, value: int) -> bytes:
        """Return the bytes to write."""
        return value.to_bytes(self.size, "little", signed=self.signed)


RETURN_DELAY = Register("return delay", SETTINGS, 9, 1)
DRIVE_MODE = Register("drive mode", SETTINGS, 10, 1)
OPERATING_MODE = Register("operating mode", SETTINGS, 11, 1)
TORQUE_ENABLE = Register("torque enable", STATE, 64, 1)
STATUS_LEVEL = Register("status return level", STATE, 68, 1)
HARDWARE_ERROR = Register("hardware error", STATE, 70, 1)
BUS_WATCHDOG = Register("bus watchdog", WATCHDOG, 98, 1, signed=True)
GOAL_POSITION = Register("goal position", GOAL_AND_TELEMETRY, 116, 4, signed=True)


class Setting(msgspec.Struct, frozen=True):
    """What the masked bits of a register shall be; the rest stays as the owner set it.

    A servo that refuses an essential one cannot be steered; without another it can.
    """

    register: Register
    value: int
    mask: int = 0xFFFFFFFF
    essential: bool = False

    def corrected(self, present: int) -> int:
        """Return what to write over the present value; the same when it is right."""
        return (present & ~self.mask) | self.value


SETTINGS_WANTED = (
    # Torque only by the torque register (bit 3), profile velocity in speed and not in time (bit 2).
    Setting(DRIVE_MODE, 0, mask=0x0C),
    Setting(OPERATING_MODE, POSITION_MODE, essential=True),
    Setting(RETURN_DELAY, 0),
    Setting(STATUS_LEVEL, ANSWER_EVERYTHING),
)


def goal_counts(shaft_rad: float, image: Image) -> int:
    """Return the goal position of a finite shaft angle, within the limits of the servo."""
    return round(clamp(CENTRE_COUNTS + shaft_rad / RADIANS_PER_COUNT, *_limits(image)))


def _limits(image: Image) -> tuple[int, int]:
    """Return the smallest and the largest position."""
    limits = image.get(LIMITS)
    high, low = (LARGEST_COUNTS, 0) if limits is None else _LIMITS.unpack(limits)
    high = min(high, LARGEST_COUNTS)
    return (low, high) if low <= high else (0, LARGEST_COUNTS)  # those that contradict each other bind nobody


def at_limit(counts: int, image: Image) -> bool:
    """Return whether a goal position lies at a limit of the servo, as one beyond does that was moved there."""
    low, high = _limits(image)
    return not low + AT_LIMIT_COUNTS <= counts <= high - AT_LIMIT_COUNTS


class Telemetry(msgspec.Struct, frozen=True):
    """The values of the telemetry block in SI units, None where one is impossible."""

    shaft_rad: float | None
    current_a: float | None
    voltage_v: float | None
    temperature_c: float | None
    impossible: int


def part_of(data: bytes, block: Block) -> bytes:
    """Return a block within the bytes of WHOLE."""
    begin = block.address - WHOLE.address
    return data[begin : begin + block.length]


def goal_of(data: bytes) -> int:
    """Return the goal position within the bytes of any of LOOKS, or of WHOLE."""
    return GOAL_POSITION.decoded(data[-GOAL_AND_TELEMETRY.length :])


def telemetry_of(data: bytes) -> bytes:
    """Return the telemetry block within the bytes of any of LOOKS, or of WHOLE."""
    return data[-TELEMETRY.length :]


def decode_telemetry(data: bytes) -> Telemetry:
    """Return the values of a telemetry block; ranges are those of the register or the maker's hardware.

    Position: a turn and the homing offset of up to a quarter turn either side. Current:
    8 A, above the largest stall current. Voltage: 40 V, above the largest supply.
    Temperature: -40 to 125 deg C, the range of the electronics.
    """
    current, position, voltage, temperature = _TELEMETRY.unpack(data)
    near = -COUNTS_PER_TURN // 4 <= position <= COUNTS_PER_TURN * 5 // 4
    values = (
        (position - CENTRE_COUNTS) * RADIANS_PER_COUNT if near else None,
        current * AMPERES_PER_COUNT if -3000 <= current <= 3000 else None,
        voltage * VOLTS_PER_COUNT if voltage <= 400 else None,
        float(temperature) if -40 <= temperature <= 125 else None,
    )
    return Telemetry(*values, values.count(None))


def hardware_error_text(bits: int) -> str:
    """Name the hardware errors of a set of bits."""
    names = [name for bit, name in HARDWARE_ERRORS.items() if bits & bit]
    unknown = bits & ~sum(HARDWARE_ERRORS)
    return ", ".join(names + ([f"unknown 0x{unknown:02x}"] if unknown else []))
