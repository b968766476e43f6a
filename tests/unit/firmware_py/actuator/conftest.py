"""Simulated servos, written from the documents of the manufacturers and not from the drivers, and a rig for drivers."""

import math
import struct
from types import SimpleNamespace

import pytest

from firmware_py.common.records import RudderCommand
from support.line import FakeLine, LateLine
from support.servo_registers import (
    DYNAMIXEL_RAM_START,
    FEETECH_EEPROM_BYTES,
    Dynamixel,
    DynamixelError,
    DynamixelInstruction,
    Feetech,
    FeetechInstruction,
    Volz,
)

# Codes of replies by those of requests.
VOLZ_REPLIES = {Volz.SET_POSITION: 0x2C, Volz.READ_CURRENT: 0x30, Volz.READ_VOLTAGE: 0x31, Volz.READ_TEMPERATURE: 0x10}
INSTRUCTION_HEADER = bytes.fromhex("FFFFFD00")
BROADCAST_ID = 0xFE


def crc16(data, initial):
    """CRC-16, polynomial 0x8005, not reflected, bit by bit."""
    crc = initial
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def dynamixel_frame(device_id, body):
    """Frame a body with byte stuffing as in the description of the protocol."""
    stuffed = bytearray()
    for byte in body:
        stuffed.append(byte)
        if stuffed[-3:] == b"\xff\xff\xfd":
            stuffed.append(0xFD)
    head = INSTRUCTION_HEADER + bytes((device_id,)) + struct.pack("<H", len(stuffed) + 2) + bytes(stuffed)
    return head + struct.pack("<H", crc16(head, 0))


def status_frame(device_id, error, parameters=b""):
    return dynamixel_frame(device_id, bytes((0x55, error)) + parameters)


def volz_frame(code, device_id, first, second):
    head = bytes((code, device_id, first, second))
    return head + struct.pack(">H", crc16(head, 0xFFFF))


def feetech_frame(device_id, status, data=b""):
    body = bytes((device_id, len(data) + 2, status)) + data
    return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))


