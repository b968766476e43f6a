"""Driver of a hobby servo on a PWM output."""

import math

import pytest

from firmware_py.actuator.pulse import PulseOptions
from firmware_py.actuator.pwm import PwmServo
from firmware_py.common.records import DeviceRole, DeviceState, RudderCommand


@pytest.fixture
def line(fakes):
    line = fakes.line(name="pwm:/sys/class/pwm/pwmchip0/0")
    line.fileno = lambda: -1
    return line


@pytest.fixture
def servo(line):
    return PwmServo(line, PulseOptions(us_per_rad=500.0))


def test_command_is_a_pulse_width_in_nanoseconds(servo, line):
    for shaft_rad in (0.0, 0.5, -0.5, 3.0):
        servo.command(RudderCommand(shaft_rad, torque_on=True), 1.0)
    assert line.written == [b"1500000\n", b"1750000\n", b"1250000\n", b"2000000\n"]
    assert not servo.needs_prompt_io()
    assert servo.fileno() == -1


def test_feedback_has_no_angle(servo):
    servo.command(RudderCommand(0.1, torque_on=True), 1.5)
    servo.receive(1.6)
    (feedback,) = servo.poll()
    assert (feedback.t_s, feedback.shaft_rad, feedback.torque_on, feedback.restarts) == (1.5, None, True, 0)
    assert servo.poll() == ()
    for number in range(20):
        servo.command(RudderCommand(0.1, torque_on=True), float(number))
    assert len(servo.poll()) == 8


def test_released_servo_has_no_pulse(servo, line):
    servo.command(RudderCommand(0.1, torque_on=False), 1.0)
    assert line.written == [b"0\n"]
    assert [feedback.torque_on for feedback in servo.poll()] == [False]
    health = servo.health(1.0)
    assert (health.role, health.state, health.text) == (
        DeviceRole.RUDDER, DeviceState.RUNNING, "no pulse; the servo is free",
    )  # fmt: skip


def test_angle_that_is_not_finite_repeats_the_last_one(servo, line):
    servo.command(RudderCommand(math.nan, torque_on=True), 1.0)
    servo.command(RudderCommand(0.1, torque_on=True), 1.1)
    servo.command(RudderCommand(math.inf, torque_on=True), 1.2)
    assert line.written == [b"0\n", b"1550000\n", b"1550000\n"]
    assert servo.health(1.2).rejected == 2


def test_states(servo, line):
    assert (servo.health(0.0).state, servo.health(0.0).text) == (DeviceState.STARTING, "no pulse yet")
    servo.command(RudderCommand(0.1, torque_on=True), 1.0)
    assert (servo.health(1.0).state, servo.health(1.0).text, servo.health(1.0).accepted) == (DeviceState.RUNNING, "", 1)
    servo.command(RudderCommand(1.2, torque_on=True), 1.1)
    assert servo.health(1.1).text == "pulse limited by min_us or max_us"
    servo.poll()
    line.full = True
    servo.command(RudderCommand(0.1, torque_on=True), 1.2)
    health = servo.health(1.2)
    assert (health.state, health.text) == (DeviceState.SILENT, "the kernel does not accept the pulse width")
    assert servo.poll() == ()
    line.unplug()
    servo.command(RudderCommand(0.1, torque_on=True), 1.3)
    assert servo.poll() == ()
    health = servo.health(1.3)
    assert (health.state, health.text) == (DeviceState.ABSENT, "port pwm:/sys/class/pwm/pwmchip0/0 not connected")
    line.full = False
    line.plug()
    servo.command(RudderCommand(0.1, torque_on=True), 1.4)
    assert servo.health(1.4).state is DeviceState.RUNNING
