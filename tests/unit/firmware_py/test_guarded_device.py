"""Guard around drivers of installed packages: exceptions, invalid samples, and another start after 10 s."""

import math
from typing import ClassVar

import pytest

from firmware_py.common.driver import Driver
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    HeadingSample,
    NorthReference,
    PositionSample,
    RudderCommand,
    RudderFeedback,
)
from firmware_py.devices import NoOptions
from firmware_py.guarded_device import GuardedDevice
from support.line import FakeLine

GOOD = HeadingSample(1.0, 2.0, NorthReference.MAGNETIC)


class ScriptedDriver:
    """A driver whose methods return or raise what the test sets."""

    results: ClassVar = {"receive": None, "poll": (GOOD,), "command": None, "needs_prompt_io": True}
    made = 0

    def __init__(self, _line, _options):
        type(self).made += 1

    def __getattr__(self, name):
        def call(*arguments):
            result = self.results[name]
            if isinstance(result, Exception):
                raise result
            return result(*arguments) if callable(result) else result

        return call


def health_of(now_s):
    return DeviceHealth(now_s, DeviceRole.POSITION, DeviceState.RUNNING, 7, 1, "x" * 200)


@pytest.fixture
def driver():
    class Fresh(ScriptedDriver):
        results: ClassVar = {**ScriptedDriver.results, "health": health_of}

    return Fresh


@pytest.fixture
def line():
    return FakeLine()


def guard(driver, line, *, samples=(HeadingSample,), problem=""):
    row = Driver(interface=1, device="", options=NoOptions, make=driver, problem=problem)
    return GuardedDevice(row, DeviceRole.COMPASS, samples, "acme 1.0", line, NoOptions())


def faulty(text, count=1):
    return DeviceHealth(5.0, DeviceRole.COMPASS, DeviceState.FAULTY, 0, count, f"driver of package acme 1.0: {text}")


def test_samples_and_health_of_a_working_driver_pass_with_the_role_of_the_section(driver, line):
    device = guard(driver, line)
    device.receive(1.0)
    assert list(device.poll()) == [GOOD]
    health = device.health(2.0)
    assert (health.role, health.state, health.accepted, len(health.text)) == (
        DeviceRole.COMPASS, DeviceState.RUNNING, 7, 120,
    )  # fmt: skip
    assert device.fileno() == 7
    device.command(RudderCommand(0.1, torque_on=True), 2.0)
    assert device.needs_prompt_io() is True


@pytest.mark.parametrize("method", ["receive", "poll", "health", "command", "needs_prompt_io"])
def test_exception_makes_the_device_faulty_and_the_driver_is_made_again_after_ten_seconds(driver, line, method):
    device = guard(driver, line)
    device.receive(4.0)
    driver.results[method] = ZeroDivisionError("oh")
    device.receive(4.0)
    device.poll(), device.command(RudderCommand(0.0, torque_on=True), 4.0), device.needs_prompt_io()
    assert device.health(5.0) == faulty("ZeroDivisionError: oh")
    assert list(device.poll()) == []
    assert device.needs_prompt_io() is False
    driver.results[method] = ScriptedDriver.results.get(method, health_of)
    device.receive(13.9)
    assert (driver.made, device.health(5.0).state) == (1, DeviceState.FAULTY)
    device.receive(14.0)
    assert (driver.made, device.health(14.0).state) == (2, DeviceState.RUNNING)


def test_bytes_are_discarded_while_there_is_no_driver(driver, line):
    driver.results["receive"] = ValueError()
    device = guard(driver, line)
    device.receive(0.0)
    line.inbox += b"x" * 100
    device.receive(0.1)
    assert line.inbox == b""


def test_factory_that_raises_makes_the_device_faulty(line):
    device = guard(lambda _line, options: options.missing, line)
    device.receive(5.0)
    assert device.health(5.0) == faulty("AttributeError: 'NoOptions' object has no attribute 'missing'")


@pytest.mark.parametrize(
    ("sample", "text"),
    [
        (None, "TypeError: NoneType is not a sample of this device"),
        (PositionSample(0.0, 0), "TypeError: PositionSample is not a sample of this device"),
        (HeadingSample(1.0, math.nan, NorthReference.TRUE), "ValueError: heading_rad is nan"),
        (HeadingSample(math.inf, 1.0, NorthReference.TRUE), "ValueError: t_s is inf"),
        (HeadingSample(1.0, "1.0", NorthReference.TRUE), "ValidationError: Expected `float`, got `str` - at `$.head"),
        (HeadingSample(1.0, 1.0, 9), "ValidationError: Invalid enum value 9 - at `$.reference`"),
    ],
)
def test_invalid_sample_is_not_used_and_makes_the_device_faulty(driver, line, sample, text):
    driver.results["poll"] = (GOOD, sample)
    device = guard(driver, line)
    device.receive(5.0)
    assert list(device.poll()) == []
    assert device.health(5.0).text.startswith(f"driver of package acme 1.0: {text}")


@pytest.mark.parametrize("health", [None, DeviceHealth(0.0, DeviceRole.COMPASS, 77, 0, 0)])
def test_invalid_health_makes_the_device_faulty(driver, line, health):
    driver.results["health"] = lambda _now_s: health
    device = guard(driver, line)
    device.receive(5.0)
    assert device.health(5.0).state is DeviceState.FAULTY


def test_at_most_a_hundred_samples_of_a_poll_are_used(driver, line):
    driver.results["poll"] = [GOOD] * 101
    device = guard(driver, line)
    device.receive(5.0)
    assert len(device.poll()) == 100


def test_feedback_of_a_rudder_passes(driver, line):
    driver.results["poll"] = (RudderFeedback(1.0),)
    device = guard(driver, line, samples=(RudderFeedback,))
    device.receive(1.0)
    assert list(device.poll()) == [RudderFeedback(1.0)]


def test_unusable_driver_is_never_made_and_says_why(driver, line):
    device = guard(driver, line, problem="package acme 1.0 cannot be imported")
    device.receive(5.0)
    assert driver.made == 0
    assert device.health(5.0) == DeviceHealth(
        5.0, DeviceRole.COMPASS, DeviceState.FAULTY, 0, 0, "package acme 1.0 cannot be imported"
    )
