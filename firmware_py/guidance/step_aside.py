"""Stepping aside for vessels that come near: the heading that opens the distance most, and back when they are past.

The boat makes 0.4 m/s: in the 25 minutes that a ship is seen ahead she can get 600 m off its line, at the last moment
nothing. No rule of the road is known here. Every half a minute headings within a sector about the way she would go are
tried, one a tick, each for how near any vessel would come if all go on so; one that would bring her near the fence is
none. What is tried is that of the K-T model's ideal: she is on the heading at once. Her way along a line is that over
ground: on the heading that makes it good in the water as it is known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import compass_degrees, radians, wrap_pi, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.plan import Plan
from firmware_py.common.records import Event, Severity
from firmware_py.common.vessels import Vessel
from firmware_py.guidance.approach import Velocity, relative
from firmware_py.guidance.tasks import Task, VesselMotion
from firmware_py.guidance.traffic import TrafficSettings
from firmware_py.modes import HeadingGoal, PositionGoal
from firmware_py.plans import fence

TRY_EVERY_S = 30.0
STEPS = 6  # headings tried to either side
WORTH = 0.06  # of what is near: by so much the distance must open for another heading
AMPLE = 2.0  # times what is near: more is not sought
SAME_RAD = 1e-6
FENCE_M = 30.0  # that is kept from the fence
LEGS = 4  # that a way is cut into, to be held against the fence

Goal = HeadingGoal | PositionGoal


class AsideSettings(msgspec.Struct, frozen=True):
    """Whether she steps aside, and how far to either side of her way."""

    enabled: bool
    sector_rad: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> AsideSettings:
        """Read the settings from the parameters."""
        return cls(enabled=parameters["AIS_ACT"] == 1, sector_rad=radians(parameters["AIS_SECTOR_DEG"]))


class Trial(msgspec.Struct, frozen=True):
    """What a heading comes to: how near the nearest vessel comes, as a distance and in parts of what is near.

    A vessel that a heading keeps as far off as it is now does not count beside others: no heading does better.
    """

    heading_rad: float
    cpa_m: float
    part: float


class AsideState(msgspec.Struct, frozen=True):
    """The heading steered aside, None while she goes her way; the trials under way, and what they are made about.

    `way_rad` is the heading that the sector lies about, of her way when the round began. `told`: that there is no
    better heading has been said.
    """

    heading_rad: float | None = None
    way_rad: float | None = None
    goal: Goal | None = None
    task: Task | None = None
    tried_s: float | None = None
    next_trial: int | None = None  # None between two rounds
    best: Trial | None = None
    going_on: Trial | None = None
    told: bool = False


class LineAhead(msgspec.Struct, frozen=True):
    """How far to starboard of a line she is, where that leads over ground, and the heading that makes it good."""

    cross_track_m: float
    course_rad: float
    along_rad: float


class AsideInput(msgspec.Struct, frozen=True):
    """What stepping aside looks at; `wanted_rad` is the heading that she would steer, `fence` None while none holds.

    Where she follows no line her way is the heading that she would steer.
    """

    t_s: float
    wanted_rad: float
    motion: VesselMotion
    vessels: Sequence[Vessel]
    fence: Plan | None
    goal: Goal | None
    task: Task | None
    line: LineAhead | None = None


IDLE = AsideState()


def update(
    settings: AsideSettings, traffic: TrafficSettings, state: AsideState, given: AsideInput
) -> tuple[AsideState, tuple[Event, ...]]:
    """Try the next heading; at the end of a round take the best one, or go back on her way."""
    way_rad, along_rad = given.wanted_rad, given.wanted_rad
    if given.line is not None:
        way_rad, along_rad = given.line.course_rad, given.line.along_rad
    if (given.goal, given.task) != (state.goal, state.task):
        # Another way: tried at once, but a goal that changes ten times a second must not begin a round each time.
        state = replace(state, way_rad=way_rad, goal=given.goal, task=given.task, tried_s=None)
    if state.next_trial is None:
        if state.tried_s is not None and 0.0 <= given.t_s - state.tried_s < TRY_EVERY_S:
            return state, ()
        return replace(state, way_rad=way_rad, tried_s=given.t_s, next_trial=0, best=None), ()
    headings = _headings(settings, state, along_rad)
    if state.next_trial < len(headings):
        trial = _trial(traffic, given, headings[state.next_trial])
        better = _better(state.best, trial, along_rad) and _clear_of_fence(given, trial.heading_rad)
        best = trial if better else state.best
        return replace(state, next_trial=state.next_trial + 1, best=best), ()
    # By where all are now: who is past is further away with each trial, whatever the heading.
    best = None if state.best is None else _trial(traffic, given, state.best.heading_rad)
    going_on = _going_on(traffic, given)
    return _choose(replace(state, next_trial=None, best=best, going_on=going_on), going_on)


def end(state: AsideState) -> tuple[AsideState, tuple[Event, ...]]:
    """Return to her way: nobody comes near any more, or somebody else steers."""
    events = () if state.heading_rad is None else (Event(Severity.NOTICE, "Goes her own way again"),)
    return IDLE, events


def _headings(settings: AsideSettings, state: AsideState, along_rad: float) -> tuple[float, ...]:
    """Return the headings of a round, from near her way outward.

    Before them the one that is steered aside and then that along her way, which leaves her as far off it as she is.
    """
    way_rad, sector_rad = state.way_rad or 0.0, settings.sector_rad
    fan = [wrap_two_pi(way_rad + side * step * sector_rad / STEPS) for step in range(1, STEPS + 1) for side in (1, -1)]
    if state.heading_rad is None:
        return tuple(fan)
    within = (state.heading_rad,) if abs(wrap_pi(state.heading_rad - way_rad)) <= sector_rad + 1e-9 else ()
    return (*within, along_rad, *fan)


def _better(best: Trial | None, trial: Trial, along_rad: float) -> bool:
    """Whether a heading is better than the best of the round so far.

    The first that is ample, from her way outward, is taken: for what lies still a few degrees may do. So is one nearer
    her way than the heading steered, and to the same side, as soon as it is ample: else she runs on to the side.
    """
    if best is None:
        return True
    if best.part < AMPLE:
        return trial.part > best.part + WORTH
    off_rad, best_off_rad = wrap_pi(trial.heading_rad - along_rad), wrap_pi(best.heading_rad - along_rad)
    inward = off_rad * best_off_rad >= 0.0 and abs(off_rad) < abs(best_off_rad) - SAME_RAD
    return inward and trial.part > AMPLE + WORTH


def _choose(state: AsideState, going_on: Trial) -> tuple[AsideState, tuple[Event, ...]]:
    """Take the best heading of a round if it is worth it, beside what comes of going on."""
    best, before_rad = state.best, state.heading_rad
    if going_on.part >= AMPLE or best is None or best.part < going_on.part + WORTH:
        state = replace(state, heading_rad=None)
        if before_rad is not None:
            return replace(state, told=False), (Event(Severity.NOTICE, "Goes her own way again"),)
        if state.told or going_on.part >= 1.0:
            return state, ()
        return replace(state, told=True), (Event(Severity.WARNING, "Cannot step aside: no heading is better"),)
    state = replace(state, heading_rad=best.heading_rad, told=False)
    if before_rad is not None:
        return state, ()
    text = (
        f"Steps aside to {compass_degrees(best.heading_rad):.0f} deg: {going_on.cpa_m:.0f} m become {best.cpa_m:.0f} m"
    )
    return state, (Event(Severity.NOTICE, text),)


# ------------------------------------------------------------------------------ trials


def _going_on(traffic: TrafficSettings, given: AsideInput) -> Trial:
    """Return the worst of what comes of going her own way: as she would steer now, along it, and back on her line."""
    trials = [_trial(traffic, given, given.wanted_rad)]
    if given.line is not None:
        off_m, course_rad = given.line.cross_track_m, given.line.course_rad
        foot = given.motion.place.at_offset(off_m * math.sin(course_rad), -off_m * math.cos(course_rad))
        trials += [_trial(traffic, given, given.line.along_rad, place) for place in (given.motion.place, foot)]
    return min(trials, key=lambda trial: trial.part)


def _trial(traffic: TrafficSettings, given: AsideInput, heading_rad: float, place: Place | None = None) -> Trial:
    """Predict the closest approach of all vessels on a heading, from the place of the boat or from another one."""
    own_m_s = _velocity(given.motion, heading_rad)
    counted = uncounted = (math.inf, math.inf)
    for vessel in given.vessels:
        limit_m = traffic.limit_m(vessel.position)
        seen = relative(given.motion.place, vessel.position, given.t_s)
        here = min(AMPLE, math.hypot(seen.north_m, seen.east_m) / limit_m)
        if place is not None:
            seen = relative(place, vessel.position, given.t_s)
        near_m, _ = seen.nearest(own_m_s, traffic.horizon_s)
        share = near_m / limit_m
        if here - share < WORTH:
            uncounted = min(uncounted, (share, near_m))
        else:
            counted = min(counted, (share, near_m))
    if counted[1] < math.inf:
        return Trial(heading_rad, counted[1], counted[0])
    return Trial(heading_rad, uncounted[1], max(AMPLE, uncounted[0]))


def _velocity(motion: VesselMotion, heading_rad: float) -> Velocity:
    way_rad = heading_rad + motion.leeway_rad
    return (
        motion.current_north_m_s + motion.speed_m_s * math.cos(way_rad),
        motion.current_east_m_s + motion.speed_m_s * math.sin(way_rad),
    )


def _clear_of_fence(given: AsideInput, heading_rad: float) -> bool:
    """Whether the way on a heading stays clear of the fence, for as long as the last vessel that is near comes nearer.

    Between two places a leg apart the margin is at least half of what their margins leave over the leg.
    """
    if given.fence is None:
        return True
    coming_s = [vessel.cpa_in_s or 0.0 for vessel in given.vessels if vessel.near_s is not None]
    ahead_s = max(coming_s, default=0.0) + 2.0 * TRY_EVERY_S
    north_m_s, east_m_s = _velocity(given.motion, heading_rad)
    leg_m = math.hypot(north_m_s, east_m_s) * ahead_s / LEGS
    before_m = fence.margin_m(given.fence, given.motion.place)
    for leg in range(1, LEGS + 1):
        part_s = ahead_s * leg / LEGS
        margin_m = fence.margin_m(given.fence, given.motion.place.at_offset(north_m_s * part_s, east_m_s * part_s))
        if 0.5 * (before_m + margin_m - leg_m) < FENCE_M:
            return False
        before_m = margin_m
    return True
