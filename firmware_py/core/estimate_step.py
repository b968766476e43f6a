"""The estimates of a tick, in their order: rudder, position, heading with the water, home."""

from __future__ import annotations

import math
from typing import Final

from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Event, Inputs, PositionSample, RudderStatus, Severity
from firmware_py.common.reports import Home
from firmware_py.core import device_reports, last_place, rudder, tick_timing
from firmware_py.core.state import Settings, State, heading_timeouts_of
from firmware_py.estimate import dead_reckoning, heading_estimator, place_and_velocity, position, water
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.sources import Source
from firmware_py.modes import PositionGoal

MOVED_SHARE: Final = 0.5  # of the error of the first place: what is nearer to it was derived from it


def estimate(settings: Settings, state: State, inputs: Inputs) -> tuple[State, RudderStatus, tuple[Event, ...]]:
    """Take samples, feedback, device reports and the tick itself in; return what is known of the rudder, too."""
    now_s = inputs.tick.t_s
    rudder_state, rudder_status = rudder.update(settings.rudder, state.rudder, inputs)
    # As known before this tick: a gap must not excuse itself.
    timeouts = heading_timeouts_of(settings, state.devices)
    heading, in_use = state.heading_estimator.heading, Source(state.heading_estimator.tick.sources.in_use)
    heading_rad = heading.heading_rad if heading.fresh(now_s, timeouts.of(in_use)) else None
    place = _carried_on(state, now_s, heading_rad, timeouts.position_s)
    agreement = state.agreement
    credible: list[PositionSample] = []
    told: list[Event] = []
    for sample in inputs.positions:
        if state.modes.armed and place_and_velocity.hangs(agreement, sample):
            agreement, odd = place_and_velocity.update(agreement, sample, afloat=True)
            told += odd
            continue
        before = place
        place, good = position.update(place, sample, settings.position.jump_s)
        if good:
            credible.append(sample)
            if (leap_m := position.leap_m(before, sample)) is not None:
                told.append(Event(Severity.WARNING, f"Position believed where it jumped to: {leap_m:.0f} m off"))
            elif state.modes.armed:
                told += _found_again(before, sample)
            agreement, odd = place_and_velocity.update(agreement, sample, afloat=state.modes.armed)
            told += odd
            if state.home is None:
                state = replace(state, home=_home_at(place.begun))
            elif (wrong := position.withdrawn(before, place)) is not None:
                state, found = _taken_again(state, wrong, sample)
                told += found
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
    )
    return state, rudder_status, (*told, *events, *device_events)


def _rudder_of_estimate_rad(rudder: RudderStatus) -> float:
    """Return the rudder angle that the estimate takes; NaN for a servo without torque and without a measured angle."""
    return math.nan if not rudder.measured and rudder.torque_on is False else rudder.angle_rad


def _carried_on(state: State, now_s: float, heading_rad: float | None, silent_s: float) -> PositionState:
    """Return the place carried on to now, reckoned by the last known water when fixes are missing for silent_s."""
    place, known = state.position, state.heading_estimator.water
    if place.fix is None and place.dead_reckoning is None:
        return place
    if state.timing.started_s is None and place.dead_reckoning is not None:
        place = last_place.counted_from(place, now_s)
    if place.fix is not None and place.dead_reckoning is None and now_s - place.fix.t_s > silent_s:
        place = replace(place, dead_reckoning=dead_reckoning.begin(known, now_s))
    if place.dead_reckoning is None:
        velocity_m_s = water.over_ground_m_s(known, math.nan if heading_rad is None else heading_rad)
        return position.predict(place, now_s, velocity_m_s)
    step_s = max(0.0, now_s - place.t_s)
    sailed, over_ground_m_s = dead_reckoning.sail(
        place.dead_reckoning, heading_rad, step_s, under_way=state.modes.armed
    )
    return position.predict(replace(place, dead_reckoning=sailed), now_s, over_ground_m_s)


def _found_again(before: PositionState, fix: PositionSample) -> tuple[Event, ...]:
    """Return what is told when a fix ends a reckoning that was more than a gap."""
    unfixed_s = position.unfixed_s(before) + fix.t_s - before.t_s
    if before.dead_reckoning is None or unfixed_s <= position.LONGEST_GAP_S:
        return ()
    minutes, off_m = unfixed_s / 60.0, position.off_m(before, fix)
    return (Event(Severity.NOTICE, f"Reckoned for {minutes:.0f} min: she was {off_m:.0f} m off"),)


def _taken_again(state: State, wrong: PositionSample, right: PositionSample) -> tuple[State, tuple[Event, ...]]:
    """Return the state without what was derived from a first place that has proved wrong, and what is reported.

    Home and the goal move along if they lie near the wrong place. Water and tasks of the modes, as the loiter point,
    are taken again at the place of now; so is the margin to the fence, as after each move.
    """
    first, place = position.place_of(wrong), position.place_of(right)
    off_m, _ = first.distance_and_bearing(place)

    def moved(latitude_rad: float, longitude_rad: float) -> Place | None:
        other = Place(latitude_rad, longitude_rad)
        near = first.distance_and_bearing(other)[0] < MOVED_SHARE * off_m
        return place.at_offset(*first.offset_m(other)) if near else None

    home, modes, goal = state.home, state.modes, state.modes.goal
    if home is not None and (there := moved(home.latitude_rad, home.longitude_rad)) is not None:
        home = Home(there.latitude_rad, there.longitude_rad, right.altitude_m or 0.0)
    if isinstance(goal, PositionGoal) and (there := moved(goal.latitude_rad, goal.longitude_rad)) is not None:
        modes = replace(modes, goal=PositionGoal(there.latitude_rad, there.longitude_rad))
    expected = state.heading_estimator.water.expected
    state = replace(
        state,
        home=home,
        modes=modes,
        guidance=replace(state.guidance, mode=None),  # it enters the mode again
        heading_estimator=heading_estimator.expecting(state.heading_estimator, expected),
    )
    text = f"First position was {1e-3 * off_m:.1f} km off: home and tasks move"
    return state, (Event(Severity.WARNING, text),)


def _home_at(sample: PositionSample | None) -> Home | None:
    if sample is None or sample.latitude_rad is None or sample.longitude_rad is None:
        return None
    return Home(sample.latitude_rad, sample.longitude_rad, sample.altitude_m or 0.0)