class FakeDynamixel:
    """An XW540 that replies at once, with the registers that the driver uses."""

    def __init__(self, device_id=1):
        self.device_id = device_id
        self.powered = True
        self.registers = bytearray(256)
        self.put(Dynamixel.MODEL, 1170, 2)
        self.registers[Dynamixel.FIRMWARE] = 47
        self.registers[Dynamixel.ID] = device_id
        self.registers[Dynamixel.RETURN_DELAY] = 250
        self.registers[Dynamixel.OPERATING_MODE] = 3
        self.put(Dynamixel.MAX_POSITION, 4095, 4)
        self.put(Dynamixel.MIN_POSITION, 0, 4)
        self.position = 2048
        self.write_errors = {}  # error codes of reads and writes by address
        self.ignored_addresses = set()  # addresses whose writes have a reply but no effect
        self.eeprom_writes = []  # address, value, torque
        self.ram_writes = []  # address, value
        self.reads = []
        self.reboots = 0
        self.max_read = 255
        self.read_error = DynamixelError.RANGE  # of the reply to a longer read, None for no reply
        self.lost_replies = []  # addresses of writes whose reply is lost, once each
        self.restart()

    def put(self, address, value, size):
        self.registers[address : address + size] = value.to_bytes(size, "little")

    def get(self, address, size):
        return int.from_bytes(self.registers[address : address + size], "little")

    def restart(self):
        """Reset the RAM as at power-up."""
        self.registers[DYNAMIXEL_RAM_START:147] = bytes(83)
        self.registers[Dynamixel.STATUS_LEVEL] = 2
        self.put(Dynamixel.GOAL_POSITION, self.position, 4)
        self.put(Dynamixel.PRESENT_VOLTAGE, 121, 2)
        self.registers[Dynamixel.PRESENT_TEMPERATURE] = 31
        self.put(Dynamixel.PRESENT_CURRENT, 0xFFF6, 2)  # -10 counts

    def shut_down(self, error):
        self.registers[Dynamixel.HARDWARE_ERROR] |= error
        self.registers[Dynamixel.TORQUE_ENABLE] = 0

    def trip_watchdog(self):
        self.registers[Dynamixel.BUS_WATCHDOG] = 0xFF

    @property
    def goal(self):
        return self.get(Dynamixel.GOAL_POSITION, 4)

    def handle(self, data):
        """Execute the frames of one write in order; return the replies."""
        replies = b""
        while data:
            end = 7 + struct.unpack("<H", data[5:7])[0]
            replies += self.handle_frame(data[:end])
            data = data[end:]
        return replies

    def handle_frame(self, frame):
        assert frame[:4] == INSTRUCTION_HEADER, frame.hex()
        assert struct.unpack("<H", frame[-2:])[0] == crc16(frame[:-2], 0)
        assert struct.unpack("<H", frame[5:7])[0] == len(frame) - 7
        if self.powered and frame[4] == BROADCAST_ID and frame[7] == DynamixelInstruction.SYNC_WRITE:
            address, length = struct.unpack("<HH", frame[8:12])
            assert len(frame) == 12 + 1 + length + 2
            if frame[12] == self.device_id:
                self.store(address, frame[13:-2])
            return b""
        if not self.powered or frame[4] != self.device_id:
            return b""
        error, parameters = self.execute(frame[7], frame[8:-2])
        if error is None:
            return b""
        if frame[7] == DynamixelInstruction.WRITE and frame[8] in self.lost_replies:
            self.lost_replies.remove(frame[8])
            return b""
        alert = 0x80 if self.registers[Dynamixel.HARDWARE_ERROR] else 0
        return status_frame(self.device_id, error | alert, parameters)

    def execute(self, instruction, parameters):
        if instruction == DynamixelInstruction.PING:
            return 0, bytes(
                (*self.registers[Dynamixel.MODEL : Dynamixel.MODEL + 2], self.registers[Dynamixel.FIRMWARE])
            )
        if instruction == DynamixelInstruction.READ:
            address, length = struct.unpack("<HH", parameters)
            self.reads.append(address)
            if address in self.write_errors:
                return self.write_errors[address], b""
            if length > self.max_read:
                return self.read_error, b""
            self.put(Dynamixel.PRESENT_POSITION, self.position, 4)
            return 0, bytes(self.registers[address : address + length])
        if instruction == DynamixelInstruction.REBOOT:
            self.reboots += 1
            self.restart()
            return 0, b""
        assert instruction == DynamixelInstruction.WRITE, instruction
        return self.store(struct.unpack("<H", parameters[:2])[0], parameters[2:]), b""

    def store(self, address, data):
        value = int.from_bytes(data, "little")
        torque = self.registers[Dynamixel.TORQUE_ENABLE]
        if address < DYNAMIXEL_RAM_START:
            self.eeprom_writes.append((address, value, torque))
            if torque:
                return DynamixelError.ACCESS
        else:
            self.ram_writes.append((address, value))
        if address in self.write_errors:
            return self.write_errors[address]
        if address in self.ignored_addresses:
            return 0
        if address == Dynamixel.GOAL_POSITION:
            low, high = self.get(Dynamixel.MIN_POSITION, 4), self.get(Dynamixel.MAX_POSITION, 4)
            if self.registers[Dynamixel.BUS_WATCHDOG] == 0xFF or not low <= value <= high:
                return DynamixelError.RANGE
            if torque:
                self.position = value
        if address == Dynamixel.TORQUE_ENABLE and value and self.registers[Dynamixel.HARDWARE_ERROR]:
            return DynamixelError.RESULT_FAIL
        self.registers[address : address + len(data)] = data
        return 0


class FakeVolz:
    """A DA 26 that replies at once; `values` contains the two arguments of the replies to readings."""

    def __init__(self, device_id=1):
        self.device_id = device_id
        self.powered = True
        self.values = {Volz.READ_CURRENT: (30, 0), Volz.READ_VOLTAGE: (140, 0), Volz.READ_TEMPERATURE: (75, 81)}
        self.position = 0x0800
        self.requests = []

    def handle(self, frame):
        assert len(frame) == 6
        assert frame == volz_frame(*frame[:4])
        if not self.powered or frame[1] != self.device_id:
            return b""
        self.requests.append(frame[0])
        if frame[0] == Volz.SET_POSITION:
            self.position = frame[2] << 8 | frame[3]
            first, second = frame[2], frame[3]
        else:
            first, second = self.values[frame[0]]
        return volz_frame(VOLZ_REPLIES[frame[0]], self.device_id, first, second)


