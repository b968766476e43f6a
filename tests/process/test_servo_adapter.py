"""A Dynamixel behind an adapter that holds its answers back and echoes, over a pty in simulated time."""

import math
import random
from contextlib import closing

import numpy as np
import pytest

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.system.serial_port import SerialPort
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.timing import transfer_s
from hil.ship.servo import ServoShaft

BAUD, PERIOD_MS = 57600, 100
READ_LIMITS = bytes.fromhex("fffffd00010700023000")  # the head of the instruction, as far as the address


class Bench:
    """The driver on a port and the emulated servo at its other end, a millisecond at a time."""

    def __init__(self, port, line, held_s, *, echo):
        self.port, self.line, self.held_s, self.echo = port, line, held_s, echo
        self.now_ms = 0
        self.shaft = ServoShaft()
        self.servo = DynamixelEmulator(self.shaft, np.random.default_rng(1), baud=BAUD, collisions=True)
        self.rudder = dynamixel_rudder(port, DynamixelOptions())
        self.to_servo, self.to_here = [], []  # when there, bytes
        self.received = b""
        self.states = []

    @property
    def now_s(self):
        return self.now_ms / 1000.0

    def pass_a_millisecond(self):
        self.now_ms += 1
        output = self.line.read_until_total(self.port.written)
        if output:
            self.to_servo.append((self.now_s + transfer_s(len(output), BAUD), output))
        self.shaft.advance(self.now_s)
        while self.to_servo and self.to_servo[0][0] <= self.now_s:
            _, output = self.to_servo.pop(0)
            self.received += output
            self.servo.receive(self.now_s, output)
            self.hand_over(output if self.echo else b"", 0.0)
        if answer := self.servo.take_output(self.now_s):
            self.hand_over(answer, self.held_s())
        while self.to_here and self.to_here[0][0] <= self.now_s:
            assert self.line.deliver(self.to_here.pop(0)[1])

    def hand_over(self, data, held_s):
        if data:
            earliest_s = self.to_here[-1][0] if self.to_here else 0.0
            self.to_here.append((max(earliest_s, self.now_s + held_s), data))

    def ticks(self, angles_rad, *, alive=True):
        """Tick once for each angle as the loop does, or let the autopilot stand still for so long."""
        feedback = []
        for angle_rad in angles_rad:
            if alive:
                self.rudder.receive(self.now_s)
                self.rudder.command(RudderCommand(angle_rad, torque_on=True), self.now_s)
                feedback += self.rudder.poll()
                self.states.append(self.rudder.health(self.now_s).state)
            for _ in range(PERIOD_MS):
                self.pass_a_millisecond()
                if alive and self.rudder.needs_prompt_io() and self.line.pending_at_slave():
                    self.rudder.receive(self.now_s)
        return feedback


@pytest.fixture
def bench_of(tmp_path):
    with closing(PtyLine(tmp_path / "port")) as line, closing(SerialPort(str(tmp_path / "port"), BAUD)) as port:
        port.open()
        yield lambda held_s, echo=True: Bench(port, line, held_s, echo=echo)


def now_and_then_late(seed):
    chance = random.Random(seed)
    return lambda: chance.choice([0.016] * 4 + [0.12])


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize(
    "held_s", [now_and_then_late(1), now_and_then_late(2), lambda: 0.12], ids=["late", "late too", "always late"]
)
def test_late_answers_are_no_fault(bench_of, held_s, echo):
    bench = bench_of(held_s, echo)
    bench.ticks([0.0] * 40)
    assert bench.states[-1] is DeviceState.RUNNING
    bench.states.clear()
    bench.received = b""
    feedback = bench.ticks([0.3 * math.sin(0.4 * number) for number in range(100)])
    assert len(feedback) > 60
    assert set(bench.states) == {DeviceState.RUNNING}
    assert READ_LIMITS not in bench.received  # nothing was refused, so nothing is configured again
    bench.ticks([-0.4] * 20)
    assert bench.shaft.angle_rad() == pytest.approx(-0.4, abs=0.002)
    assert bench.servo.collision_count == 0


@pytest.mark.parametrize(("held_s", "within"), [(lambda: 0.0, 1), (now_and_then_late(3), 8)], ids=["prompt", "late"])
@pytest.mark.parametrize("ticks", [20, 22, 24])
def test_a_tripped_watchdog_is_cleared_at_once(bench_of, held_s, within, ticks):
    bench = bench_of(held_s)
    bench.ticks([0.0] * ticks)
    bench.ticks([0.4])
    bench.shaft.jam()
    bench.ticks([0.4] * 22, alive=False)
    bench.shaft.free()
    stopped_rad = bench.shaft.angle_rad()
    assert abs(stopped_rad - 0.4) > 0.3
    bench.ticks([0.4] * within)
    assert abs(bench.shaft.angle_rad() - stopped_rad) > 0.01
    bench.ticks([0.4] * 12)
    assert bench.shaft.angle_rad() == pytest.approx(0.4, abs=0.002)
    assert bench.states[-1] is DeviceState.RUNNING
