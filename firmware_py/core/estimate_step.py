"""Estimates of a tick: rudder, position, home, and heading with water."""

from __future__ import annotations

import math
from typing import Final

from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Event, Inputs, PositionSample, RudderStatus, Severity
from firmware_py.common.reports import Home
from firmware_py.core import device_reports, last_position, rudder, tick_timing
from firmware_py.core.state import Settings, State, heading_timeouts_of
from firmware_py.estimate import dead_reckoning, heading_estimator, position, position_consistency, water
from firmware_py.estimate.position import PositionState
from firmware_py.estimate.sources import Source
from firmware_py.modes import PositionGoal

# Home and goal are moved with a wrong first position if they are nearer to it than this fraction of its error.
MOVED_DISTANCE_FRACTION: Final = 0.5


def estimate(settings: Settings, state: State, inputs: Inputs) -> tuple[State, RudderStatus, tuple[Event, ...]]:
    """Update all estimates with the inputs of a tick; return state, rudder status and events."""
    now_s = inputs.tick.t_s
    rudder_state, rudder_status = rudder.update(settings.rudder, state.rudder, inputs)
    # The intervals of this tick are not included: a gap must not extend its own time-out.
    timeouts = heading_timeouts_of(settings, state.devices)
    heading, source = state.heading_estimator.heading, Source(state.heading_estimator.tick.sources.in_use)
    heading_rad = heading.heading_rad if heading.is_fresh(now_s, timeouts.of(source)) else None
    position_state = _predict_position(state, now_s, heading_rad, timeouts.position_s)
    consistency = state.agreement
    accepted_fixes: list[PositionSample] = []
    events: list[Event] = []
    for sample in inputs.positions:
        if state.modes.armed and position_consistency.is_stuck(consistency, sample):
            consistency, consistency_events = position_consistency.update(consistency, sample, is_armed=True)
            events += consistency_events
            continue
        previous = position_state
        position_state, is_accepted = position.update(position_state, sample, settings.position.jump_s)
        if is_accepted:
            accepted_fixes.append(sample)
            if (jump_m := position.accepted_jump_m(previous, sample)) is not None:
                events.append(Event(Severity.WARNING, f"GPS jump accepted: position moved by {jump_m:.0f} m"))
            elif state.modes.armed:
                events += _fix_events(previous, sample)
            consistency, consistency_events = position_consistency.update(
                consistency, sample, is_armed=state.modes.armed
            )
            events += consistency_events
            if state.home is None:
                state = replace(state, home=_home_at(sample))
            elif (wrong_fix := position.find_wrong_first_fix(previous, position_state)) is not None:
                state, correction_events = _correct_first_position(state, wrong_fix, sample)
                events += correction_events
    heading_state, heading_events = heading_estimator.update(
        settings.heading_estimator,
        state.heading_estimator,
        inputs.headings,
        accepted_fixes,
        _rudder_for_estimator_rad(rudder_status),
        timeouts,
        now_s,
    )
    devices, device_events = device_reports.report_errors(
        device_reports.update(settings.freshness, state.devices, inputs), inputs.devices, now_s
    )
    state = replace(
        state,
        timing=tick_timing.update(state.timing, inputs.tick),
        devices=devices,
        rudder=rudder_state,
        heading_estimator=heading_state,
        position=position_state,
        agreement=consistency,
    )
    return state, rudder_status, (*events, *heading_events, *device_events)


def _rudder_for_estimator_rad(rudder: RudderStatus) -> float:
    """Return the rudder angle for the estimator; NaN if it is not measured and the servo has no torque."""
    return math.nan if not rudder.measured and rudder.torque_on is False else rudder.angle_rad


def _predict_position(state: State, now_s: float, heading_rad: float | None, timeout_s: float) -> PositionState:
    """Return the position predicted to now_s; by dead reckoning if the last fix is older than timeout_s."""
    position_state, water_state = state.position, state.heading_estimator.water
    if position_state.fix is None and position_state.dead_reckoning is None:
        return position_state
    if state.timing.started_s is None:
        position_state = last_position.with_first_tick(position_state, now_s)
    if (
        position_state.fix is not None
        and position_state.dead_reckoning is None
        and now_s - position_state.fix.t_s > timeout_s
    ):
        position_state = replace(position_state, dead_reckoning=dead_reckoning.begin(water_state, now_s))
    if position_state.dead_reckoning is None:
        velocity_m_s = water.over_ground_m_s(water_state, math.nan if heading_rad is None else heading_rad)
        return position.predict(position_state, now_s, velocity_m_s)
    step_s = max(0.0, now_s - position_state.t_s)
    advanced, over_ground_m_s = dead_reckoning.advance(
        position_state.dead_reckoning, heading_rad, step_s, is_under_way=state.modes.armed
    )
    return position.predict(replace(position_state, dead_reckoning=advanced), now_s, over_ground_m_s)


def _fix_events(previous: PositionState, fix: PositionSample) -> tuple[Event, ...]:
    """Return the event of a fix after more than MAX_GAP_S of dead reckoning."""
    without_fix_s = position.time_since_fix_s(previous) + fix.t_s - previous.t_s
    if previous.dead_reckoning is None or without_fix_s <= position.MAX_GAP_S:
        return ()
    minutes, error_m = without_fix_s / 60.0, position.distance_from_estimate_m(previous, fix)
    return (Event(Severity.NOTICE, f"GPS recovered after {minutes:.0f} min: position error {error_m:.0f} m"),)


def _correct_first_position(
    state: State, wrong_fix: PositionSample, right_fix: PositionSample
) -> tuple[State, tuple[Event, ...]]:
    """Return the state after the correction of a wrong first position, and the event.

    Home and goal are moved by the same distance if they are near the wrong position. Water, tasks (for example the
    loiter point) and fence margin restart at the present position.
    """
    wrong_place, right_place = position.place_of(wrong_fix), position.place_of(right_fix)
    error_m, _ = wrong_place.distance_and_bearing(right_place)

    def move_if_near(latitude_rad: float, longitude_rad: float) -> Place | None:
        place = Place(latitude_rad, longitude_rad)
        is_near = wrong_place.distance_and_bearing(place)[0] < MOVED_DISTANCE_FRACTION * error_m
        return right_place.at_offset(*wrong_place.offset_m(place)) if is_near else None

    home, modes, goal = state.home, state.modes, state.modes.goal
    if home is not None and (moved_place := move_if_near(home.latitude_rad, home.longitude_rad)) is not None:
        home = Home(moved_place.latitude_rad, moved_place.longitude_rad, right_fix.altitude_m or 0.0)
    if (
        isinstance(goal, PositionGoal)
        and (moved_place := move_if_near(goal.latitude_rad, goal.longitude_rad)) is not None
    ):
        modes = replace(modes, goal=PositionGoal(moved_place.latitude_rad, moved_place.longitude_rad))
    expected = state.heading_estimator.water.expected
    state = replace(
        state,
        home=home,
        modes=modes,
        guidance=replace(state.guidance, mode=None),  # restarts the task of the mode
        heading_estimator=heading_estimator.with_expected_water(state.heading_estimator, expected),
    )
    text = f"First GPS position wrong by {1e-3 * error_m:.1f} km: home and tasks moved"
    return state, (Event(Severity.WARNING, text),)


def _home_at(fix: PositionSample) -> Home:
    """Return home at the position of an accepted fix."""
    place = position.place_of(fix)
    return Home(place.latitude_rad, place.longitude_rad, fix.altitude_m or 0.0)
