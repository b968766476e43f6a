"""The estimates of a tick, in their order: rudder, position, heading with the water, home."""

from __future__ import annotations

import math
from typing import Final

from msgspec.structs import replace

from firmware_py.common.records import Event, Inputs, PositionSample, RudderStatus, Severity
from firmware_py.common.reports import Home
from firmware_py.core import device_reports, last_place, rudder, tick_timing
from firmware_py.core.state import Settings, State, heading_timeouts_of
from firmware_py.estimate import heading_estimator, place_and_velocity, position, reckoning, water
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.sources import Source

FIRST_PLACE_S: Final = 1800.0  # for so long a receiver's first place may prove wrong


def estimate(settings: Settings, state: State, inputs: Inputs) -> tuple[State, RudderStatus, tuple[Event, ...]]:
    """Take samples, feedback, device reports and the tick itself in; return what is known of the rudder, too."""
    now_s = inputs.tick.t_s
    rudder_state, rudder_status = rudder.update(settings.rudder, state.rudder, inputs)
    # As known before this tick: a gap must not excuse itself.
    timeouts = heading_timeouts_of(settings, state.devices)
    heading, in_use = state.heading_estimator.heading, Source(state.heading_estimator.tick.sources.in_use)
    heading_rad = heading.heading_rad if heading.fresh(now_s, timeouts.of(in_use)) else None
    place = _carried_on(state, now_s, heading_rad, timeouts.position_s)
    home = state.home
    agreement = state.agreement
    credible: list[PositionSample] = []
    told: list[Event] = []
    for sample in inputs.positions:
        if state.modes.armed and place_and_velocity.hangs(agreement, sample):
            agreement, odd = place_and_velocity.update(agreement, sample, afloat=True)
            told += odd
            continue
        before, begun = place, place.begun
        place, good = position.update(place, sample, settings.position.jump_s)
        if good:
            credible.append(sample)
            if (leap_m := position.leap_m(before, sample)) is not None:
                told.append(Event(Severity.WARNING, f"Position believed where it jumped to: {leap_m:.0f} m off"))
            elif state.modes.armed:
                told += _found_again(before, sample)
            agreement, odd = place_and_velocity.update(agreement, sample, afloat=state.modes.armed)
            told += odd
            home = _home(home, begun, place.begun)
    heading_state, events = heading_estimator.update(
        settings.heading_estimator,
        state.heading_estimator,
        inputs.headings,
        credible,
        _rudder_of_estimate_rad(rudder_status),
        timeouts,
        now_s,
    )
    devices, device_events = device_reports.tell_power(
        device_reports.update(settings.freshness, state.devices, inputs), inputs.devices, now_s
    )
    state = replace(
        state,
        timing=tick_timing.update(state.timing, inputs.tick),
        devices=devices,
        rudder=rudder_state,
        heading_estimator=heading_state,
        position=place,
        agreement=agreement,
        home=home,
    )
    return state, rudder_status, (*told, *events, *device_events)


def _rudder_of_estimate_rad(rudder: RudderStatus) -> float:
    """Return the rudder angle that the estimate takes; NaN for a servo without torque and without a measured angle."""
    return math.nan if not rudder.measured and rudder.torque_on is False else rudder.angle_rad


def _carried_on(state: State, now_s: float, heading_rad: float | None, silent_s: float) -> PositionState:
    """Return the place carried on to now, reckoned by the last known water when fixes are missing for silent_s."""
    place, known = state.position, state.heading_estimator.water
    if place.fix is None and place.reckoning is None:
        return place
    if state.timing.started_s is None and place.reckoning is not None:
        place = last_place.counted_from(place, now_s)
    if place.fix is not None and place.reckoning is None and now_s - place.fix.t_s > silent_s:
        place = replace(place, reckoning=reckoning.begin(known, now_s))
    if place.reckoning is None:
        velocity_m_s = water.over_ground_m_s(known, math.nan if heading_rad is None else heading_rad)
        return position.predict(place, now_s, velocity_m_s)
    step_s = max(0.0, now_s - place.t_s)
    sailed, over_ground_m_s = reckoning.sail(place.reckoning, heading_rad, step_s, under_way=state.modes.armed)
    return position.predict(replace(place, reckoning=sailed), now_s, over_ground_m_s)


def _found_again(before: PositionState, fix: PositionSample) -> tuple[Event, ...]:
    """Return what is told when a fix ends a reckoning that was more than a gap."""
    unfixed_s = position.unfixed_s(before) + fix.t_s - before.t_s
    if before.reckoning is None or unfixed_s <= position.LONGEST_GAP_S:
        return ()
    minutes, off_m = unfixed_s / 60.0, position.off_m(before, fix)
    return (Event(Severity.NOTICE, f"Reckoned for {minutes:.0f} min: she was {off_m:.0f} m off"),)


def _home(home: Home | None, before: PositionSample | None, begun: PositionSample | None) -> Home | None:
    """Return home after a fix: the first one since start, until home is set.

    A receiver that has just been switched on may be sure of a place where it is not: when the first one proves wrong
    soon, home goes along.
    """
    if home is None:
        return _home_at(begun)
    if before is begun or before is None or begun is None or begun.t_s - before.t_s > FIRST_PLACE_S:
        return home
    return _home_at(begun) if home == _home_at(before) else home


def _home_at(sample: PositionSample | None) -> Home | None:
    if sample is None or sample.latitude_rad is None or sample.longitude_rad is None:
        return None
    return Home(sample.latitude_rad, sample.longitude_rad, sample.altitude_m or 0.0)
