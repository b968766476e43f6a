"""The emulator works with the library of its maker, dynamixel_sdk, in simulated time."""

import math

import dynamixel_sdk
import numpy as np
import pytest

from hil.devices.dynamixel import DynamixelEmulator
from hil.ship.servo import ServoShaft

BAUD = 57_600


class EmulatedPort:
    """The methods of a PortHandler that dynamixel_sdk calls."""

    def __init__(self, servo, shaft):
        self.is_using = False
        self.now_s = 1.0
        self._servo = servo
        self._shaft = shaft
        self._deadline_s = 0.0
        self._inbox = bytearray()

    def getBaudRate(self):  # noqa: N802 - name of the library
        return BAUD

    def clearPort(self):  # noqa: N802
        self._inbox.clear()

    def writePort(self, packet):  # noqa: N802
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
        self.setPacketTimeoutMillis(packet_length * 10_000 / BAUD + 34.0)

    def setPacketTimeoutMillis(self, milliseconds):  # noqa: N802
        self._deadline_s = self.now_s + milliseconds / 1000.0

    def isPacketTimeout(self):  # noqa: N802
        return self.now_s > self._deadline_s

    def pass_time(self, until_s):
        self.now_s = max(self.now_s, until_s)
        self._shaft.advance(self.now_s)
        self._inbox += self._servo.take_output(self.now_s)


@pytest.fixture
def shaft():
    return ServoShaft()


@pytest.fixture
def servo(shaft):
    return DynamixelEmulator(shaft, np.random.default_rng(1), baud=BAUD)


@pytest.fixture
def port(servo, shaft):
    return EmulatedPort(servo, shaft)


@pytest.fixture
def sdk():
    return dynamixel_sdk.PacketHandler(2.0)


def test_ping_and_broadcast_ping_return_the_model(sdk, port):
    assert sdk.ping(port, 1) == (1170, dynamixel_sdk.COMM_SUCCESS, 0)
    assert sdk.ping(port, 2)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
    servos, result = sdk.broadcastPing(port)
    assert (result, servos) == (dynamixel_sdk.COMM_SUCCESS, {1: [1170, 45]})


def test_goal_position_is_reached_and_read(sdk, port, shaft):
    assert sdk.write1ByteTxRx(port, 1, 64, 1) == (dynamixel_sdk.COMM_SUCCESS, 0)
    assert sdk.write4ByteTxRx(port, 1, 116, 2389) == (dynamixel_sdk.COMM_SUCCESS, 0)
    port.pass_time(port.now_s + 2.0)
    assert sdk.read4ByteTxRx(port, 1, 132) == (2389, dynamixel_sdk.COMM_SUCCESS, 0)
    assert shaft.angle_rad() == pytest.approx(341 * math.tau / 4096)
    voltage, result, error = sdk.read2ByteTxRx(port, 1, 144)
    assert (voltage, result, error) == (pytest.approx(120, abs=2), dynamixel_sdk.COMM_SUCCESS, 0)


def test_group_sync_write_is_read_by_group_sync_read(sdk, port):
    sdk.write1ByteTxRx(port, 1, 64, 1)
    writer = dynamixel_sdk.GroupSyncWrite(port, sdk, 116, 4)
    writer.addParam(1, (2100).to_bytes(4, "little"))
    assert writer.txPacket() == dynamixel_sdk.COMM_SUCCESS
    port.pass_time(port.now_s + 1.0)
    reader = dynamixel_sdk.GroupSyncRead(port, sdk, 126, 10)
    reader.addParam(1)
    assert reader.txRxPacket() == dynamixel_sdk.COMM_SUCCESS
    assert reader.getData(1, 132, 4) == 2100
