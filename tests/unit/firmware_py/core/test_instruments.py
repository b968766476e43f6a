"""Wind sensor and echo sounder: motion of the boat, age of the measurements, reports of silence."""

import math

import pytest
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    FixType,
    Inputs,
    PositionSample,
    Severity,
    Tick,
    WindReference,
    WindSample,
)
from firmware_py.common.reports import Water
from firmware_py.core import instruments
from firmware_py.core.instruments import InstrumentLimits, InstrumentState

WATER = Water(0.5, 0.1, current_north_m_s=0.2, current_east_m_s=-0.1, current_sd_m_s=0.1, leeway_rad=0.1)


FIX = PositionSample(1.0, FixType.FIX_3D, 0.6, 2.1, speed_over_ground_m_s=1.5, course_over_ground_rad=math.pi / 2)


def tick_inputs(t_s, **samples):
    return Inputs(Tick(0, t_s, 0.0, 0, 10.0), **samples)


def health(role, state):
    return DeviceHealth(0.0, role, state, 1, 0)


def test_velocity_is_that_of_the_fix_then_that_through_the_water_with_the_current():
    fixed = instruments.boat_motion(0.3, FIX, WATER, 0.1)
    assert (fixed.heading_rad, fixed.declination_rad) == (0.3, 0.1)
    assert (fixed.north_m_s, fixed.east_m_s) == pytest.approx((0.0, 1.5))
    expected = (0.5 * math.cos(0.4) + 0.2, 0.5 * math.sin(0.4) - 0.1)
    for fix in (None, replace(FIX, speed_over_ground_m_s=None), replace(FIX, course_over_ground_rad=None)):
        by_water = instruments.boat_motion(0.3, fix, WATER, 0.0)
        assert (by_water.north_m_s, by_water.east_m_s) == pytest.approx(expected)
    for heading_rad, water in ((None, WATER), (0.3, None)):
        unknown = instruments.boat_motion(heading_rad, None, water, 0.0)
        assert (unknown.north_m_s, unknown.east_m_s) == (0.0, 0.0)


def test_measurement_is_recent_for_fifteen_seconds():
    sample = DepthSample(10.0, 20.0)
    assert instruments.is_recent(sample, 25.0)
    assert not instruments.is_recent(sample, 25.01)
    assert not instruments.is_recent(None, 0.0)
    state = InstrumentState(depth=sample)
    assert instruments.recent_depth_m(state, 15.0) == 20.0  # for the fault
    assert instruments.recent_depth_m(state, 15.1) is None
    assert instruments.recent_depth_m(InstrumentState(), 0.0) is None
    assert instruments.recent_mean_wind_m_s(InstrumentState(), 0.0) is None
    wind = (WindSample(10.0, 6.0, 0.0, WindReference.NORTH),)
    windy = instruments.update(
        InstrumentState(), tick_inputs(10.0, wind=wind), instruments.boat_motion(None, None, None, 0.0)
    )
    assert instruments.recent_mean_wind_m_s(windy, 25.0) == pytest.approx(6.0)
    assert instruments.recent_mean_wind_m_s(windy, 25.1) is None


def test_newest_of_several_depths_is_used():
    motion = instruments.boat_motion(None, None, None, 0.0)
    both = tick_inputs(1.0, depth=(DepthSample(0.9, 20.0), DepthSample(1.0, 21.0)))
    assert instruments.update(InstrumentState(), both, motion).depth == DepthSample(1.0, 21.0)


def test_limits_are_those_of_the_parameters():
    parameters = ParameterSet().replaced("DEPTH_MIN", 12.5).replaced("WIND_MAX", 20.0)
    assert InstrumentLimits.of(parameters) == InstrumentLimits(12.5, 20.0)
    assert InstrumentLimits.of(ParameterSet()) == InstrumentLimits(0.0, 0.0)


@pytest.mark.parametrize(("role", "name"), [(DeviceRole.WIND, "Wind sensor"), (DeviceRole.DEPTH, "Depth sensor")])
@pytest.mark.parametrize("lost", [DeviceState.SILENT, DeviceState.ABSENT, DeviceState.FAULTY, DeviceState.FAILED])
def test_silence_and_recovery_are_reported(role, name, lost):
    state, events = instruments.report_silence(InstrumentState(), (health(role, DeviceState.RUNNING),), 1.0)
    assert events == ()
    state, (event,) = instruments.report_silence(state, (health(role, lost),), 1.0)
    assert (event.severity, event.text) == (Severity.WARNING, f"{name}: no data")
    state, events = instruments.report_silence(state, (health(role, lost),), 1.0)
    assert events == ()
    state, (event,) = instruments.report_silence(state, (health(role, DeviceState.RUNNING),), 1.0)
    assert (event.severity, event.text) == (Severity.NOTICE, f"{name}: data recovered")


@pytest.mark.parametrize("first", [DeviceState.ABSENT, DeviceState.STARTING, DeviceState.SILENT])
def test_sensor_that_was_never_received_is_reported_once_after_a_minute(first):
    devices = (health(DeviceRole.DEPTH, first), health(DeviceRole.COMPASS, first))
    state, events = instruments.report_silence(InstrumentState(), devices, 1.0)
    assert (events, instruments.is_expected(state)) == ((), True)
    assert instruments.report_silence(state, (), 59.9) == (state, ())
    missing, (event,) = instruments.report_silence(state, (), 60.0)
    assert (event.severity, event.text) == (Severity.WARNING, "Depth sensor: no data")
    assert not instruments.is_expected(missing)
    assert instruments.report_silence(missing, devices, 70.0) == (missing, ())
    _, (event,) = instruments.report_silence(missing, (health(DeviceRole.DEPTH, DeviceState.RUNNING),), 80.0)
    assert event.text == "Depth sensor: data recovered"
    received, events = instruments.report_silence(state, (health(DeviceRole.DEPTH, DeviceState.RUNNING),), 2.0)
    assert (events, instruments.report_silence(received, (), 60.0)) == ((), (received, ()))


@pytest.mark.parametrize(
    ("role", "name"),
    [
        (DeviceRole.RUDDER_ANGLE, "Rudder angle sensor"),
        (DeviceRole.COMPASS_B, "Compass B"),
        (DeviceRole.POWER, "Power monitor"),
        (DeviceRole.POWER_B, "Power monitor B"),
    ],
)
def test_further_device_is_reported_only_if_it_was_never_received(role, name):
    starting, running = (health(role, device_state) for device_state in (DeviceState.STARTING, DeviceState.RUNNING))
    state, events = instruments.report_silence(InstrumentState(), (starting,), 1.0)
    assert (events, instruments.is_expected(state)) == ((), True)
    missing, (event,) = instruments.report_silence(state, (), 60.0)
    assert (event.severity, event.text) == (Severity.WARNING, f"{name}: no data")
    assert instruments.report_silence(missing, (running, starting), 70.0) == (missing, ())
    for talking in (running, health(role, DeviceState.FAULTY)):
        received, events = instruments.report_silence(state, (talking,), 2.0)
        assert (events, instruments.is_expected(received)) == ((), False)
    assert instruments.report_silence(received, (health(role, DeviceState.SILENT), starting), 60.0) == (received, ())


def test_boat_without_these_sensors_reports_nothing():
    assert instruments.report_silence(InstrumentState(), (), 60.0) == (InstrumentState(), ())
