"""Simulated servos, written from the documents of the manufacturers and not from the drivers, and a rig for drivers."""

import math
import struct
from types import SimpleNamespace

import pytest

from firmware_py.common.records import RudderCommand
from support.line import FakeLine, LateLine

VOLZ_REPLIES = {0xDC: 0x2C, 0xB0: 0x30, 0xB1: 0x31, 0xC0: 0x10}
INSTRUCTION_HEADER = bytes.fromhex("FFFFFD00")


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
        self.put(0, 1170, 2)
        self.registers[6] = 47
        self.registers[7] = device_id
        self.registers[9] = 250
        self.registers[11] = 3
        self.put(48, 4095, 4)
        self.put(52, 0, 4)
        self.position = 2048
        self.write_errors = {}  # error codes of reads and writes by address
        self.ignored_addresses = set()  # addresses whose writes have a reply but no effect
        self.eeprom_writes = []  # address, value, torque
        self.ram_writes = []  # address, value
        self.reads = []
        self.reboots = 0
        self.max_read, self.read_error = 255, 4  # error code of the reply to a longer read, None for no reply
        self.lost_replies = []  # addresses of writes whose reply is lost, once each
        self.restart()

    def put(self, address, value, size):
        self.registers[address : address + size] = value.to_bytes(size, "little")

    def get(self, address, size):
        return int.from_bytes(self.registers[address : address + size], "little")

    def restart(self):
        """Reset the RAM as at power-up."""
        self.registers[64:147] = bytes(83)
        self.registers[68] = 2
        self.put(116, self.position, 4)
        self.put(144, 121, 2)
        self.registers[146] = 31
        self.put(126, 0xFFF6, 2)  # -10 counts

    def shut_down(self, error):
        self.registers[70] |= error
        self.registers[64] = 0

    def trip_watchdog(self):
        self.registers[98] = 0xFF

    @property
    def goal(self):
        return self.get(116, 4)

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
        if self.powered and frame[4] == 0xFE and frame[7] == 0x83:
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
        if frame[7] == 3 and frame[8] in self.lost_replies:
            self.lost_replies.remove(frame[8])
            return b""
        alert = 0x80 if self.registers[70] else 0
        return status_frame(self.device_id, error | alert, parameters)

    def execute(self, instruction, parameters):
        if instruction == 1:
            return 0, bytes((*self.registers[0:2], self.registers[6]))
        if instruction == 2:
            address, length = struct.unpack("<HH", parameters)
            self.reads.append(address)
            if address in self.write_errors:
                return self.write_errors[address], b""
            if length > self.max_read:
                return self.read_error, b""
            self.put(132, self.position, 4)
            return 0, bytes(self.registers[address : address + length])
        if instruction == 8:
            self.reboots += 1
            self.restart()
            return 0, b""
        assert instruction == 3, instruction
        return self.store(struct.unpack("<H", parameters[:2])[0], parameters[2:]), b""

    def store(self, address, data):
        value = int.from_bytes(data, "little")
        torque = self.registers[64]
        if address < 64:
            self.eeprom_writes.append((address, value, torque))
            if torque:
                return 7
        else:
            self.ram_writes.append((address, value))
        if address in self.write_errors:
            return self.write_errors[address]
        if address in self.ignored_addresses:
            return 0
        if address == 116:
            low, high = self.get(52, 4), self.get(48, 4)
            if self.registers[98] == 0xFF or not low <= value <= high:
                return 4
            if torque:
                self.position = value
        if address == 64 and value and self.registers[70]:
            return 1
        self.registers[address : address + len(data)] = data
        return 0


class FakeVolz:
    """A DA 26 that replies at once; `values` contains the two arguments of the replies to readings."""

    def __init__(self, device_id=1):
        self.device_id = device_id
        self.powered = True
        self.values = {0xB0: (30, 0), 0xB1: (140, 0), 0xC0: (75, 81)}
        self.position = 0x0800
        self.requests = []

    def handle(self, frame):
        assert len(frame) == 6
        assert frame == volz_frame(*frame[:4])
        if not self.powered or frame[1] != self.device_id:
            return b""
        self.requests.append(frame[0])
        if frame[0] == 0xDC:
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
        self.stored = bytearray(40)  # the EEPROM area
        self.stored[:9] = bytes((3, 10, 0, 9, 3, device_id, 0, 0, 1))
        self.stored[11:13] = b"\xff\x0f"
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
        self.registers[:40] = self.stored
        self.registers[55] = 1
        self.registers[62:64] = bytes((121, 31))
        self.registers[69:71] = b"\x0a\x80"  # -10 counts

    def put(self, address, value):
        self.registers[address : address + 2] = value.to_bytes(2, "little")

    def get(self, address):
        return int.from_bytes(self.registers[address : address + 2], "little")

    @property
    def goal(self):
        return self.get(42)

    def cut_torque(self, status):
        self.status, self.registers[40] = status, 0

    def handle(self, frame):
        body = frame[2:-1]
        assert frame[:2] == b"\xff\xff"
        assert body[1] == len(frame) - 4
        assert (sum(body) + frame[-1]) & 0xFF == 0xFF
        if not self.powered or body[0] != self.device_id:
            return b""
        data, level = b"", self.registers[8]
        if body[2] == 2:
            address, count = body[3:]
            self.reads.append(address)
            self.put(56, self.position)
            self.registers[65] = self.status
            data = bytes(self.registers[address : address + count])
            assert len(data) == count
        else:
            assert body[2] == 3
            self.write(body[3], body[4:])
            if not level:
                return b""
        return feetech_frame(self.device_id, self.status, data)

    def write(self, address, data):
        self.writes.append((address, bytes(data), self.registers[40]))
        for place, value in enumerate(data, address):
            if place not in self.ignored_addresses:
                self.registers[place] = value
        if address < 40 and not self.registers[55]:
            self.stored[:] = self.registers[:40]
        if self.registers[40] == 1 and self.registers[33] == 0:
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
