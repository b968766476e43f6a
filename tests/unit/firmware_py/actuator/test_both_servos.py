"""Common behaviour of the servo drivers."""

import math

import pytest

from firmware_py.actuator.dynamixel import DynamixelOptions, dynamixel_rudder
from firmware_py.actuator.feetech import FeetechOptions, feetech_rudder
from firmware_py.actuator.volz import VolzOptions, volz_rudder
from firmware_py.common.records import DeviceState, RudderCommand
from support.servo_registers import DynamixelInstruction, FeetechInstruction

COUNTS_PER_DEG = {"dynamixel": 4096 / 360, "volz": 19.2, "feetech": 4096 / 360}
NOISE = {"dynamixel": b"\xff\xff\xfd\x00\x01\x00", "volz": b"\x2c\x01\xdc", "feetech": b"\xff\xff\x01\x21\x00"}


@pytest.fixture(params=["dynamixel", "volz", "feetech"])
def kind(request):
    return request.param


@pytest.fixture
def servo(fakes, kind):
    return getattr(fakes, kind)()


@pytest.fixture
def line(fakes, servo):
    return fakes.line(servo)


@pytest.fixture
def driver(kind):
    """Return the driver of a line."""
    drivers = {
        "dynamixel": lambda line: dynamixel_rudder(line, DynamixelOptions()),
        "volz": lambda line: volz_rudder(line, VolzOptions()),
        "feetech": lambda line: feetech_rudder(line, FeetechOptions()),
    }
    return drivers[kind]


@pytest.fixture
def rig(fakes, line, driver):
    return fakes.rig(driver(line))


@pytest.fixture
def counts(kind):
    """Return the position of a shaft angle in degrees."""
    return lambda shaft_deg: 2048 + round(COUNTS_PER_DEG[kind] * shaft_deg)


def test_next_request_waits_for_the_reply(fakes, servo, driver):
    line = fakes.line()  # replies only on demand
    rudder = driver(line)
    now_s = 0.0
    for _ in range(200):
        before = len(line.written)
        rudder.command(RudderCommand(0.1, True), now_s)
        for _ in range(3):
            rudder.receive(now_s)
        assert len(line.written) - before == 1
        line.inbox += servo.handle(line.written[-1])
        now_s += 0.02
    assert rudder.health(now_s).state is DeviceState.RUNNING


@pytest.mark.parametrize("shaft_rad", [math.nan, math.inf, -math.inf])
def test_goal_that_is_not_finite_is_rejected(rig, servo, counts, shaft_rad):
    rig.ticks(5, shaft_deg=10.0)
    rejected = rig.health().rejected
    rig.rudder.command(RudderCommand(shaft_rad, True), rig.now_s)
    rig.ticks(1, shaft_deg=math.nan)
    assert servo.position == counts(10.0)
    assert rig.health().rejected == rejected + 2


def test_servo_is_used_again_after_the_line_is_reopened(rig, servo, line, kind, counts):
    rig.ticks(5)
    line.unplug()
    assert rig.rudder.fileno() == -1
    rig.ticks(3)
    assert rig.health().state is DeviceState.ABSENT
    line.plug()
    servo.powered = False
    rig.ticks(8)
    assert rig.health().state is DeviceState.STARTING  # no reply since the line was opened
    servo.powered = True
    if kind != "volz":
        servo.restart()
    rig.ticks(6, shaft_deg=10.0)
    assert rig.health().state is DeviceState.RUNNING
    assert servo.position == counts(10.0)


def test_echo_and_noise_are_skipped(rig, line, servo, kind, counts):
    line.echo = True
    line.noise = NOISE[kind]
    feedback = rig.ticks(10, shaft_deg=8.0)
    assert len(feedback) >= 7
    assert servo.position == counts(8.0)
    assert rig.health().state is DeviceState.RUNNING


def is_goal(kind, frame):
    """Whether a request sets the position."""
    if kind == "dynamixel":
        return frame[7] == DynamixelInstruction.SYNC_WRITE
    return frame[4] == FeetechInstruction.WRITE


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"], indirect=True)
def test_every_second_request_to_a_silent_servo_is_the_goal(rig, servo, line, kind, counts):
    """A servo whose replies are lost may still receive."""
    rig.ticks(5)
    line.lose_replies = 1000
    rig.ticks(10, shaft_deg=12.0)
    assert rig.health().state is DeviceState.SILENT
    rig.ticks(4, shaft_deg=15.0)
    assert servo.position == counts(15.0)
    line.written.clear()
    rig.ticks(10, shaft_deg=15.0)
    goals = [is_goal(kind, frame) for frame in line.written]
    assert goals[:8] in ([True, False] * 4, [False, True] * 4)


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"], indirect=True)
@pytest.mark.parametrize("is_reopened", [False, True])
def test_no_goal_is_sent_before_the_first_reply(rig, servo, line, kind, is_reopened):
    if is_reopened:
        rig.ticks(5)
        line.unplug()
        line.plug()
        line.written.clear()
    servo.powered = False
    rig.ticks(1, shaft_deg=10.0)
    assert rig.health().state is DeviceState.STARTING
    rig.ticks(10, shaft_deg=10.0)
    assert len(line.written) > 4
    assert not any(is_goal(kind, frame) for frame in line.written)
    assert rig.health().state is DeviceState.STARTING


# Bytes of the longest exchange, with the time that the servo takes.
EXCHANGE_BYTES = {"dynamixel": 146, "volz": 23, "feetech": 111}


def test_request_is_given_up_after_the_longest_exchange(fakes, driver, kind):
    line = fakes.line(baud=1_000_000)
    rudder = driver(line)
    timeout_s = 0.016 + EXCHANGE_BYTES[kind] * 10 / 1_000_000  # 0.016 s: of a USB adapter
    for now_s, count in ((0.0, 1), (timeout_s - 1e-6, 1), (timeout_s + 1e-6, 2)):
        rudder.command(RudderCommand(0.1, True), now_s)
        assert len(line.written) == count
    assert rudder.health(timeout_s).state is DeviceState.STARTING


@pytest.mark.parametrize(
    ("options", "device_id", "allowed"),
    [
        (DynamixelOptions, 253, "0 to 252"),
        (DynamixelOptions, -1, "0 to 252"),
        (VolzOptions, 0, "1 to 30"),
        (VolzOptions, 31, "1 to 30"),
        (FeetechOptions, 254, "0 to 253"),
        (FeetechOptions, -1, "0 to 253"),
    ],
)
def test_invalid_id_is_rejected(options, device_id, allowed):
    assert options().id == 1
    with pytest.raises(ValueError, match=rf"id: .* allowed: {allowed}$"):
        options(id=device_id)
