"""Asks devices, storage, clock, stations and signing key for their health; a change is an input of the next tick."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from firmware_py.common.interfaces import Clock, Device, Link, Recorder
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState
from firmware_py.system.store import Store

INTERVAL_S = 0.5
STATION_S = 5.0  # a ground station says something every second
STEP_S = 2.0
STEP_SHOWN_S = 10.0


class ClockMonitor:
    """Compares the computer's clock with the loop's, which never jumps."""

    def __init__(self) -> None:
        """Start with nothing compared."""
        self._offset_s: float | None = None
        self._stepped_s = -math.inf
        self._text = ""

    def update(self, clock: Clock, now_s: float) -> DeviceHealth:
        """Compare now; FAULTY for a while after a step."""
        offset_s = clock.utc_s() - clock.now_s()
        step_s = 0.0 if self._offset_s is None else offset_s - self._offset_s
        self._offset_s = offset_s
        if abs(step_s) > STEP_S:
            self._stepped_s, self._text = now_s, f"the clock was stepped by {step_s:+.0f} s"
        if now_s - self._stepped_s < STEP_SHOWN_S:
            return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.FAULTY, 0, 0, self._text)
        return DeviceHealth(now_s, DeviceRole.CLOCK, DeviceState.RUNNING, 0, 0)


class HealthMonitor:
    """Remembers what each has reported, so that only changes are handed on."""

    def __init__(self) -> None:
        """Start with nothing known of the devices, a clock that runs and nobody heard."""
        self._reported: dict[DeviceRole, tuple[DeviceState, str]] = {
            DeviceRole.CLOCK: (DeviceState.RUNNING, ""),
            DeviceRole.LINK: (DeviceState.STARTING, ""),
            DeviceRole.KEY: (DeviceState.RUNNING, ""),
        }
        self._changes: tuple[DeviceHealth, ...] = ()
        self.latest: Mapping[DeviceRole, DeviceHealth] = {}  # what each said last, changed or not
        self.hanging = ""  # which threads wait for the disk in vain
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
        """Ask each for its health, at most every INTERVAL_S."""
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
        """Hand over what has changed."""
        changes, self._changes = self._changes, ()
        return changes


def _storage(store: Store, recorder: Recorder | None, hanging: str, now_s: float) -> DeviceHealth:
    """The log and the store as one device: what fails of either is a fault of the storage."""
    if hanging:
        text = f"the disk does not answer: {hanging}"
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, text)
    if failure := store.failure:
        return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.FAULTY, 0, 1, failure)
    if recorder is not None:
        return recorder.health(now_s)
    return DeviceHealth(now_s, DeviceRole.STORAGE, DeviceState.RUNNING, 0, 0)


def _key(link: Link, now_s: float) -> DeviceHealth:
    """The signing key as a device, which is at fault when it was lost."""
    state = DeviceState.FAULTY if link.key_problem else DeviceState.RUNNING
    return DeviceHealth(now_s, DeviceRole.KEY, state, 0, 0, link.key_problem)


def _link(link: Link, now_s: float) -> DeviceHealth:
    """The ground stations as one device; the record of a silent one is of when it was last heard."""
    station_s = link.station_s
    if station_s is None:
        return DeviceHealth(now_s, DeviceRole.LINK, DeviceState.STARTING, 0, 0)
    state = DeviceState.RUNNING if now_s - station_s <= STATION_S else DeviceState.SILENT
    return DeviceHealth(station_s, DeviceRole.LINK, state, 0, 0)
