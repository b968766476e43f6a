"""Wind sensor and echo sounder in a tick: last measurements, limits of the faults, and reports of silent sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    DepthSample,
    DeviceHealth,
    DeviceRole,
    DeviceState,
    Event,
    Inputs,
    PositionSample,
    Severity,
)
from firmware_py.common.reports import Water, Wind
from firmware_py.estimate import wind
from firmware_py.estimate.wind import Motion, WindState

MAX_AGE_S: Final = 15.0  # of a measurement
# Of a depth for its fault: shorter than its debounce time, because in deep water a false echo may be the last one.
MAX_FAULT_AGE_S: Final = 5.0
MISSING_AFTER_S: Final = 60.0  # after the start, for a sensor that has never been received
_ROLES: Final = (
    *(DeviceRole.WIND, DeviceRole.DEPTH),
    *(DeviceRole.RUDDER_ANGLE, DeviceRole.COMPASS_B, DeviceRole.POWER, DeviceRole.POWER_B),
)
_NAMES: Final = (
    *("Wind sensor", "Depth sensor"),
    *("Rudder angle sensor", "Compass B", "Power monitor", "Power monitor B"),
)
_LOST: Final = (DeviceState.SILENT, DeviceState.ABSENT, DeviceState.FAULTY, DeviceState.FAILED)


class InstrumentLimits(msgspec.Struct, frozen=True):
    """Limits of the faults WATER_SHALLOW and WIND_STRONG; 0: no limit."""

    depth_min_m: float
    wind_max_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> InstrumentLimits:
        """Read the settings from the parameters."""
        return cls(depth_min_m=parameters["DEPTH_MIN"], wind_max_m_s=parameters["WIND_MAX"])


class Reception(IntEnum):
    """Reception of a sensor."""

    NEVER = 0  # nothing is known of the sensor; usually the boat has none
    RECEIVED = 1
    SILENT = 2  # reported as without data
    EXPECTED = 3  # the boat has it, but it has not been received yet


class InstrumentState(msgspec.Struct, frozen=True):
    """Wind with its means, last depth, and the reception of wind sensor and echo sounder.

    `others` is the reception of the further _ROLES until they are received; later silence is a fault or a change of the
    source of the rudder angle (core/rudder.py).
    """

    wind: WindState = WindState()
    depth: DepthSample | None = None
    reception: tuple[Reception, Reception] = (Reception.NEVER, Reception.NEVER)
    others: tuple[Reception, ...] = 4 * (Reception.NEVER,)


def boat_motion(
    heading_rad: float | None, fix: PositionSample | None, water: Water | None, declination_rad: float
) -> Motion:
    """Return the motion of the boat; `fix` and `water` are None while they are unknown or old.

    The velocity is that of the fix, otherwise speed through the water and current, otherwise 0.
    """
    if fix is not None and fix.speed_over_ground_m_s is not None and fix.course_over_ground_rad is not None:
        speed_m_s, course_rad = fix.speed_over_ground_m_s, fix.course_over_ground_rad
        return Motion(heading_rad, speed_m_s * math.cos(course_rad), speed_m_s * math.sin(course_rad), declination_rad)
    if water is None or heading_rad is None:
        return Motion(heading_rad, 0.0, 0.0, declination_rad)
    course_rad = heading_rad + water.leeway_rad
    return Motion(
        heading_rad,
        water.speed_m_s * math.cos(course_rad) + water.current_north_m_s,
        water.speed_m_s * math.sin(course_rad) + water.current_east_m_s,
        declination_rad,
    )


def update(state: InstrumentState, inputs: Inputs, motion: Motion) -> InstrumentState:
    """Return the state after the samples of a tick."""
    if inputs.depth:
        state = replace(state, depth=inputs.depth[-1])
    if inputs.wind:
        state = replace(state, wind=wind.update(state.wind, inputs.wind, motion))
    return state


def report_silence(
    state: InstrumentState, devices: Sequence[DeviceHealth], now_s: float
) -> tuple[InstrumentState, tuple[Event, ...]]:
    """Return the state and the events of sensors that stop or resume.

    A sensor that has never been received is reported MISSING_AFTER_S after the start; `now_s` is the time since then.
    """
    reception, events = [*state.reception, *state.others], []
    for device in devices:
        if device.role not in _ROLES:
            continue
        number = _ROLES.index(device.role)
        if number >= len(state.reception):
            if reception[number] in (Reception.NEVER, Reception.EXPECTED):
                is_missing = device.state not in (DeviceState.RUNNING, DeviceState.FAULTY)
                reception[number] = Reception.EXPECTED if is_missing else Reception.RECEIVED
            continue
        if device.state is DeviceState.RUNNING:
            if reception[number] is Reception.SILENT:
                events.append(Event(Severity.NOTICE, f"{_NAMES[number]}: data recovered"))
            reception[number] = Reception.RECEIVED
        elif device.state in _LOST and reception[number] is Reception.RECEIVED:
            events.append(Event(Severity.WARNING, f"{_NAMES[number]}: no data"))
            reception[number] = Reception.SILENT
        elif reception[number] is Reception.NEVER:
            reception[number] = Reception.EXPECTED
    for number, name in enumerate(_NAMES):
        if reception[number] is Reception.EXPECTED and now_s >= MISSING_AFTER_S:
            events.append(Event(Severity.WARNING, f"{name}: no data"))
            reception[number] = Reception.SILENT
    if reception == [*state.reception, *state.others]:
        return state, ()
    return replace(state, reception=(reception[0], reception[1]), others=tuple(reception[2:])), tuple(events)


def is_expected(state: InstrumentState) -> bool:
    """Return whether a sensor that the boat has is still to be received for the first time."""
    return Reception.EXPECTED in state.reception or Reception.EXPECTED in state.others


def is_recent(measurement: Wind | DepthSample | None, now_s: float) -> bool:
    """Return whether there is a measurement that is not older than MAX_AGE_S."""
    return measurement is not None and now_s - measurement.t_s <= MAX_AGE_S


def recent_mean_wind_m_s(state: InstrumentState, now_s: float) -> float | None:
    """Return the mean wind speed; None if it is unknown or old."""
    report = state.wind.report
    return report.mean_m_s if report is not None and is_recent(report, now_s) else None


def recent_depth_m(state: InstrumentState, now_s: float) -> float | None:
    """Return the water depth; None if it is unknown or older than MAX_FAULT_AGE_S."""
    sample = state.depth
    return sample.depth_m if sample is not None and now_s - sample.t_s <= MAX_FAULT_AGE_S else None
