"""A Dynamixel behind an adapter that holds its answers back and echoes, over ptys in real time."""

import math
import random
import select
import time
from contextlib import closing

import numpy as np
import pytest

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.system.serial_port import SerialPort
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.serial_line import SerialLine
from hil.ship.servo import ServoShaft
from support.wire import Wire

BAUD, PERIOD_S = 57600, 0.1
READ_LIMITS = bytes.fromhex("fffffd00010700023000")  # the head of the instruction, as far as the address


class Bench:
    """The driver on one end of a wire and the emulated servo on the other, in one thread."""

    def __init__(self, port, far_end):
        self.port, self.far_end = port, far_end
        self.shaft = ServoShaft(now_s=time.monotonic())
        self.servo = DynamixelEmulator(self.shaft, np.random.default_rng(1), baud=BAUD)
        self.servo.transmitter.on_a_wire = True
        self.rudder = dynamixel_rudder(port, DynamixelOptions())
        self.heard = b""
        self.states = []

    def serve_servo(self):
        now_s = time.monotonic()
        self.shaft.advance(now_s)
        said = self.far_end.read()
        self.heard += said
        self.servo.receive(now_s, said)
        self.far_end.write(self.servo.take_output(now_s))

    def ticks(self, angles_rad, *, alive=True):
        """Tick once for each angle as the loop does, or let the autopilot stand still for so long."""
        feedback = []
        for angle_rad in angles_rad:
            now_s = time.monotonic()
            if alive:
                self.rudder.receive(now_s)
                self.rudder.command(RudderCommand(angle_rad, torque_on=True), now_s)
                feedback += self.rudder.poll()
                self.states.append(self.rudder.health(now_s).state)
            while (left_s := now_s + PERIOD_S - time.monotonic()) > 0.0:
                awaited = [self.port] if alive and self.rudder.hurries() else []
                until_s = min(left_s, max(0.0, self.servo.next_output_s() - time.monotonic()))
                ready = select.select([self.far_end, *awaited], [], [], until_s)[0]
                self.serve_servo()
                if self.port in ready:
                    self.rudder.receive(time.monotonic())
        return feedback


@pytest.fixture
def bench(tmp_path):
    here, there = tmp_path / "float", tmp_path / "servo"
    chance = random.Random(1)
    with Wire(here, there, BAUD, held_s=lambda: chance.choice([0.016] * 4 + [0.12])):
        port = SerialPort(str(here), BAUD)
        port.open()
        with closing(port), closing(SerialLine(str(there), BAUD)) as far_end:
            yield Bench(port, far_end)


def test_answers_that_are_now_and_then_late_are_no_fault_and_a_tripped_watchdog_is_cleared_at_once(bench):
    bench.ticks([0.0] * 14)
    assert bench.states[-1] is DeviceState.RUNNING
    bench.states.clear()
    bench.heard = b""
    angles_rad = [0.3 * math.sin(0.4 * number) for number in range(20)]
    feedback = bench.ticks([*angles_rad, *[-0.4] * 10])
    assert len(feedback) > 15
    assert set(bench.states) == {DeviceState.RUNNING}
    assert READ_LIMITS not in bench.heard  # nothing was refused, so nothing is taught anew
    assert bench.shaft.angle_rad() == pytest.approx(-0.4, abs=0.002)

    bench.ticks([0.4])  # on its way when the autopilot stands still
    bench.shaft.jam()
    bench.ticks([0.4] * 22, alive=False)
    bench.shaft.free()
    stopped_rad = bench.shaft.angle_rad()
    assert abs(stopped_rad - 0.4) > 0.3
    bench.ticks([0.4] * 15)
    assert bench.shaft.angle_rad() == pytest.approx(0.4, abs=0.002)
    assert set(bench.states) == {DeviceState.RUNNING}
