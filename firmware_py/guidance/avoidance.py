"""Vessel avoidance: steers the heading with the largest distance to approaching vessels until they have passed.

The speed of the boat is about 0.4 m/s: within 25 minutes after the detection of a ship it can move 600 m away from its
track, but a late manoeuvre has no effect. Collision regulations are not applied. Every 30 s a round starts: each
tick tries one heading within a sector around the unchanged course. The measure is the closest approach of all vessels
at constant velocity; a heading that leads near the fence is rejected. The model has no turning time. If the boat
follows a line, the unchanged course is the heading that keeps the course of the line in the estimated current.
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
from firmware_py.guidance.approach import Velocity, relative_motion
from firmware_py.guidance.tasks import Task, VesselMotion
from firmware_py.guidance.traffic import TrafficSettings
from firmware_py.modes import HeadingGoal, PositionGoal
from firmware_py.plans import fence

ROUND_INTERVAL_S = 30.0
HEADINGS_PER_SIDE = 6
# Ratios of the closest approach to the near distance.
MIN_GAIN = 0.06  # minimum improvement for another heading
SUFFICIENT_RATIO = 2.0  # a larger ratio is not better
HEADING_TOLERANCE_RAD = 1e-6
FENCE_CLEARANCE_M = 30.0
FENCE_CHECK_LEGS = 4  # sections of a track that are checked against the fence

Goal = HeadingGoal | PositionGoal


class AvoidanceSettings(msgspec.Struct, frozen=True):
    """Whether avoidance is enabled, and the largest deviation to either side."""

    enabled: bool
    sector_rad: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> AvoidanceSettings:
        """Read the settings from the parameters."""
        return cls(enabled=parameters["AIS_ACT"] == 1, sector_rad=radians(parameters["AIS_SECTOR_DEG"]))


class Trial(msgspec.Struct, frozen=True):
    """Result of a heading: closest approach of the nearest vessel, and its ratio to the near distance.

    A vessel that does not come nearer on the heading is used only if there is no other vessel.
    """

    heading_rad: float
    cpa_m: float
    ratio: float


class AvoidanceState(msgspec.Struct, frozen=True):
    """The avoidance heading (None: unchanged course), and the present round of trials.

    `way_rad` is the centre of the sector: the unchanged course at the start of the round, which began at `tried_s` for
    `goal` and `task`. `next_trial` is the index of the next heading to try. `unchanged`: trial of the unchanged course
    at the end of the last round. `is_refusal_reported`: "no better heading" has been reported.
    """

    heading_rad: float | None = None
    way_rad: float | None = None
    goal: Goal | None = None
    task: Task | None = None
    tried_s: float | None = None
    next_trial: int | None = None  # None between two rounds
    best: Trial | None = None
    unchanged: Trial | None = None
    is_refusal_reported: bool = False


class LineAhead(msgspec.Struct, frozen=True):
    """The followed line: cross-track error to starboard, course over ground, and the heading that keeps this course."""

    cross_track_m: float
    course_rad: float
    along_rad: float


class AvoidanceInput(msgspec.Struct, frozen=True):
    """Inputs of avoidance; `unchanged_rad` is the heading without avoidance, `fence` is None if it is disabled.

    Without a line, the unchanged course is this heading.
    """

    t_s: float
    unchanged_rad: float
    motion: VesselMotion
    vessels: Sequence[Vessel]
    fence: Plan | None
    goal: Goal | None
    task: Task | None
    line: LineAhead | None = None


IDLE = AvoidanceState()


def update(
    settings: AvoidanceSettings, traffic: TrafficSettings, state: AvoidanceState, inputs: AvoidanceInput
) -> tuple[AvoidanceState, tuple[Event, ...]]:
    """Try the next heading; at the end of a round, select the best heading or the unchanged course."""
    way_rad, along_rad = inputs.unchanged_rad, inputs.unchanged_rad
    if inputs.line is not None:
        way_rad, along_rad = inputs.line.course_rad, inputs.line.along_rad
    if (inputs.goal, inputs.task) != (state.goal, state.task):
        # A new goal starts a round immediately, except during a round: a goal may change in each tick.
        state = replace(state, way_rad=way_rad, goal=inputs.goal, task=inputs.task, tried_s=None)
    if state.next_trial is None:
        if state.tried_s is not None and 0.0 <= inputs.t_s - state.tried_s < ROUND_INTERVAL_S:
            return state, ()
        return replace(state, way_rad=way_rad, tried_s=inputs.t_s, next_trial=0, best=None), ()
    headings = _list_headings(settings, state, along_rad)
    if state.next_trial < len(headings):
        trial = _try_heading(traffic, inputs, headings[state.next_trial])
        is_better = _is_better(state.best, trial, along_rad) and _is_clear_of_fence(inputs, trial.heading_rad)
        best = trial if is_better else state.best
        return replace(state, next_trial=state.next_trial + 1, best=best), ()
    # The best heading is tried again at the present positions: a vessel may have passed during the round.
    best = None if state.best is None else _try_heading(traffic, inputs, state.best.heading_rad)
    unchanged = _try_unchanged(traffic, inputs)
    return _choose(replace(state, next_trial=None, best=best, unchanged=unchanged), unchanged)


def end(state: AvoidanceState) -> tuple[AvoidanceState, tuple[Event, ...]]:
    """End avoidance, because no vessel is near or the mode has changed."""
    events = () if state.heading_rad is None else (Event(Severity.NOTICE, "Avoidance ended: back on course"),)
    return IDLE, events


def _list_headings(settings: AvoidanceSettings, state: AvoidanceState, along_rad: float) -> tuple[float, ...]:
    """Return the headings of a round, from the unchanged course outward.

    During avoidance, the first are the present avoidance heading, if it is in the sector, and `along_rad`, the heading
    that keeps the unchanged course.
    """
    way_rad, sector_rad = state.way_rad or 0.0, settings.sector_rad
    fan = [
        wrap_two_pi(way_rad + side * step * sector_rad / HEADINGS_PER_SIDE)
        for step in range(1, HEADINGS_PER_SIDE + 1)
        for side in (1, -1)
    ]
    if state.heading_rad is None:
        return tuple(fan)
    present = (state.heading_rad,) if abs(wrap_pi(state.heading_rad - way_rad)) <= sector_rad + 1e-9 else ()
    return (*present, along_rad, *fan)


def _is_better(best: Trial | None, trial: Trial, along_rad: float) -> bool:
    """Return whether a heading is better than the best of the round so far.

    The first sufficient heading from the unchanged course outward is the best, because a few degrees may be enough for
    a vessel at anchor. A sufficient heading closer to the unchanged course on the same side replaces the present one,
    so that the boat returns towards its course.
    """
    if best is None:
        return True
    if best.ratio < SUFFICIENT_RATIO:
        return trial.ratio > best.ratio + MIN_GAIN
    off_rad, best_off_rad = wrap_pi(trial.heading_rad - along_rad), wrap_pi(best.heading_rad - along_rad)
    is_inward = off_rad * best_off_rad >= 0.0 and abs(off_rad) < abs(best_off_rad) - HEADING_TOLERANCE_RAD
    return is_inward and trial.ratio > SUFFICIENT_RATIO + MIN_GAIN


def _choose(state: AvoidanceState, unchanged: Trial) -> tuple[AvoidanceState, tuple[Event, ...]]:
    """Select the best heading of a round if it is sufficiently better than the unchanged course."""
    best, previous_rad = state.best, state.heading_rad
    if unchanged.ratio >= SUFFICIENT_RATIO or best is None or best.ratio < unchanged.ratio + MIN_GAIN:
        state = replace(state, heading_rad=None)
        if previous_rad is not None:
            return replace(state, is_refusal_reported=False), (
                Event(Severity.NOTICE, "Avoidance ended: back on course"),
            )
        if state.is_refusal_reported or unchanged.ratio >= 1.0:
            return state, ()
        return replace(state, is_refusal_reported=True), (
            Event(Severity.WARNING, "Avoidance: no better heading, course kept"),
        )
    state = replace(state, heading_rad=best.heading_rad, is_refusal_reported=False)
    if previous_rad is not None:
        return state, ()
    heading_deg = compass_degrees(best.heading_rad)
    text = f"Avoidance: heading {heading_deg:.0f} deg, closest {best.cpa_m:.0f} m instead of {unchanged.cpa_m:.0f} m"
    return state, (Event(Severity.NOTICE, text),)


def _try_unchanged(traffic: TrafficSettings, inputs: AvoidanceInput) -> Trial:
    """Return the worst trial of the unchanged course: its heading and, on a line, the heading along the line.

    The latter is tried from the position of the boat and from the nearest point of the line.
    """
    trials = [_try_heading(traffic, inputs, inputs.unchanged_rad)]
    if inputs.line is not None:
        off_m, course_rad = inputs.line.cross_track_m, inputs.line.course_rad
        foot = inputs.motion.place.at_offset(off_m * math.sin(course_rad), -off_m * math.cos(course_rad))
        trials += [_try_heading(traffic, inputs, inputs.line.along_rad, place) for place in (inputs.motion.place, foot)]
    return min(trials, key=lambda trial: trial.ratio)


def _try_heading(
    traffic: TrafficSettings, inputs: AvoidanceInput, heading_rad: float, place: Place | None = None
) -> Trial:
    """Predict the closest approach of all vessels on a heading, from the present position or from `place`."""
    own_m_s = _velocity_over_ground(inputs.motion, heading_rad)
    relevant = irrelevant = (math.inf, math.inf)
    for vessel in inputs.vessels:
        limit_m = traffic.limit_m(vessel.position)
        offset = relative_motion(inputs.motion.place, vessel.position, inputs.t_s)
        present_ratio = min(SUFFICIENT_RATIO, math.hypot(offset.north_m, offset.east_m) / limit_m)
        if place is not None:
            offset = relative_motion(place, vessel.position, inputs.t_s)
        cpa_m, _ = offset.closest_approach(own_m_s, traffic.horizon_s)
        ratio = cpa_m / limit_m
        if present_ratio - ratio < MIN_GAIN:
            irrelevant = min(irrelevant, (ratio, cpa_m))
        else:
            relevant = min(relevant, (ratio, cpa_m))
    if relevant[1] < math.inf:
        return Trial(heading_rad, relevant[1], relevant[0])
    return Trial(heading_rad, irrelevant[1], max(SUFFICIENT_RATIO, irrelevant[0]))


def _velocity_over_ground(motion: VesselMotion, heading_rad: float) -> Velocity:
    water_course_rad = heading_rad + motion.leeway_rad
    return (
        motion.current_north_m_s + motion.speed_m_s * math.cos(water_course_rad),
        motion.current_east_m_s + motion.speed_m_s * math.sin(water_course_rad),
    )


def _is_clear_of_fence(inputs: AvoidanceInput, heading_rad: float) -> bool:
    """Return whether the track on a heading stays clear of the fence until the last near vessel has passed.

    Between the two ends of a leg, the margin is at least half of (sum of both margins - length of the leg).
    """
    if inputs.fence is None:
        return True
    cpa_times_s = [vessel.cpa_in_s or 0.0 for vessel in inputs.vessels if vessel.near_s is not None]
    duration_s = max(cpa_times_s, default=0.0) + 2.0 * ROUND_INTERVAL_S
    north_m_s, east_m_s = _velocity_over_ground(inputs.motion, heading_rad)
    leg_m = math.hypot(north_m_s, east_m_s) * duration_s / FENCE_CHECK_LEGS
    previous_m = fence.margin_m(inputs.fence, inputs.motion.place)
    for leg in range(1, FENCE_CHECK_LEGS + 1):
        time_s = duration_s * leg / FENCE_CHECK_LEGS
        margin_m = fence.margin_m(inputs.fence, inputs.motion.place.at_offset(north_m_s * time_s, east_m_s * time_s))
        if 0.5 * (previous_m + margin_m - leg_m) < FENCE_CLEARANCE_M:
            return False
        previous_m = margin_m
    return True
