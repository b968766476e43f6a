"""Reports and sample intervals of the devices; errors are reported again after ten minutes."""

import pytest
from msgspec.structs import replace

from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Severity,
    Tick,
)
from firmware_py.core.device_reports import DeviceReports, report_errors, report_failures, update
from firmware_py.core.freshness import FreshnessSettings


def health(role=DeviceRole.COMPASS, state=DeviceState.FAILED, text="driver of package acme 1.0: oh"):
    return DeviceHealth(0.0, role, state, 0, 1, text)


@pytest.mark.parametrize(
    ("role", "name"),
    [(DeviceRole.COMPASS, "Compass"), (DeviceRole.COMPASS_B, "Compass B"), (DeviceRole.RUDDER, "Rudder")],
)
def test_failure_is_reported_with_the_name_of_the_device(role, name):
    _, events = report_failures(DeviceReports(), [health(role)], 1.0)
    assert events == (Event(Severity.ERROR, f"{name}: driver of package acme 1.0: oh"),)


@pytest.mark.parametrize("state", [state for state in DeviceState if state is not DeviceState.FAILED])
def test_other_states_are_not_reported(state):
    before = DeviceReports()
    after, events = report_failures(before, [health(state=state)], 1.0)
    assert (after, events) == (before, ())


@pytest.mark.parametrize(
    ("first", "other"),
    [
        (health(), health(DeviceRole.RUDDER)),
        (health(DeviceRole.POWER, DeviceState.FAULTY), health(DeviceRole.POWER_B, DeviceState.FAULTY)),
    ],
)
def test_repeated_error_is_reported_again_after_ten_minutes(first, other):
    state, (event,) = report_errors(DeviceReports(), [first], 1.0)
    assert event.text.endswith(": driver of package acme 1.0: oh")
    assert report_errors(state, [first], 600.9) == (state, ())
    state, events = report_errors(state, [other], 600.9)
    assert len(events) == 1
    state, events = report_errors(state, [first, other], 601.0)
    assert len(events) == 1
    assert report_errors(state, [first], 602.0) == (state, ())


def test_error_of_a_power_monitor_is_a_warning_and_that_of_a_compass_a_fault():
    state, events = report_errors(DeviceReports(), [health(DeviceRole.POWER_B, DeviceState.FAULTY, "error 17")], 1.0)
    assert events == (Event(Severity.WARNING, "Power monitor: error 17"),)
    assert state.power_reported_s == (None, 1.0)
    for device in (health(DeviceRole.POWER, DeviceState.RUNNING), health(DeviceRole.COMPASS, DeviceState.FAULTY)):
        assert report_errors(state, [device], 1.0) == (state, ())


def inputs(t_s, **samples):
    return Inputs(Tick(0, t_s, 0.0, 0, 10.0), **samples)


def test_last_reports_times_and_intervals_are_those_of_each_device():
    settings = FreshnessSettings(heading_timeout_s=1.0, position_timeout_s=4.0, rudder_timeout_s=2.0)
    reports = {role: health(role, DeviceState.RUNNING) for role in DeviceRole}
    former = DeviceReports(power_reported_s=(1.0, None), failures_s=((DeviceRole.AIS, 2.0),))
    assert update(settings, former, inputs(0.0)) is former
    state = update(settings, former, inputs(0.0, devices=tuple(reports.values())))
    kept = {name: reports[DeviceRole[name.upper()]] for name in ("storage", "clock", "link", "key", "rudder")}
    assert state == replace(former, **kept)
    for t_s in (10.0, 11.5):
        headings = tuple(HeadingSample(t_s + b, 1.0, NorthReference.TRUE, source=b) for b in (0, 1))
        state = update(settings, state, inputs(t_s, headings=headings[:1]))
        state = update(settings, state, inputs(t_s, headings=headings[1:]))
        state = update(settings, state, inputs(t_s, positions=(PositionSample(5.0 * t_s, FixType.FIX_3D, 0.1, 0.1),)))
        state = update(settings, state, inputs(t_s, rudder=(RudderFeedback(2.0 * t_s),)))
    assert state == replace(
        former,
        **kept,
        compass_s=(11.5, 12.5),
        compass_interval_s=(1.5, 1.5),
        position_s=57.5,
        position_interval_s=7.5,
        rudder_s=23.0,
        rudder_interval_s=3.0,
    )
