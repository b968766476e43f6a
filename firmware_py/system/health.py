"""Collects the health of devices, storage, clock, ground stations and signing key; changes are inputs of a tick."""

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
        """Start without a comparison."""
        self._offset_s: float | None = None
        self._stepped_s = -math.inf
        self._text = ""

    def update(self, clock: Clock, now_s: float) -> DeviceHealth:
        """Compare the clocks; FAULTY for STEP_REPORT_S after a step."""
        offset_s = clock.utc_s() - clock.now_s()
        step_s = 0.0 if self._offset_s is None else offset_s - self._offset_s
        self._offset_s = offset_s
        if abs(step_s) > MIN_CLOCK_STEP_S:
            self._stepped_s, self._text = now_s, f"the clock was stepped by {step_s:+.0f} s"
        if now_s - self._stepped_s < STEP_REPORT_S:
            return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.FAULTY, 0, 0, self._text)
        return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.RUNNING, 0, 0)


class HealthMonitor:
    """Stores the last report of each device, so that only changes are passed on."""

    def __init__(self) -> None:
        """Start with unknown devices, a valid clock and key, and no ground station."""
        self._reported: dict[DeviceRole, tuple[DeviceState, str]] = {
            DeviceRole.CLOCK: (DeviceState.RUNNING, ""),
            DeviceRole.LINK: (DeviceState.STARTING, ""),
            DeviceRole.KEY: (DeviceState.RUNNING, ""),
        }
        self._changes: tuple[DeviceHealth, ...] = ()
        self.latest: Mapping[DeviceRole, DeviceHealth] = {}  # the last report of each, changed or not
        self.hanging = ""  # threads that wait for a hanging disk
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
        """Collect the health of all, at most every INTERVAL_S."""
        if now_s < self._due_s:
            return
        self._due_s = now_s + INTERVAL_S
        reports = [device.health(now_s) for device in devices]
        reports += [
            _storage(*storage, self.hanging, now_s),
            self._clock.update(clock, now_s),
            _link(link, now_s),
            _key(link, now_s),
        ]
        self.latest = {report.role: report for report in reports}
        for report in reports:
            if self._reported.get(report.role) != (report.state, report.text):
                self._reported[report.role] = (report.state, report.text)
                self._changes += (report,)

    def take_reports(self) -> tuple[DeviceHealth, ...]:
        """Return the changed reports since the last call."""
        changes, self._changes = self._changes, ()
        return changes


def _storage(store: Store, recorder: Recorder | None, hanging: str, now_s: float) -> DeviceHealth:
    """Return the health of the storage: log and state store."""
    if hanging:
        text = f"disk not responding: {hanging}"
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, text)
    if failure := store.failure:
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, failure)
    if recorder is not None:
        return recorder.health(now_s)
    return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.RUNNING, 0, 0)


def _key(link: Link, now_s: float) -> DeviceHealth:
    """Return the health of the signing key, FAULTY if it was lost."""
    state = DeviceState.FAULTY if link.key_problem else DeviceState.RUNNING
    return DeviceHealth(now_s, DeviceRole.KEY, state, 0, 0, link.key_problem)


def _link(link: Link, now_s: float) -> DeviceHealth:
    """Return the health of the ground stations; if silent, with the time of the last message."""
    station_s = link.station_s
    if station_s is None:
        return DeviceHealth(now_s, DeviceRole.LINK, DeviceState.STARTING, 0, 0)
    state = DeviceState.RUNNING if now_s - station_s <= STATION_TIMEOUT_S else DeviceState.SILENT
    return DeviceHealth(station_s, DeviceRole.LINK, state, 0, 0)
