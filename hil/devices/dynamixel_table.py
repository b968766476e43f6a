"""The control table of an XW540-T260 (ROBOTIS e-Manual, XW540-T260-R), without indirect data.

Values are little endian; negative ones in two's complement.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from hil.devices.dynamixel_frame import Fault

RAM_START = 64
TABLE_END = 148
POSITION_MODE = 3  # operating mode
WATCHDOG_TRIPPED = 0xFF  # value of the bus watchdog; a host reads -1
BAUD_RATES = (9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)


class Address(IntEnum):
    """Addresses with a function in the emulator."""

    MODEL = 0
    FIRMWARE = 6
    ID = 7
    BAUD_RATE = 8
    RETURN_DELAY = 9
    DRIVE_MODE = 10
    OPERATING_MODE = 11
    HOMING_OFFSET = 20
    MOVING_THRESHOLD = 24
    TEMPERATURE_LIMIT = 31
    MAX_VOLTAGE = 32
    MIN_VOLTAGE = 34
    PWM_LIMIT = 36
    CURRENT_LIMIT = 38
    VELOCITY_LIMIT = 44
    MAX_POSITION = 48
    MIN_POSITION = 52
    SHUTDOWN = 63
    TORQUE = 64
    STATUS_RETURN_LEVEL = 68
    REGISTERED = 69
    HARDWARE_ERROR = 70
    BUS_WATCHDOG = 98
    GOAL_PWM = 100
    GOAL_CURRENT = 102
    GOAL_VELOCITY = 104
    PROFILE_ACCELERATION = 108
    PROFILE_VELOCITY = 112
    GOAL_POSITION = 116
    REALTIME_TICK = 120
    MOVING = 122
    MOVING_STATUS = 123
    PRESENT_CURRENT = 126
    PRESENT_VELOCITY = 128
    PRESENT_POSITION = 132
    PRESENT_VOLTAGE = 144
    PRESENT_TEMPERATURE = 146


@dataclass(frozen=True, slots=True)
class Register:
    """One row of the control table; `low` and `high` are the limits of a write."""

    address: int
    size: int
    writable: bool
    initial: int
    low: int = 0
    high: int = 0


# Rows: address, size, initial value, and for writable registers the limits of a write. Further addresses:
# 2 model information, 12 secondary id, 13 protocol, 60 startup configuration, 65 LED, 76 to 90 controller gains,
# 124 present PWM, 136 and 140 velocity and position trajectory, 147 backup ready.
_READ_ONLY = (
    (0, 2, 1170), (2, 4, 0), (6, 1, 45),
    (69, 1, 0), (70, 1, 0), (120, 2, 0), (122, 1, 0), (123, 1, 0), (124, 2, 0), (126, 2, 0), (128, 4, 0),
    (132, 4, 2048), (136, 4, 0), (140, 4, 0), (144, 2, 120), (146, 1, 25), (147, 1, 0),
)  # fmt: skip
_WRITABLE = (
    (7, 1, 1, 0, 252), (8, 1, 1, 0, 7), (9, 1, 250, 0, 254), (10, 1, 0, 0, 5), (11, 1, 3, 0, 16), (12, 1, 255, 0, 255),
    (13, 1, 2, 2, 2),  # protocol 1.0 is not emulated
    (20, 4, 0, -1_044_479, 1_044_479), (24, 4, 10, 0, 1023), (31, 1, 80, 0, 100), (32, 2, 160, 95, 160),
    (34, 2, 95, 95, 160), (36, 2, 885, 0, 885), (38, 2, 2047, 0, 2047), (44, 4, 167, 0, 1023), (48, 4, 4095, 0, 4095),
    (52, 4, 0, 0, 4095), (60, 1, 0, 0, 3), (63, 1, 52, 0, 0x3F),
    (64, 1, 0, 0, 1), (65, 1, 0, 0, 1), (68, 1, 2, 0, 2), (76, 2, 1920, 0, 16_383), (78, 2, 100, 0, 16_383),
    (80, 2, 0, 0, 16_383), (82, 2, 0, 0, 16_383), (84, 2, 800, 0, 16_383), (88, 2, 0, 0, 16_383), (90, 2, 0, 0, 16_383),
    (98, 1, 0, 0, 127), (100, 2, 885, -885, 885), (102, 2, 2047, -2047, 2047), (104, 4, 0, -1023, 1023),
    (108, 4, 0, 0, 32_767), (112, 4, 0, 0, 32_767), (116, 4, 2048, -1_048_575, 1_048_575),
)  # fmt: skip

REGISTERS = {row[0]: Register(row[0], row[1], False, row[2]) for row in _READ_ONLY}
REGISTERS |= {row[0]: Register(row[0], row[1], True, *row[2:]) for row in _WRITABLE}
_OPERATING_MODES = (0, 1, POSITION_MODE, 4, 5, 16)  # current, velocity, three position modes, PWM
_REGISTER_AT = {row.address + offset: row for row in REGISTERS.values() for offset in range(row.size)}


class ControlTable:
    """The values of all registers, by address."""

    def __init__(self) -> None:
        """Start with factory values."""
        self.values = {address: row.initial for address, row in REGISTERS.items()}  # read only; set items of the table
        self._image = bytearray(TABLE_END)  # the bytes of the values on the line
        for address, row in REGISTERS.items():
            self._store(address, row.initial)

    def __getitem__(self, address: int) -> int:
        """Return the value of a register, signed if it can be negative."""
        return self.values[address]

    def __setitem__(self, address: int, value: int) -> None:
        """Set a register regardless of its access; the value is truncated to its size."""
        if value != self.values[address]:
            self._store(address, value)

    def _store(self, address: int, value: int) -> None:
        size = REGISTERS[address].size
        unsigned = value & (1 << 8 * size) - 1
        signed = value < 0 and unsigned >> (8 * size - 1)
        self.values[address] = unsigned - (1 << 8 * size) if signed else unsigned
        self._image[address : address + size] = unsigned.to_bytes(size, "little")

    def reset_ram(self) -> None:
        """Reset the RAM area to its initial values, as in a restart."""
        for address, row in REGISTERS.items():
            if address >= RAM_START:
                self[address] = row.initial

    def read(self, address: int, count: int) -> bytes | None:
        """Return `count` bytes; None if none of them is defined or they are beyond the table.

        The unused bytes between registers read as zero.
        """
        span = range(address, address + count)
        if not span or span.stop > TABLE_END or _REGISTER_AT.keys().isdisjoint(span):
            return None
        return bytes(self._image[address : span.stop])

    def parse(self, address: int, data: bytes) -> list[tuple[Register, int]] | Fault:
        """Split data into complete registers and their values, or return the fault."""
        writes = []
        while data:
            row = REGISTERS.get(address)
            if row is None:
                # An address within a register is a length fault, outside of all registers an access fault.
                return Fault.LENGTH if address in _REGISTER_AT else Fault.ACCESS
            if len(data) < row.size:
                return Fault.LENGTH
            writes.append((row, int.from_bytes(data[: row.size], "little", signed=row.low < 0)))
            address, data = address + row.size, data[row.size :]
        return writes or Fault.LENGTH

    def fault_of_write(self, row: Register, value: int) -> Fault:
        """Return the fault of writing a value now, as far as the table determines it."""
        is_locked = row.address < RAM_START and self[Address.TORQUE]
        if not row.writable or is_locked:
            return Fault.ACCESS
        is_unknown_mode = row.address == Address.OPERATING_MODE and value not in _OPERATING_MODES
        if not row.low <= value <= row.high or is_unknown_mode:
            return Fault.RANGE
        low, high = self._limits(row)
        return Fault.NONE if low <= value <= high else Fault.LIMIT

    def _limits(self, row: Register) -> tuple[int, int]:
        """Return the limits of this register that other registers set."""
        if row.address == Address.GOAL_POSITION and self[Address.OPERATING_MODE] == POSITION_MODE:
            return self[Address.MIN_POSITION], self[Address.MAX_POSITION]
        limit_address = _LIMIT_REGISTERS.get(row.address)
        return (row.low, row.high) if limit_address is None else (-self[limit_address], self[limit_address])


_LIMIT_REGISTERS: dict[int, Address] = {
    Address.GOAL_PWM: Address.PWM_LIMIT,
    Address.GOAL_CURRENT: Address.CURRENT_LIMIT,
    Address.GOAL_VELOCITY: Address.VELOCITY_LIMIT,
}
