"""Registers and codes of the servos, from the documents of the manufacturers and not from the drivers."""

from enum import IntEnum

DYNAMIXEL_RAM_START = 64
FEETECH_EEPROM_BYTES = 40


class Dynamixel(IntEnum):
    """Addresses in the control table of a Dynamixel X."""

    MODEL = 0
    FIRMWARE = 6
    ID = 7
    BAUD_RATE = 8  # the first register of the settings that the driver reads
    RETURN_DELAY = 9
    DRIVE_MODE = 10
    OPERATING_MODE = 11
    MAX_POSITION = 48
    MIN_POSITION = 52
    TORQUE_ENABLE = 64  # the first register of the state that the driver reads
    STATUS_LEVEL = 68
    HARDWARE_ERROR = 70
    BUS_WATCHDOG = 98
    GOAL_POSITION = 116
    PRESENT_CURRENT = 126  # the first register of the telemetry that the driver reads
    PRESENT_POSITION = 132
    PRESENT_VOLTAGE = 144
    PRESENT_TEMPERATURE = 146


class DynamixelInstruction(IntEnum):
    """Instructions of Dynamixel protocol 2.0."""

    PING = 1
    READ = 2
    WRITE = 3
    REBOOT = 8
    SYNC_WRITE = 0x83


class DynamixelError(IntEnum):
    """Error codes of a status packet."""

    RESULT_FAIL = 1
    RANGE = 4
    ACCESS = 7


class HardwareError(IntEnum):
    """Bits of the hardware error of a Dynamixel."""

    INPUT_VOLTAGE = 0x01
    OVERHEATING = 0x04
    ENCODER = 0x08
    ELECTRICAL_SHOCK = 0x10
    OVERLOAD = 0x20


class Feetech(IntEnum):
    """Addresses in the memory table of a Feetech STS."""

    FIRMWARE = 0  # the first register of the settings that the driver reads
    BYTE_ORDER = 2
    MODEL = 3
    ID = 5
    RESPONSE_LEVEL = 8
    MIN_ANGLE = 9
    MAX_ANGLE = 11
    OPERATING_MODE = 33
    TORQUE = 40  # the first register of the state that the driver reads
    ACCELERATION = 41
    GOAL = 42
    GOAL_HIGH_BYTE = 43
    LOCK = 55
    POSITION = 56
    VOLTAGE = 62
    TEMPERATURE = 63
    STATUS = 65
    CURRENT = 69


class FeetechInstruction(IntEnum):
    """Instructions of the Feetech protocol."""

    READ = 2
    WRITE = 3


class FeetechStatus(IntEnum):
    """Bits of the status of a Feetech servo."""

    VOLTAGE = 0x01
    ENCODER = 0x02
    OVERHEATING = 0x04
    OVERLOAD = 0x20


class Volz(IntEnum):
    """Codes of requests to a Volz DA servo."""

    SET_POSITION = 0xDC
    READ_CURRENT = 0xB0
    READ_VOLTAGE = 0xB1
    READ_TEMPERATURE = 0xC0
