"""Guard around drivers of installed packages: exceptions, invalid samples, and another start after 10 s."""

import itertools
import math
import re
from typing import ClassVar

import pytest
from msgspec.structs import replace

from firmware_py.common.driver import Driver
from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    HeadingSample,
    NorthReference,
    PositionSample,
    PowerSample,
    RudderAngleSample,
    RudderCommand,
    RudderFeedback,
    WindReference,
    WindSample,
)
from firmware_py.common.vessels import VesselIdentity, VesselKind, VesselPosition
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
    return DeviceHealth(now_s, DeviceRole.POSITION, DeviceState.RUNNING, 7, 1, "x" * 300)


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


def failed(text, count=1):
    return DeviceHealth(5.0, DeviceRole.COMPASS, DeviceState.FAILED, 0, count, f"driver of package acme 1.0: {text}")


def without_line(health):
    """Return a health record without the line number in its text."""
    return replace(health, text=re.sub(r":\d+\)", ")", health.text))


def test_samples_and_health_of_a_working_driver_pass_with_the_role_of_the_section(driver, line):
    device = guard(driver, line)
    device.receive(1.0)
    assert list(device.poll()) == [GOOD]
    health = device.health(2.0)
    assert (health.role, health.state, health.accepted, len(health.text)) == (
        DeviceRole.COMPASS, DeviceState.RUNNING, 7, 200,
    )  # fmt: skip
    assert device.fileno() == 7
    device.command(RudderCommand(0.1, torque_on=True), 2.0)
    assert device.needs_prompt_io() is True


@pytest.mark.parametrize("method", ["receive", "poll", "health", "command", "needs_prompt_io"])
def test_exception_makes_the_device_failed_and_the_driver_is_made_again_after_ten_seconds(driver, line, method):
    device = guard(driver, line)
    device.receive(4.0)
    driver.results[method] = ZeroDivisionError("oh")
    device.receive(4.0)
    device.poll(), device.command(RudderCommand(0.0, torque_on=True), 4.0), device.needs_prompt_io()
    assert without_line(device.health(5.0)) == failed("ZeroDivisionError: oh (test_guarded_device.py)")
    assert list(device.poll()) == []
    assert device.needs_prompt_io() is False
    driver.results[method] = ScriptedDriver.results.get(method, health_of)
    device.receive(13.9)
    assert (driver.made, device.health(5.0).state) == (1, DeviceState.FAILED)
    device.receive(14.0)
    assert (driver.made, device.health(14.0).state) == (2, DeviceState.RUNNING)


def test_bytes_are_discarded_while_there_is_no_driver(driver, line):
    driver.results["receive"] = ValueError()
    device = guard(driver, line)
    device.receive(0.0)
    line.inbox += b"x" * 100
    device.receive(0.1)
    assert line.inbox == b""


def test_factory_that_raises_makes_the_device_failed(line):
    device = guard(lambda _line, options: options.missing, line)
    device.receive(5.0)
    text = "AttributeError: 'NoOptions' object has no attribute 'missing' (test_guarded_device.py)"
    assert without_line(device.health(5.0)) == failed(text)


