"""Emulator and driver work with the library of the maker, ftservo-python-sdk, in simulated time."""

import math

import numpy as np
import pytest
import scservo_sdk

from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.common.records import RudderCommand
from hil.devices.feetech import FeetechEmulator
from hil.ship.servo import ServoShaft
from support.line import FakeLine

BAUD = 1_000_000
OK = scservo_sdk.COMM_SUCCESS


class EmulatedPort:
    """The methods of a PortHandler that scservo_sdk calls; `frames` are the written frames."""

    def __init__(self, servo, shaft):
        self.is_using = False
        self.now_s = 1.0
        self.frames = []
        self._servo = servo
        self._shaft = shaft
        self._deadline_s = 0.0
        self._inbox = bytearray()

    def clearPort(self):  # noqa: N802 - names of the library
        self._inbox.clear()

    def writePort(self, packet):  # noqa: N802
        self.frames.append(bytes(packet))
        self.now_s += len(packet) * 10 / BAUD
        self._shaft.advance(self.now_s)
        self._servo.receive(self.now_s, bytes(packet))
        return len(packet)

    def readPort(self, length):  # noqa: N802
        if not self._inbox:
            self.pass_time(min(self._servo.next_output_s(), self._deadline_s + 1e-6))
        data = bytes(self._inbox[:length])
        del self._inbox[:length]
        return data

    def setPacketTimeout(self, packet_length):  # noqa: N802
        self._deadline_s = self.now_s + packet_length * 10 / BAUD + 0.05

    def isPacketTimeout(self):  # noqa: N802
        return self.now_s > self._deadline_s

    def pass_time(self, until_s):
        self.now_s = max(self.now_s, until_s)
        self._shaft.advance(self.now_s)
        self._inbox += self._servo.take_output(self.now_s)


@pytest.fixture
def shaft():
    return ServoShaft(low_stop_rad=-math.pi, high_stop_rad=math.pi)


@pytest.fixture
def servo(shaft):
    return FeetechEmulator(shaft, np.random.default_rng(1))


@pytest.fixture
def port(servo, shaft):
    return EmulatedPort(servo, shaft)


@pytest.fixture
def sdk(port):
    return scservo_sdk.sms_sts(port)


def test_ping_returns_the_model(sdk):
    assert sdk.ping(1) == (777, OK, 0)
    assert sdk.ping(2)[1] == scservo_sdk.COMM_RX_TIMEOUT


def test_goal_position_is_reached_and_read(sdk, port, shaft):
    assert sdk.write1ByteTxRx(1, scservo_sdk.SMS_STS_TORQUE_ENABLE, 1) == (OK, 0)
    assert sdk.WritePosEx(1, 2389, 1000, 50) == (OK, 0)
    assert sdk.ReadMoving(1) == (1, OK, 0)
    port.pass_time(port.now_s + 3.0)
    port.pass_time(port.now_s + 0.01)
    assert sdk.ReadPos(1) == (2389, OK, 0)
    assert sdk.ReadMoving(1) == (0, OK, 0)
    assert shaft.angle_rad() == pytest.approx(341 * math.tau / 4096)
    assert sdk.read1ByteTxRx(1, scservo_sdk.SMS_STS_PRESENT_VOLTAGE) == (pytest.approx(120, abs=2), OK, 0)
    assert sdk.read1ByteTxRx(1, scservo_sdk.SMS_STS_PRESENT_TEMPERATURE) == (25, OK, 0)
    current, *result = sdk.read2ByteTxRx(1, scservo_sdk.SMS_STS_PRESENT_CURRENT_L)
    assert (sdk.scs_tohost(current, 15), *result) == (pytest.approx(3, abs=4), OK, 0)


def test_registered_write_and_action(sdk, port):
    sdk.write1ByteTxRx(1, scservo_sdk.SMS_STS_TORQUE_ENABLE, 1)
    assert sdk.RegWritePosEx(1, 1900, 0, 0) == (OK, 0)
    port.pass_time(port.now_s + 1.0)
    assert sdk.ReadPos(1) == (2048, OK, 0)
    assert sdk.RegAction() == OK
    port.pass_time(port.now_s + 3.0)
    assert sdk.ReadPos(1) == (1900, OK, 0)


def test_group_sync_write_is_read_by_group_sync_read(sdk, port):
    sdk.write1ByteTxRx(1, scservo_sdk.SMS_STS_TORQUE_ENABLE, 1)
    assert sdk.SyncWritePosEx(1, 2100, 0, 0)
    assert sdk.groupSyncWrite.txPacket() == OK
    port.pass_time(port.now_s + 1.0)
    reader = scservo_sdk.GroupSyncRead(sdk, scservo_sdk.SMS_STS_PRESENT_POSITION_L, 15)
    assert reader.addParam(1)
    assert reader.txRxPacket() == OK
    assert reader.isAvailable(1, scservo_sdk.SMS_STS_PRESENT_POSITION_L, 2)[0]
    assert reader.getData(1, scservo_sdk.SMS_STS_PRESENT_POSITION_L, 2) == 2100


def test_values_are_stored_while_unlocked(sdk, port, servo):
    for unlock, stored_mode in ((sdk.LockEprom, 0), (sdk.unLockEprom, 1)):
        assert unlock(1) == (OK, 0)
        assert sdk.WheelMode(1) == (OK, 0)
        servo.power_cycle(port.now_s, off_s=0.1)
        port.pass_time(port.now_s + 1.0)
        assert sdk.read1ByteTxRx(1, scservo_sdk.SMS_STS_MODE) == (stored_mode, OK, 0)


def test_frames_of_the_driver_are_those_of_the_library(sdk, port, servo):
    """The driver starts a servo in another mode, moves it in both directions and releases it."""
    servo.stored[8] = 0  # no acknowledgements
    servo.table[8], servo.table[33], servo.table[40], servo.table[55] = 0, 1, 2, 0
    line = FakeLine(PromptServo(servo, port), baud=BAUD)
    rudder = feetech_rudder(line, FeetechOptions())
    for number, (angle_rad, torque_on) in enumerate([(0.5, True)] * 16 + [(-0.5, True), (0.0, False)]):
        line.lose_replies = 8 if number == 12 else line.lose_replies  # each lost state is read with another length
        rudder.command(RudderCommand(angle_rad, torque_on), 0.1 * number)
        for step in range(8):
            rudder.receive(0.1 * number + 0.01 * step)
    port.frames.clear()
    goals = [2048 + 326, 2048 - 326]
    sdk.readTx(1, 0, 40)
    sdk.portHandler.is_using = False
    for address, values in [
        *((41, [254]), (55, [1]), (40, [0]), (33, [0]), (8, [1])),
        (scservo_sdk.SMS_STS_TORQUE_ENABLE, [1, 254, goals[0] & 0xFF, goals[0] >> 8]),
        *((scservo_sdk.SMS_STS_GOAL_POSITION_L, [goal & 0xFF, goal >> 8]) for goal in goals),
    ]:
        sdk.writeTxOnly(1, address, len(values), values)
    for first in (40, 37, 34, 28, 25):
        sdk.readTx(1, first, 71 - first)
        sdk.portHandler.is_using = False
    assert set(line.written) == set(port.frames)


class PromptServo:
    """The emulator as a device of a FakeLine: its replies are received at once."""

    def __init__(self, servo, port):
        self._servo, self._port = servo, port

    def handle(self, data):
        self._port.now_s += 0.01
        self._servo.receive(self._port.now_s, data)
        self._port.now_s += 0.01
        return self._servo.take_output(self._port.now_s)
