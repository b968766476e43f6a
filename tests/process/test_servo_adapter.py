"""A servo behind an adapter that delays replies and echoes commands, over a pty in simulated time."""

import math
import random
from contextlib import ExitStack, closing

import numpy as np
import pytest

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.common.records import DeviceState, RudderCommand
from firmware_py.system.serial_port import SerialPort
from hil.devices.dynamixel import DynamixelEmulator
from hil.devices.feetech import FeetechEmulator
from hil.devices.pty_line import PtyLine
from hil.devices.timing import transfer_s
from hil.ship.servo import ServoShaft

PERIOD_MS = 100
READ_LIMITS = bytes.fromhex("fffffd00010700023000")  # start of the instruction, up to the address
READ_SETTINGS = bytes.fromhex("ffff01040200")
# Servo -> emulator, driver, baud rate.
SERVOS = {
    "dynamixel": (DynamixelEmulator, lambda port: dynamixel_rudder(port, DynamixelOptions()), 57600),
    "feetech": (FeetechEmulator, lambda port: feetech_rudder(port, FeetechOptions()), 115_200),
}


class Bench:
    """The driver on a port and the emulated servo at the other end, in steps of a millisecond."""

    def __init__(self, port, line, latency_s, *, echo, servo):
        self.port, self.line, self.latency_s, self.echo = port, line, latency_s, echo
        make_servo, make_rudder, self.baud = SERVOS[servo]
        self.now_ms = 0
        self.shaft = ServoShaft()
        self.servo = make_servo(self.shaft, np.random.default_rng(1), baud=self.baud, collisions=True)
        self.rudder = make_rudder(port)
        self.to_servo, self.to_driver = [], []  # (time of arrival, bytes)
        self.received = b""
        self.states = []

    @property
    def now_s(self):
        return self.now_ms / 1000.0

    def advance_millisecond(self):
        self.now_ms += 1
        data = self.line.read_until_total(self.port.written)
        if data:
            self.to_servo.append((self.now_s + transfer_s(len(data), self.baud), data))
        self.shaft.advance(self.now_s)
        while self.to_servo and self.to_servo[0][0] <= self.now_s:
            _, data = self.to_servo.pop(0)
            self.received += data
            self.servo.receive(self.now_s, data)
            self.send_to_driver(data if self.echo else b"", 0.0)
        if reply := self.servo.take_output(self.now_s):
            self.send_to_driver(reply, self.latency_s())
        while self.to_driver and self.to_driver[0][0] <= self.now_s:
            assert self.line.deliver(self.to_driver.pop(0)[1])

    def send_to_driver(self, data, latency_s):
        if data:
            earliest_s = self.to_driver[-1][0] if self.to_driver else 0.0
            self.to_driver.append((max(earliest_s, self.now_s + latency_s), data))

    def ticks(self, angles_rad, *, is_running=True):
        """Run a tick of the loop for each angle, or let the same time pass without the autopilot."""
        feedback = []
        for angle_rad in angles_rad:
            if is_running:
                self.rudder.receive(self.now_s)
                self.rudder.command(RudderCommand(angle_rad, torque_on=True), self.now_s)
                feedback += self.rudder.poll()
                self.states.append(self.rudder.health(self.now_s).state)
            for _ in range(PERIOD_MS):
                self.advance_millisecond()
                if is_running and self.rudder.needs_prompt_io() and self.line.pending_at_slave():
                    self.rudder.receive(self.now_s)
        return feedback


@pytest.fixture
def make_bench(tmp_path):
    with ExitStack() as ports:

        def make(latency_s, *, echo=True, servo="dynamixel"):
            line = ports.enter_context(closing(PtyLine(tmp_path / "port")))
            port = ports.enter_context(closing(SerialPort(str(tmp_path / "port"), SERVOS[servo][2])))
            port.open()
            return Bench(port, line, latency_s, echo=echo, servo=servo)

        yield make


