"""Other vessels in a tick: AIS reports, approaching vessels, and avoidance."""

from __future__ import annotations

from msgspec.structs import replace

from firmware_py.common.absence import or_nan
from firmware_py.common.angles import wrap_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.mode_table import MODES
from firmware_py.common.records import Event, Inputs
from firmware_py.common.vessels import Traffic
from firmware_py.core.freshness import Age, Freshness
from firmware_py.core.state import Settings, State, fence_enabled
from firmware_py.estimate import water
from firmware_py.guidance import avoidance, guidance, traffic
from firmware_py.guidance.approach import Velocity
from firmware_py.guidance.avoidance import AvoidanceInput, LineAhead
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.guidance.traffic import OwnMotion
from firmware_py.model.crab import heading_for_course
from firmware_py.modes import Situation, heading_in_water


def watch_vessels(
    settings: Settings, state: State, inputs: Inputs, freshness: Freshness
) -> tuple[State, tuple[Event, ...]]:
    """Return the state updated with AIS reports and approaching vessels, and the events; unchanged without AIS."""
    if not (inputs.vessels or inputs.devices or state.traffic.vessels):
        return state, ()
    now_s = inputs.tick.t_s
    traffic_state, events = traffic.receiver_events(state.traffic, inputs.devices, now_s)
    if inputs.vessels or traffic_state.vessels:
        own_motion = None
        if freshness.position is Age.FRESH:
            place = Place(state.position.latitude_rad, state.position.longitude_rad)
            estimator = state.heading_estimator
            heading_rad = estimator.heading.heading_rad if freshness.heading is Age.FRESH else None
            velocity_m_s = water.over_ground_m_s(estimator.water, or_nan(heading_rad))
            own_motion = OwnMotion(place, velocity_m_s, *_course_velocities_m_s(state))
        traffic_state, update_events = traffic.update(
            settings.traffic, traffic_state, inputs.vessels, own_motion, now_s
        )
        events = (*events, *update_events)
    return (state if traffic_state is state.traffic else replace(state, traffic=traffic_state)), events


def avoid_vessels(
    settings: Settings, state: State, target: SteeringTarget, situation: Situation, now_s: float
) -> tuple[State, SteeringTarget, tuple[Event, ...]]:
    """Return the state, the target with the avoidance heading if a vessel is near, and the events."""
    modes, water_report = state.modes, situation.water
    if not (settings.aside.enabled and state.traffic.near and modes.armed and MODES[modes.mode].follows_task):
        return _end_avoidance(state, target)
    heading_rad = situation.heading_rad
    if target.heading_rad is None or heading_rad is None or not situation.position_ok or water_report is None:
        return _end_avoidance(state, target)
    if water_report.too_strong:  # the boat cannot leave its track
        return _end_avoidance(state, target)
    line = _followed_line(state.guidance)
    avoidance_input = AvoidanceInput(
        t_s=now_s,
        unchanged_rad=target.heading_rad,
        motion=guidance.make_vessel_motion(
            Place(state.position.latitude_rad, state.position.longitude_rad), heading_rad, water_report
        ),
        vessels=tuple(vessel for vessel in state.traffic.vessels if vessel.is_avoidable),
        fence=state.plans.fence if fence_enabled(settings, state) else None,
        goal=modes.goal,
        task=state.guidance.task,
        line=None if line is None else LineAhead(*line, heading_in_water(line[1], water_report)),
    )
    aside, events = avoidance.update(settings.aside, settings.traffic, state.aside, avoidance_input)
    state = replace(state, aside=aside)
    if aside.heading_rad is None:
        return state, target, events
    return state, SteeringTarget(aside.heading_rad, wrap_pi(aside.heading_rad - heading_rad)), events


def _followed_line(state: GuidanceState) -> tuple[float, float] | None:
    """Return the cross-track error [m], positive to starboard, and the course of the line at its start [rad]."""
    line, status = state.follower.line, state.status
    if status.cross_track_m is None or line is None or status.target is None:
        return None
    return status.cross_track_m, line.start.distance_and_bearing(status.target)[1]


def _course_velocities_m_s(state: State) -> tuple[Velocity, ...]:
    """Return the velocities over ground on the unchanged course and on the course back to the line.

    The second one is omitted if the boat follows no line. Without avoidance the result is empty.
    """
    water_state, unchanged_rad = state.heading_estimator.water, state.aside.way_rad
    line, target = _followed_line(state.guidance), state.guidance.status.heading_target
    if unchanged_rad is None:
        return ()
    if line is None or target is None:
        return (water.over_ground_m_s(water_state, unchanged_rad),)
    north_m_s, east_m_s, speed_m_s, leeway_rad = water.guidance_values(water_state)
    courses = line[1], target.angle_rad
    headings = [heading_for_course(course_rad, speed_m_s, north_m_s, east_m_s, leeway_rad) for course_rad in courses]
    return tuple(water.over_ground_m_s(water_state, heading_rad) for heading_rad in headings)


def _end_avoidance(state: State, target: SteeringTarget) -> tuple[State, SteeringTarget, tuple[Event, ...]]:
    """Return the state without avoidance, the unchanged target, and the event of the end."""
    if state.aside is avoidance.IDLE:
        return state, target, ()
    aside, events = avoidance.end(state.aside)
    return replace(state, aside=aside), target, events


def report(state: State) -> Traffic | None:
    """Return the vessels for log and link; None before the first AIS report."""
    table = state.traffic
    if table.checked_s is None:
        return None
    others = tuple(vessel for vessel in table.vessels if not vessel.own)
    return Traffic(others, state.aside.heading_rad, table.rejected)