@pytest.mark.parametrize(
    ("sample", "text"),
    [
        (None, "TypeError: NoneType is not a sample of this device"),
        (PositionSample(0.0, 0), "TypeError: PositionSample is not a sample of this device"),
        (HeadingSample(1.0, math.nan, NorthReference.TRUE), "ValueError: heading_rad is nan"),
        (HeadingSample(math.inf, 1.0, NorthReference.TRUE), "ValueError: t_s is inf"),
        (HeadingSample(1.0, 6.29, NorthReference.TRUE), "ValueError: heading_rad is 6.29, expected 0 to 6.283 radians"),
        (HeadingSample(1.0, -0.01, NorthReference.TRUE), "ValueError: heading_rad is -0.01, expected 0 to 6.283 rad"),
        (HeadingSample(1.0, 1.0, NorthReference.TRUE, roll_rad=3.15), "ValueError: roll_rad is 3.15, expected -3.142"),
        (
            HeadingSample(1.0, 1.0, NorthReference.TRUE, pitch_rad=-1.58),
            "ValueError: pitch_rad is -1.58, expected -1.5",
        ),
        (
            HeadingSample(1.0, "1.0", NorthReference.TRUE),
            "msgspec.ValidationError: Expected `float`, got `str` - at `$.head",
        ),
        (HeadingSample(1.0, 1.0, 9), "msgspec.ValidationError: Invalid enum value 9 - at `$.reference`"),
        (HeadingSample(1.0, 1.1e10, NorthReference.TRUE), "ValueError: heading_rad is 11000000000.0"),
        (HeadingSample(1.0, -1.1e10, NorthReference.TRUE), "ValueError: heading_rad is -11000000000.0"),
        (HeadingSample(1.0, 1.0, NorthReference.TRUE, source=-1), "ValueError: source is -1"),
        (HeadingSample(5.1, 1.0, NorthReference.TRUE), "ValueError: t_s is 5.1, now is 5.0"),
        (HeadingSample(-55.1, 1.0, NorthReference.TRUE), "ValueError: t_s is -55.1, now is 5.0"),
    ],
)
def test_invalid_sample_is_not_used_and_makes_the_device_failed(driver, line, sample, text):
    driver.results["poll"] = (GOOD, sample)
    device = guard(driver, line)
    device.receive(5.0)
    assert list(device.poll()) == []
    assert device.health(5.0).text.startswith(f"driver of package acme 1.0: {text}")


@pytest.mark.parametrize("health", [None, DeviceHealth(0.0, DeviceRole.COMPASS, 77, 0, 0)])
def test_invalid_health_makes_the_device_failed(driver, line, health):
    driver.results["health"] = lambda _now_s: health
    device = guard(driver, line)
    device.receive(5.0)
    assert device.health(5.0).state is DeviceState.FAILED


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


def samples_of(driver, line, sample):
    """Return the samples of a driver that returns this one, and the text of its health record."""
    driver.results["poll"] = (sample,)
    device = guard(driver, line, samples=(type(sample),))
    device.receive(5.0)
    return list(device.poll()), device.health(5.0).text


@pytest.mark.parametrize(
    ("largest", "too_large"),
    [
        (RudderFeedback(5.0, restarts=2**32 - 1), RudderFeedback(5.0, restarts=2**32)),
        (RudderFeedback(5.0, hardware_error=0), RudderFeedback(5.0, hardware_error=-1)),
        (WindSample(5.0, 1e10, 0.0, WindReference.NORTH), WindSample(5.0, 1e300, 0.0, WindReference.NORTH)),
        (
            VesselPosition(5.0, 1, VesselKind.CLASS_A, 0.0, 0.0, status=255),
            VesselPosition(5.0, 1, VesselKind.CLASS_A, 0.0, 0.0, status=256),
        ),
        (VesselIdentity(5.0, 1, "x" * 200), VesselIdentity(5.0, 1, "x" * 201)),
        (
            VesselIdentity(5.0, 1, dimensions_m=(1, 2, 3, 2**32 - 1)),
            VesselIdentity(5.0, 1, dimensions_m=(1, 2, 3, 2**32)),
        ),
        (HeadingSample(-55.0, 1.0, NorthReference.TRUE), HeadingSample(1e300, 1.0, NorthReference.TRUE)),
        *(
            (
                HeadingSample(5.0, 6.28, NorthReference.TRUE, **{name: value}),
                HeadingSample(5.0, 6.28, 0, **{name: over}),
            )
            for name, limit, above in (("roll_rad", 3.14, 3.15), ("pitch_rad", 1.57, 1.58))
            for value, over in ((limit, above), (-limit, -above))
        ),
        *(
            (PositionSample(5.0, FixType.FIX_3D, *values), PositionSample(5.0, FixType.FIX_3D, *over))
            for values, over in (
                ((1.57, 3.14, 0.0, 0.0, 6.28), (1.58, 0.0)),
                ((-1.57, -3.14, 0.0, 0.0, 0.0), (-1.58, 0.0)),
                ((0.0, 0.0), (0.0, 3.15)),
                ((0.0, 0.0), (0.0, -3.15)),
                ((0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 6.29)),
                ((0.0, 0.0), (0.0, 0.0, 0.0, 0.0, -0.01)),
            )
        ),
        (RudderAngleSample(5.0, 3.14), RudderAngleSample(5.0, 3.15)),
        (RudderAngleSample(5.0, -3.14), RudderAngleSample(5.0, -3.15)),
    ],
)
def test_values_that_the_log_or_the_autopilot_cannot_use_make_the_device_failed(driver, line, largest, too_large):
    assert samples_of(driver, line, largest)[0] == [largest]
    samples, text = samples_of(driver, line, too_large)
    assert samples == []
    assert text.startswith("driver of package acme 1.0: ValueError: ")


