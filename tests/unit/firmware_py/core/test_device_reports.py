"""Failed drivers of packages: one event for each device, repeated after ten minutes."""

import pytest

from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, Event, Severity
from firmware_py.core.device_reports import DeviceReports, report_failures


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


def test_repeated_failure_is_reported_again_after_ten_minutes():
    state, _ = report_failures(DeviceReports(), [health()], 1.0)
    state, events = report_failures(state, [health()], 600.9)
    assert events == ()
    state, events = report_failures(state, [health(DeviceRole.RUDDER)], 601.0)
    assert len(events) == 1
    state, events = report_failures(state, [health()], 601.0)
    assert len(events) == 1
    _, events = report_failures(state, [health()], 602.0)
    assert events == ()
