"""The part of the Dynamixel X control table that the driver uses.

Source: Robotis e-Manual, XW540-T260. Addresses below 64 are EEPROM, which is locked while the torque is on.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

import msgspec

from firmware_py.common.angles import TWO_PI, clamp

RAM_START = 64

COUNTS_PER_TURN = 4096
CENTRE_COUNTS = 2048
MAX_COUNTS = 4095
RADIANS_PER_COUNT = TWO_PI / COUNTS_PER_TURN
AMPERES_PER_COUNT = 2.69e-3
VOLTS_PER_COUNT = 0.1

POSITION_MODE = 3
REPLY_TO_ALL = 2  # status return level
WATCHDOG_TRIPPED = -1

AT_LIMIT_TEXT = "goal at a position limit of the servo"
AT_LIMIT_COUNTS = 12  # 1 degree
HARDWARE_ERRORS = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "encoder",
    0x10: "electrical shock",
    0x20: "overload",
}
ENCODER_ERROR, OVERHEATING_ERROR = 0x08, 0x04


class Block(msgspec.Struct, frozen=True, eq=False):  # compared by identity, which is faster
    """A range that is read in one exchange.

    Every block has a different length (and a ping has 3): a status packet does not name its request, so its length
    distinguishes a late reply from the expected one. A reply with the goal position is compared with the goal of its
    own request, so GOAL_READS are ranges of different lengths that contain it.
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
# From profile velocity (112), profile acceleration (108), goal velocity (104) and goal PWM (100) on, which every X has;
# not from goal current (102), which some X do not have.
GOAL_READS = (
    GOAL_AND_TELEMETRY,
    *(Block("goal position and more", first, 147 - first) for first in (112, 108, 104, 100)),
)
COMBINED = Block("state, goal position and telemetry", 64, 83)

# Present current at 126, position at 132, voltage at 144, temperature at 146.
_TELEMETRY = struct.Struct("<h4xi8xHb")
_LIMITS = struct.Struct("<II")  # maximum position at 48, minimum at 52

Image = Mapping[Block, bytes]


class Register(msgspec.Struct, frozen=True):
    """One value of a block."""

    name: str
    block: Block
    address: int
    size: int
    is_signed: bool = False

    @property
    def is_eeprom(self) -> bool:
        """Whether it can only be written with the torque off, and wears."""
        return self.address < RAM_START

    def value(self, image: Image) -> int | None:
        """Return the last value read, None if its block is not known."""
        data = image.get(self.block)
        return None if data is None else self.decode(data)

    def decode(self, data: bytes) -> int:
        """Return the value within the bytes of its block."""
        offset = self.address - self.block.address
        return int.from_bytes(data[offset : offset + self.size], "little", signed=self.is_signed)

    def encode(self, value: int) -> bytes:
        """Return the bytes to write."""
        return value.to_bytes(self.size, "little", signed=self.is_signed)


RETURN_DELAY = Register("return delay", SETTINGS, 9, 1)
DRIVE_MODE = Register("drive mode", SETTINGS, 10, 1)
OPERATING_MODE = Register("operating mode", SETTINGS, 11, 1)
TORQUE_ENABLE = Register("torque enable", STATE, 64, 1)
STATUS_LEVEL = Register("status return level", STATE, 68, 1)
HARDWARE_ERROR = Register("hardware error", STATE, 70, 1)
BUS_WATCHDOG = Register("bus watchdog", WATCHDOG, 98, 1, is_signed=True)
GOAL_POSITION = Register("goal position", GOAL_AND_TELEMETRY, 116, 4, is_signed=True)


class Setting(msgspec.Struct, frozen=True):
    """The required value of the masked bits of a register; other bits are not changed.

    The servo can be used only if the essential settings are correct.
    """

    register: Register
    value: int
    mask: int = 0xFFFFFFFF
    is_essential: bool = False

    def corrected_value(self, present: int) -> int:
        """Return the value to write; the present one if it is correct."""
        return (present & ~self.mask) | self.value


REQUIRED_SETTINGS = (
    # Torque only by the torque register (bit 3); profile velocity as speed, not time (bit 2).
    Setting(DRIVE_MODE, 0, mask=0x0C),
    Setting(OPERATING_MODE, POSITION_MODE, is_essential=True),
    Setting(RETURN_DELAY, 0),
    Setting(STATUS_LEVEL, REPLY_TO_ALL),
)


def goal_counts(shaft_rad: float, image: Image) -> int:
    """Return the goal position of a finite shaft angle, within the limits of the servo."""
    return round(clamp(CENTRE_COUNTS + shaft_rad / RADIANS_PER_COUNT, *_position_limits(image)))


def _position_limits(image: Image) -> tuple[int, int]:
    """Return the minimum and maximum position."""
    limits = image.get(LIMITS)
    high, low = (MAX_COUNTS, 0) if limits is None else _LIMITS.unpack(limits)
    high = min(high, MAX_COUNTS)
    return (low, high) if low <= high else (0, MAX_COUNTS)  # contradictory limits are ignored


def is_at_limit(counts: int, image: Image) -> bool:
    """Return whether a goal position is at a limit of the servo, also because it was limited."""
    low, high = _position_limits(image)
    return not low + AT_LIMIT_COUNTS <= counts <= high - AT_LIMIT_COUNTS


class Telemetry(msgspec.Struct, frozen=True):
    """The values of the telemetry block in SI units, None for values out of range."""

    shaft_rad: float | None
    current_a: float | None
    voltage_v: float | None
    temperature_c: float | None
    invalid_values: int


def extract_block(data: bytes, block: Block) -> bytes:
    """Return a block within the bytes of COMBINED."""
    begin = block.address - COMBINED.address
    return data[begin : begin + block.length]


def extract_goal(data: bytes) -> int:
    """Return the goal position within the bytes of any of GOAL_READS, or of COMBINED."""
    return GOAL_POSITION.decode(data[-GOAL_AND_TELEMETRY.length :])


def extract_telemetry(data: bytes) -> bytes:
    """Return the telemetry block within the bytes of any of GOAL_READS, or of COMBINED."""
    return data[-TELEMETRY.length :]


def decode_telemetry(data: bytes) -> Telemetry:
    """Return the values of a telemetry block, checked against the ranges of the register or the hardware.

    Position: one turn and the homing offset of up to a quarter turn on either side. Current: 8 A, above the maximum
    stall current. Voltage: 40 V, above the maximum supply. Temperature: -40 to 125 deg C, the range of the electronics.
    """
    current, position, voltage, temperature = _TELEMETRY.unpack(data)
    is_valid = -COUNTS_PER_TURN // 4 <= position <= COUNTS_PER_TURN * 5 // 4
    values = (
        (position - CENTRE_COUNTS) * RADIANS_PER_COUNT if is_valid else None,
        current * AMPERES_PER_COUNT if -3000 <= current <= 3000 else None,
        voltage * VOLTS_PER_COUNT if voltage <= 400 else None,
        float(temperature) if -40 <= temperature <= 125 else None,
    )
    return Telemetry(*values, values.count(None))


def hardware_error_text(bits: int) -> str:
    """Return the names of the hardware errors in a bit mask."""
    names = [name for bit, name in HARDWARE_ERRORS.items() if bits & bit]
    unknown = bits & ~sum(HARDWARE_ERRORS)
    return ", ".join(names + ([f"unknown 0x{unknown:02x}"] if unknown else []))