@pytest.mark.parametrize("sample", [PowerSample(5.0, 7), HeadingSample(5.0, 1.0, NorthReference.TRUE, source=1)])
def test_samples_are_those_of_the_first_device(driver, line, sample):
    """A source of 7 has no place in the state of the batteries: the tick would fail."""
    ((result,), _) = samples_of(driver, line, sample)
    assert result.source == 0


def test_time_of_a_command_is_the_present(driver, line):
    driver.results["poll"] = (RudderFeedback(6.0),)
    device = guard(driver, line, samples=(RudderFeedback,))
    device.receive(5.0)
    device.command(RudderCommand(0.0, torque_on=True), 6.0)
    assert list(device.poll()) == [RudderFeedback(6.0)]


def test_driver_that_exits_does_not_end_the_autopilot(driver, line):
    def leave(_now_s):
        raise SystemExit(3)

    driver.results["receive"] = leave
    device = guard(driver, line)
    device.receive(5.0)
    assert device.health(5.0).text.startswith("driver of package acme 1.0: SystemExit: 3 (")


def test_sample_of_the_future_is_refused_from_the_first_read(driver, line):
    driver.results["poll"] = (HeadingSample(0.6, 1.0, NorthReference.TRUE),)
    device = guard(driver, line)
    device.receive(0.5)
    assert list(device.poll()) == []
    assert device.health(0.5).text == "driver of package acme 1.0: ValueError: t_s is 0.6, now is 0.5"


def test_samples_without_an_end_are_not_collected(driver, line):
    driver.results["poll"] = itertools.repeat(GOOD)
    device = guard(driver, line)
    device.receive(5.0)
    assert len(device.poll()) == 100


def test_time_and_counters_of_a_health_record_can_be_logged(driver, line):
    device = guard(driver, line)
    device.receive(5.0)
    driver.results["health"] = lambda _now_s: DeviceHealth(1e300, DeviceRole.COMPASS, DeviceState.RUNNING, 2, 3)
    assert device.health(6.0) == DeviceHealth(6.0, DeviceRole.COMPASS, DeviceState.RUNNING, 2, 3)
    driver.results["health"] = lambda now_s: DeviceHealth(now_s, DeviceRole.COMPASS, DeviceState.RUNNING, -1, 0)
    assert device.health(6.0).text == "driver of package acme 1.0: ValueError: accepted is -1"


def test_samples_that_are_none_are_an_error_of_poll(driver, line):
    driver.results["poll"] = None
    device = guard(driver, line)
    device.receive(5.0)
    assert list(device.poll()) == []
    assert device.health(5.0) == failed("TypeError: poll() returned NoneType, not the samples")


def test_device_is_starting_before_its_driver_is_made(driver, line):
    assert guard(driver, line).health(5.0).state is DeviceState.STARTING


def test_time_that_runs_back_by_rounding_does_not_refuse_a_sample(driver, line):
    """A tick computes the present as its deadline plus its lateness."""
    driver.results["poll"] = (HeadingSample(5.0, 1.0, NorthReference.TRUE),)
    device = guard(driver, line)
    device.receive(5.0)
    device.receive(math.nextafter(5.0, 0.0))
    assert len(device.poll()) == 1
    device.command(RudderCommand(0.0, torque_on=True), math.nextafter(5.0, 0.0))
    assert len(device.poll()) == 1


def test_exception_whose_text_cannot_be_made_is_named(driver, line):
    class MuteError(Exception):
        def __str__(self):
            raise ValueError

    driver.results["receive"] = MuteError()
    device = guard(driver, line)
    device.receive(5.0)
    assert "MuteError" in device.health(5.0).text
