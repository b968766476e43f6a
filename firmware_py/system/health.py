"""Collects the health of devices, storage, clock, ground stations and signing key as inputs of the ticks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from firmware_py.common.interfaces import Clock, Device, Link, Recorder
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.system.store import Store

INTERVAL_S = 0.5
STATION_TIMEOUT_S = 5.0  # a ground station sends a heartbeat every second
MIN_CLOCK_STEP_S = 2.0
STEP_REPORT_S = 10.0


class ClockMonitor:
    """Compares the computer's clock with the clock of the loop, which does not jump."""

    def __init__(self) -> None:
        """Initialise without a previous comparison."""
        self._offset_s: float | None = None
        self._step_time_s = -math.inf
        self._text = ""

    def update(self, clock: Clock, now_s: float) -> DeviceHealth:
        """Compare the clocks; return FAULTY for STEP_REPORT_S after a step."""
        offset_s = clock.utc_s() - clock.now_s()
        step_s = 0.0 if self._offset_s is None else offset_s - self._offset_s
        self._offset_s = offset_s
        if abs(step_s) > MIN_CLOCK_STEP_S:
            self._step_time_s, self._text = now_s, f"the clock was stepped by {step_s:+.0f} s"
        if now_s - self._step_time_s < STEP_REPORT_S:
            return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.FAULTY, 0, 0, self._text)
        return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.RUNNING, 0, 0)


class HealthMonitor:
    """Stores the last report of each device, so that only changes are reported."""

    def __init__(self) -> None:
        """Initialise with unknown devices, valid clock and key, and no ground station."""
        self._reported: dict[DeviceRole, tuple[DeviceState, str]] = {
            DeviceRole.CLOCK: (DeviceState.RUNNING, ""),
            DeviceRole.LINK: (DeviceState.STARTING, ""),
            DeviceRole.KEY: (DeviceState.RUNNING, ""),
        }
        self._changes: tuple[DeviceHealth, ...] = ()
        self.latest: Mapping[DeviceRole, DeviceHealth] = {}  # the last report of each device
        self.blocked_threads = ""  # names of threads that wait for a blocked disk
        self._due_s = -math.inf
        self._clock = ClockMonitor()

    def update(
        self,
        devices: Sequence[Device],
        storage: tuple[Store, Recorder | None],
        clock: Clock,
        link: Link,
        now_s: float,
    ) -> None:
        """Collect the health of all devices, at most every INTERVAL_S."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + INTERVAL_S
        reports = [device.health(now_s) for device in devices]
        reports += [
            _storage_health(*storage, self.blocked_threads, now_s),
            self._clock.update(clock, now_s),
            _link_health(link, now_s),
            _key_health(link, now_s),
        ]
        self.latest = {report.role: report for report in reports}
        for report in reports:
            if self._reported.get(report.role) != (report.state, report.text):
                self._reported[report.role] = (report.state, report.text)
                self._changes += (report,)

    def take_reports(self) -> tuple[DeviceHealth, ...]:
        """Return the reports that changed since the last call."""
        changes, self._changes = self._changes, ()
        return changes


def _storage_health(store: Store, recorder: Recorder | None, blocked_threads: str, now_s: float) -> DeviceHealth:
    """Return the health of the storage: log and state store."""
    if blocked_threads:
        text = f"disk not responding: {blocked_threads}"
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, text)
    if failure := store.failure:
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, failure)
    if recorder is not None:
        return recorder.health(now_s)
    return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.RUNNING, 0, 0)


def _key_health(link: Link, now_s: float) -> DeviceHealth:
    """Return the health of the signing key, FAULTY if the key is lost."""
    state = DeviceState.FAULTY if link.key_problem else DeviceState.RUNNING
    return DeviceHealth(now_s, DeviceRole.KEY, state, 0, 0, link.key_problem)


def _link_health(link: Link, now_s: float) -> DeviceHealth:
    """Return the health of the ground stations, with the time of their last message."""
    station_s = link.station_s
    if station_s is None:
        return DeviceHealth(now_s, DeviceRole.LINK, DeviceState.STARTING, 0, 0)
    state = DeviceState.RUNNING if now_s - station_s <= STATION_TIMEOUT_S else DeviceState.SILENT
    return DeviceHealth(station_s, DeviceRole.LINK, state, 0, 0)