class FakeFeetech:
    """An STS3215 that replies at once, with the registers that the driver uses."""

    def __init__(self, device_id=1):
        self.device_id = device_id
        self.powered = True
        self.stored = bytearray(FEETECH_EEPROM_BYTES)  # the EEPROM area
        self.stored[:9] = bytes((3, 10, 0, 9, 3, device_id, 0, 0, 1))
        self.stored[Feetech.MAX_ANGLE : Feetech.MAX_ANGLE + 2] = b"\xff\x0f"
        self.registers = bytearray(71)
        self.position = 2048
        self.status = 0
        self.ignored_addresses = set()  # addresses whose writes have no effect
        self.writes = []  # address, bytes, torque
        self.reads = []
        self.restart()

    def restart(self):
        """Start as at power-up."""
        self.registers = bytearray(71)
        self.registers[:FEETECH_EEPROM_BYTES] = self.stored
        self.registers[Feetech.LOCK] = 1
        self.registers[Feetech.VOLTAGE : Feetech.TEMPERATURE + 1] = bytes((121, 31))
        self.registers[Feetech.CURRENT : Feetech.CURRENT + 2] = b"\x0a\x80"  # -10 counts

    def put(self, address, value):
        self.registers[address : address + 2] = value.to_bytes(2, "little")

    def get(self, address):
        return int.from_bytes(self.registers[address : address + 2], "little")

    @property
    def goal(self):
        return self.get(Feetech.GOAL)

    def cut_torque(self, status):
        self.status, self.registers[Feetech.TORQUE] = status, 0

    def handle(self, frame):
        body = frame[2:-1]
        assert frame[:2] == b"\xff\xff"
        assert body[1] == len(frame) - 4
        assert (sum(body) + frame[-1]) & 0xFF == 0xFF
        if not self.powered or body[0] != self.device_id:
            return b""
        data, level = b"", self.registers[Feetech.RESPONSE_LEVEL]
        if body[2] == FeetechInstruction.READ:
            address, count = body[3:]
            self.reads.append(address)
            self.put(Feetech.POSITION, self.position)
            self.registers[Feetech.STATUS] = self.status
            data = bytes(self.registers[address : address + count])
            assert len(data) == count
        else:
            assert body[2] == FeetechInstruction.WRITE
            self.write(body[3], body[4:])
            if not level:
                return b""
        return feetech_frame(self.device_id, self.status, data)

    def write(self, address, data):
        self.writes.append((address, bytes(data), self.registers[Feetech.TORQUE]))
        for place, value in enumerate(data, address):
            if place not in self.ignored_addresses:
                self.registers[place] = value
        if address < FEETECH_EEPROM_BYTES and not self.registers[Feetech.LOCK]:
            self.stored[:] = self.registers[:FEETECH_EEPROM_BYTES]
        if self.registers[Feetech.TORQUE] == 1 and self.registers[Feetech.OPERATING_MODE] == 0:
            self.position = self.goal


class Rig:
    """Runs a driver as the loop does: in each tick receive, command, and then `slack` calls of receive."""

    def __init__(self, rudder, *, period_s=0.1, slack=6):
        self.rudder = rudder
        self.period_s = period_s
        self.slack = slack
        self.now_s = 0.0

    def ticks(self, count, shaft_deg=0.0, torque_on=True):
        feedback = []
        for _ in range(count):
            self.rudder.receive(self.now_s)
            self.rudder.command(RudderCommand(math.radians(shaft_deg), torque_on), self.now_s)
            for step in range(1, self.slack + 1):
                self.rudder.receive(self.now_s + 0.002 * step)
            feedback += self.rudder.poll()
            self.now_s += self.period_s
        return feedback

    def health(self):
        return self.rudder.health(self.now_s)


class Conversation:
    """Runs the protocol part of a driver with a servo that replies at once, at given times."""

    def __init__(self, servo, fake):
        self.servo = servo
        self.fake = fake

    def run(self, now_s, *, torque_on=True):
        """Give a command and exchange frames until nothing is due; return the requests."""
        self.servo.command(0.1, now_s, torque_on=torque_on)
        requests = []
        while (request := self.servo.next_request(now_s)) is not None:
            self.servo.note_sent(request, now_s)
            for reply in self.servo.parser.feed(self.fake.handle(request.frame)):
                self.servo.process_reply(request, reply, now_s, is_certain=True)
            requests.append(request)
            assert len(requests) < 50  # it would not end
        return requests


@pytest.fixture(scope="session")
def fakes():
    """Classes and functions of this module, which tests cannot import."""
    return SimpleNamespace(
        line=FakeLine,
        late_line=LateLine,
        dynamixel=FakeDynamixel,
        volz=FakeVolz,
        feetech=FakeFeetech,
        rig=Rig,
        conversation=Conversation,
        status_frame=status_frame,
        volz_frame=volz_frame,
        feetech_frame=feetech_frame,
    )
