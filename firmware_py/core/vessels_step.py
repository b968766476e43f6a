"""Other vessels in a tick: what is heard of them, who comes near, and stepping aside for it."""

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
from firmware_py.guidance import guidance, step_aside, traffic
from firmware_py.guidance.approach import Velocity
from firmware_py.guidance.guidance import GuidanceState
from firmware_py.guidance.steering import SteeringTarget
from firmware_py.guidance.step_aside import AsideInput, LineAhead
from firmware_py.guidance.traffic import OwnMotion
from firmware_py.model.crab import heading_for_course
from firmware_py.modes import Situation, heading_in_water


def watch_vessels(
    settings: Settings, state: State, inputs: Inputs, freshness: Freshness
) -> tuple[State, tuple[Event, ...]]:
    """Take what vessels have sent in and judge who comes near; nothing to do, and done, where no AIS is aboard."""
    if not (inputs.vessels or inputs.devices or state.traffic.vessels):
        return state, ()
    now_s = inputs.tick.t_s
    told, events = traffic.receiver_events(state.traffic, inputs.devices, now_s)
    if inputs.vessels or told.vessels:
        own = None
        if state.position.fix is not None and freshness.position is Age.FRESH:
            place = Place(state.position.latitude_rad, state.position.longitude_rad)
            estimator = state.heading_estimator
            heading_rad = estimator.heading.heading_rad if freshness.heading is Age.FRESH else None
            velocity_m_s = water.over_ground_m_s(estimator.water, or_nan(heading_rad))
            own = OwnMotion(place, velocity_m_s, *_own_ways_m_s(state))
        told, more = traffic.update(settings.traffic, told, inputs.vessels, own, now_s)
        events = (*events, *more)
    return (state if told is state.traffic else replace(state, traffic=told)), events


def avoid_vessels(
    settings: Settings, state: State, target: SteeringTarget, situation: Situation, now_s: float
) -> tuple[State, SteeringTarget, tuple[Event, ...]]:
    """Return the heading to steer while a vessel comes near, the very target while she goes her own way."""
    modes, known = state.modes, situation.water
    if not (settings.aside.enabled and state.traffic.near and modes.armed and MODES[modes.mode].follows_task):
        return _own_way(state, target)
    heading_rad = situation.heading_rad
    if target.heading_rad is None or heading_rad is None or not situation.position_ok or known is None:
        return _own_way(state, target)
    if known.too_strong:  # she needs all her way to hold her own
        return _own_way(state, target)
    followed = _followed_line(state.guidance)
    given = AsideInput(
        t_s=now_s,
        wanted_rad=target.heading_rad,
        motion=guidance.vessel_motion(
            Place(state.position.latitude_rad, state.position.longitude_rad), heading_rad, known
        ),
        vessels=tuple(vessel for vessel in state.traffic.vessels if vessel.avoided),
        fence=state.plans.fence if fence_enabled(settings, state) else None,
        goal=modes.goal,
        task=state.guidance.task,
        line=None if followed is None else LineAhead(*followed, heading_in_water(followed[1], known)),
    )
    aside, events = step_aside.update(settings.aside, settings.traffic, state.aside, given)
    state = replace(state, aside=aside)
    if aside.heading_rad is None:
        return state, target, events
    return state, SteeringTarget(aside.heading_rad, wrap_pi(aside.heading_rad - heading_rad)), events


def _followed_line(state: GuidanceState) -> tuple[float, float] | None:
    """Return how far to starboard [m] she is of the line that she follows, and where that leads by its start [rad]."""
    line, status = state.follower.line, state.status
    if status.cross_track_m is None or line is None or status.target is None:
        return None
    return status.cross_track_m, line.start.distance_and_bearing(status.target)[1]


def _own_ways_m_s(state: State) -> tuple[Velocity, ...]:
    """Return how she would move over ground on her own way and, off a line, back to it; none while she is on it."""
    known, way_rad = state.heading_estimator.water, state.aside.way_rad
    followed, target = _followed_line(state.guidance), state.guidance.status.heading_target
    if way_rad is None:
        return ()
    if followed is None or target is None:
        return (water.over_ground_m_s(known, way_rad),)
    north_m_s, east_m_s, speed_m_s, leeway_rad = water.known(known)
    courses = followed[1], target.angle_rad
    headings = [heading_for_course(one, speed_m_s, north_m_s, east_m_s, leeway_rad) for one in courses]
    return tuple(water.over_ground_m_s(known, heading_rad) for heading_rad in headings)


def _own_way(state: State, target: SteeringTarget) -> tuple[State, SteeringTarget, tuple[Event, ...]]:
    if state.aside is step_aside.IDLE:
        return state, target, ()
    aside, events = step_aside.end(state.aside)
    return replace(state, aside=aside), target, events


def report(state: State) -> Traffic | None:
    """Return the table of vessels for those who look on, None while none was ever heard."""
    known = state.traffic
    if known.looked_s is None:
        return None
    others = tuple(vessel for vessel in known.vessels if not vessel.own)
    return Traffic(others, state.aside.heading_rad, known.turned_away)
