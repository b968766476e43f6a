"""Last health reports of the devices, and intervals of their samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.absence import or_nan
from firmware_py.common.records import DeviceHealth, DeviceRole, DeviceState, Event, Inputs, Severity
from firmware_py.common.sample_timeout import learn_interval_s
from firmware_py.core.freshness import FreshnessSettings

Times = tuple[float | None, float | None]
REPEAT_INTERVAL_S: Final = 600.0  # between reports of the same charger error or failed driver
_POWER: Final = (DeviceRole.POWER, DeviceRole.POWER_B)


class DeviceReports(msgspec.Struct, frozen=True):
    """Last health of storage, clock, links, signing key and servo; times and intervals of the samples.

    `compass_s` and `compass_interval_s` are those of compass A and B; an interval is None until the second sample.
    `power_reported_s` is the time of the last reported error of power monitors A and B, `failures_s` that of the last
    reported failure of the driver of each device.
    """

    storage: DeviceHealth | None = None
    clock: DeviceHealth | None = None
    link: DeviceHealth | None = None
    compass_s: Times = (None, None)
    compass_interval_s: Times = (None, None)
    position_s: float | None = None
    position_interval_s: float | None = None
    rudder_s: float | None = None
    rudder_interval_s: float | None = None
    key: DeviceHealth | None = None
    rudder: DeviceHealth | None = None
    power_reported_s: Times = (None, None)
    failures_s: tuple[tuple[DeviceRole, float], ...] = ()


def update(settings: FreshnessSettings, state: DeviceReports, inputs: Inputs) -> DeviceReports:
    """Return the state updated with the reports and samples of a tick."""
    if not (inputs.headings or inputs.positions or inputs.rudder or inputs.devices):
        return state
    storage, clock, link, key, rudder = state.storage, state.clock, state.link, state.key, state.rudder
    for device in inputs.devices:
        storage = device if device.role is DeviceRole.STORAGE else storage
        clock = device if device.role is DeviceRole.CLOCK else clock
        link = device if device.role is DeviceRole.LINK else link
        key = device if device.role is DeviceRole.KEY else key
        rudder = device if device.role is DeviceRole.RUDDER else rudder
    a_s, b_s = state.compass_s
    a_interval_s, b_interval_s = state.compass_interval_s
    for sample in inputs.headings:
        if sample.source == 0:
            a_s, a_interval_s = _sample_times(a_s, a_interval_s, sample.t_s, settings.heading_timeout_s)
        else:
            b_s, b_interval_s = _sample_times(b_s, b_interval_s, sample.t_s, settings.heading_timeout_s)
    position_s, position_interval_s = state.position_s, state.position_interval_s
    for fix in inputs.positions:
        position_s, position_interval_s = _sample_times(
            position_s, position_interval_s, fix.t_s, settings.position_timeout_s
        )
    rudder_s, rudder_interval_s = state.rudder_s, state.rudder_interval_s
    for feedback in inputs.rudder:
        rudder_s, rudder_interval_s = _sample_times(
            rudder_s, rudder_interval_s, feedback.t_s, settings.rudder_timeout_s
        )
    return DeviceReports(
        storage,
        clock,
        link,
        (a_s, b_s),
        (a_interval_s, b_interval_s),
        position_s,
        position_interval_s,
        rudder_s,
        rudder_interval_s,
        key,
        rudder,
        state.power_reported_s,
        state.failures_s,
    )


def report_errors(
    state: DeviceReports, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[DeviceReports, tuple[Event, ...]]:
    """Return the state and the events of faulty power monitors and of failed drivers."""
    if not devices:
        return state, ()
    state, power_events = _report_power(state, devices, now_s)
    state, failure_events = report_failures(state, devices, now_s)
    return state, (*power_events, *failure_events)


def _report_power(
    state: DeviceReports, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[DeviceReports, tuple[Event, ...]]:
    """Return the state and the events of faulty power monitors, for each at most one in REPEAT_INTERVAL_S."""
    reported_s, events = list(state.power_reported_s), []
    for device in devices:
        if device.role in _POWER and device.state is DeviceState.FAULTY:
            number = _POWER.index(device.role)
            previous_s = reported_s[number]
            if previous_s is None or now_s - previous_s >= REPEAT_INTERVAL_S:
                reported_s[number] = now_s
                events.append(Event(Severity.WARNING, f"Power monitor: {device.text}"))
    return (replace(state, power_reported_s=(reported_s[0], reported_s[1])) if events else state), tuple(events)


def report_failures(
    state: DeviceReports, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[DeviceReports, tuple[Event, ...]]:
    """Return the state and the events of failed drivers, for each device at most one in REPEAT_INTERVAL_S."""
    failed = [device for device in devices if device.state is DeviceState.FAILED]
    if not failed:
        return state, ()
    reported_s, events = dict(state.failures_s), []
    for device in failed:
        previous_s = reported_s.get(device.role)
        if previous_s is None or now_s - previous_s >= REPEAT_INTERVAL_S:
            reported_s[device.role] = now_s
            name = device.role.name.replace("_", " ").capitalize().replace(" b", " B")
            events.append(Event(Severity.ERROR, f"{name}: {device.text}"))
    return replace(state, failures_s=tuple(reported_s.items())), tuple(events)


def _sample_times(
    last_s: float | None, interval_s: float | None, t_s: float, min_timeout_s: float
) -> tuple[float, float | None]:
    """Return the time of a sample at t_s, and the learned sample interval."""
    return t_s, interval_s if last_s is None else learn_interval_s(or_nan(interval_s), t_s - last_s, min_timeout_s)
