"""Health of clock, devices, storage, link and key: changes are reported once."""

from types import SimpleNamespace

import pytest

from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.system.health import ClockMonitor, HealthMonitor

STATION_TIMEOUT_S = 5.0
STEP_REPORT_S = 10.0

RUNNING, FAULTY, SILENT = DeviceState.RUNNING, DeviceState.FAULTY, DeviceState.SILENT


def make_clock(offset_s=0.0):
    return SimpleNamespace(utc_s=lambda: offset_s, now_s=lambda: 0.0)


@pytest.mark.parametrize(("step_s", "state"), [(2.0, RUNNING), (-2.0, RUNNING), (2.001, FAULTY), (-2.001, FAULTY)])
def test_a_step_of_the_clock_is_reported_for_a_time(step_s, state):
    monitor = ClockMonitor()
    assert monitor.update(make_clock(), 0.0).state is RUNNING
    health = monitor.update(make_clock(step_s), 1.0)
    text = f"the clock was stepped by {step_s:+.0f} s" if state is FAULTY else ""
    assert health == DeviceHealth(1.0, DeviceRole.CLOCK, state, 0, 0, text)
    assert monitor.update(make_clock(step_s), 0.9 + STEP_REPORT_S).state is state
    assert monitor.update(make_clock(step_s), 1.0 + STEP_REPORT_S).state is RUNNING


class Boat:
    def __init__(self):
        self.monitor = HealthMonitor()
        self.compass_state = RUNNING
        self.store = SimpleNamespace(failure="")
        self.link = SimpleNamespace(key_problem="", station_s=None)

    def health(self, now_s):
        return DeviceHealth(now_s, DeviceRole.COMPASS, self.compass_state, 0, 0)

    def update(self, now_s):
        """Update the monitor; return role, state and text of the reports."""
        self.monitor.update([self], (self.store, None), make_clock(), self.link, now_s)
        return [(report.role, report.state, report.text) for report in self.monitor.take_reports()]


def test_changes_are_reported_once_and_at_intervals():
    boat = Boat()
    assert boat.update(0.0) == [(DeviceRole.COMPASS, RUNNING, ""), (DeviceRole.STORAGE, RUNNING, "")]
    link, storage = (boat.monitor.latest[role] for role in (DeviceRole.LINK, DeviceRole.STORAGE))
    assert link == DeviceHealth(0.0, DeviceRole.LINK, DeviceState.STARTING, 0, 0)
    assert storage == DeviceHealth(0.0, DeviceRole.STORAGE, RUNNING, 0, 0)
    boat.compass_state = SILENT
    assert boat.update(0.4) == []
    assert boat.update(0.5) == [(DeviceRole.COMPASS, SILENT, "")]
    assert boat.update(1.0) == []
    assert boat.monitor.latest[DeviceRole.COMPASS].state is SILENT


def test_failures_of_storage_and_key_and_a_silent_station_are_reported():
    boat = Boat()
    boat.update(0.0)
    boat.store.failure = "a cannot be stored"
    boat.link.key_problem = "the signing key is lost"
    boat.link.station_s = 1.0
    assert boat.update(1.0) == [
        (DeviceRole.STORAGE, FAULTY, "a cannot be stored"),
        (DeviceRole.LINK, RUNNING, ""),
        (DeviceRole.KEY, FAULTY, "the signing key is lost"),
    ]
    storage = boat.monitor.latest[DeviceRole.STORAGE]
    assert storage == DeviceHealth(1.0, DeviceRole.STORAGE, FAULTY, 0, 1, "a cannot be stored")
    boat.monitor.blocked_threads = "log"
    assert boat.update(1.0 + STATION_TIMEOUT_S) == [(DeviceRole.STORAGE, FAULTY, "disk not responding: log")]
    assert boat.update(1.5 + STATION_TIMEOUT_S) == [(DeviceRole.LINK, SILENT, "")]
    assert boat.monitor.latest == {
        DeviceRole.COMPASS: DeviceHealth(6.5, DeviceRole.COMPASS, RUNNING, 0, 0),
        DeviceRole.STORAGE: DeviceHealth(6.5, DeviceRole.STORAGE, FAULTY, 0, 1, "disk not responding: log"),
        DeviceRole.CLOCK: DeviceHealth(6.5, DeviceRole.CLOCK, RUNNING, 0, 0),
        DeviceRole.LINK: DeviceHealth(1.0, DeviceRole.LINK, SILENT, 0, 0),
        DeviceRole.KEY: DeviceHealth(6.5, DeviceRole.KEY, FAULTY, 0, 0, "the signing key is lost"),
    }