def sometimes_late(seed):
    rng = random.Random(seed)
    return lambda: rng.choice([0.016] * 4 + [0.12])


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize(
    "latency_s", [sometimes_late(1), sometimes_late(2), lambda: 0.12], ids=["late", "late too", "always late"]
)
def test_late_replies_cause_no_fault(make_bench, latency_s, echo):
    check_servo_follows(make_bench(latency_s, echo=echo), READ_LIMITS)


@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("seed", [1, 2, None], ids=["late", "late too", "always late"])
def test_late_replies_of_a_feetech_cause_no_fault(make_bench, seed, echo):
    latency_s = (lambda: 0.12) if seed is None else sometimes_late(seed)
    check_servo_follows(make_bench(latency_s, echo=echo, servo="feetech"), READ_SETTINGS)


def check_servo_follows(bench, first_frame):
    """Check that the driver moves the servo without a fault; first_frame would begin another configuration."""
    bench.ticks([0.0] * 40)
    assert bench.states[-1] is DeviceState.RUNNING
    bench.states.clear()
    bench.received = b""
    feedback = bench.ticks([0.3 * math.sin(0.4 * number) for number in range(100)])
    assert len(feedback) > 60
    assert set(bench.states) == {DeviceState.RUNNING}
    assert first_frame not in bench.received
    bench.ticks([-0.4] * 20)
    assert bench.shaft.angle_rad() == pytest.approx(-0.4, abs=0.002)
    assert bench.servo.collision_count == 0


@pytest.mark.parametrize(("latency_s", "max_ticks"), [(lambda: 0.0, 1), (sometimes_late(3), 8)], ids=["prompt", "late"])
@pytest.mark.parametrize("ticks", [20, 22, 24])
def test_tripped_bus_watchdog_is_cleared(make_bench, latency_s, max_ticks, ticks):
    bench = make_bench(latency_s)
    bench.ticks([0.0] * ticks)
    bench.ticks([0.4])
    bench.shaft.jam()
    bench.ticks([0.4] * 22, is_running=False)
    bench.shaft.free()
    stopped_rad = bench.shaft.angle_rad()
    assert abs(stopped_rad - 0.4) > 0.3
    bench.ticks([0.4] * max_ticks)
    assert abs(bench.shaft.angle_rad() - stopped_rad) > 0.01
    bench.ticks([0.4] * 12)
    assert bench.shaft.angle_rad() == pytest.approx(0.4, abs=0.002)
    assert bench.states[-1] is DeviceState.RUNNING


@pytest.mark.parametrize("echo", [False, True])
def test_feetech_servo_is_used_again_after_a_power_loss(make_bench, echo):
    bench = make_bench(lambda: 0.001, echo=echo, servo="feetech")
    bench.ticks([0.3] * 20)
    assert bench.shaft.angle_rad() == pytest.approx(0.3, abs=0.002)
    bench.servo.power_cycle(bench.now_s, off_s=1.0)
    bench.ticks([-0.3] * 10)
    assert bench.states[-1] is DeviceState.SILENT
    feedback = bench.ticks([-0.3] * 20)
    assert bench.states[-1] is DeviceState.RUNNING
    assert bench.shaft.angle_rad() == pytest.approx(-0.3, abs=0.002)
    assert feedback[-1].restarts == 1


def test_feetech_servo_ignores_foreign_bytes(make_bench):
    bench = make_bench(lambda: 0.001, echo=False, servo="feetech")
    bench.ticks([0.0] * 10)
    bench.states.clear()
    rng = random.Random(1)
    for number in range(60):
        header = [b"", b"\xff\xff\x01\x21\x00", b"\xff\xff\x02\x02\x00\xfb"][number % 3]
        bench.line.deliver(header + rng.randbytes(number % 7))
        bench.ticks([0.2])
    assert set(bench.states) == {DeviceState.RUNNING}
    assert bench.shaft.angle_rad() == pytest.approx(0.2, abs=0.002)
