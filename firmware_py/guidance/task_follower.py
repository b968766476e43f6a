"""Following of a task: line, loiter circle or orbit.

Under dead reckoning, a place is reached only if the position error is below the acceptance radius. Otherwise the boat
keeps station at the place and waits for a fix. If the error exceeds POS_RECKON_M before, it keeps station at the
estimated position.
"""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan
from firmware_py.common.reports import Activity
from firmware_py.guidance import line, loiter_placement, orbit, station_keeping
from firmware_py.guidance.line import LineState
from firmware_py.guidance.loiter_placement import LoiterPlacement
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.station_keeping import StationKeepingState
from firmware_py.guidance.tasks import (
    GoTo,
    HeadingTarget,
    HoldHeading,
    HoldStation,
    Orbit,
    Task,
    TaskSettings,
    VesselMotion,
)


class TaskFollowerState(msgspec.Struct, frozen=True):
    """Progress of the task; `arrived`: its place was reached once; `halt`: the place where the boat waits for a fix.

    `loiter_placement`: placement of the loiter circle within a fence.
    """

    task: Task | None = None
    arrived: bool = False
    line: LineState | None = None
    station: StationKeepingState = StationKeepingState()
    orbit: OrbitState = OrbitState()
    halt: Place | None = None
    loiter_placement: LoiterPlacement | None = None


class TaskStatus(msgspec.Struct, frozen=True):
    """Result of a step, for the controller and for reports.

    `radius_m` is the acceptance, loiter or orbit radius at `target`; `bearing_rad` and `distance_m` are from the boat
    to it. `cross_track_m` is positive to starboard of the line or orbit.
    """

    heading_target: HeadingTarget | None = None
    activity: Activity = Activity.NOTHING
    target: Place | None = None
    radius_m: float | None = None
    bearing_rad: float | None = None
    distance_m: float | None = None
    cross_track_m: float | None = None


def update(
    settings: TaskSettings,
    state: TaskFollowerState,
    task: Task | None,
    motion: VesselMotion | None,
    step_s: float,
    fence: Plan | None = None,
) -> tuple[TaskFollowerState, TaskStatus | None]:
    """Follow a task for step_s; a new task starts at the present position. `fence` is None if it is disabled.

    If the task needs a position and none is known, the status is None and the state unchanged.
    """
    previous = state
    if task != state.task:
        state = TaskFollowerState(task)
    if task is None:
        return state, TaskStatus()
    if isinstance(task, HoldHeading):
        return state, TaskStatus(HeadingTarget(task.heading_rad, over_ground=False), Activity.HEADING)
    if motion is None:
        return previous, None
    if isinstance(task, Orbit):
        return _orbit(settings, state, task, motion)
    if isinstance(task, GoTo) and not state.arrived:
        return _go_to(settings, state, task, motion, step_s, fence)
    station = task if isinstance(task, HoldStation) else HoldStation(task.place, task.station_radius_m)
    return _hold_station(settings, state, station, motion, fence)


def _go_to(
    settings: TaskSettings,
    state: TaskFollowerState,
    task: GoTo,
    motion: VesselMotion,
    step_s: float,
    fence: Plan | None,
) -> tuple[TaskFollowerState, TaskStatus]:
    line_state = state.line or LineState(task.start or motion.place)
    if motion.spread_m > task.acceptance_radius_m:
        halt = state.halt or (motion.place if motion.spread_m > settings.dead_reckoning_limit_m else None)
        if motion.place.distance_and_bearing(task.place)[0] <= task.station_radius_m:
            halt = task.place
        if halt is not None:
            state, status = _hold_station(settings, state, HoldStation(halt, task.station_radius_m), motion, fence)
            return replace(state, line=line_state, halt=halt, arrived=False), status
    line_state, line_status = line.update(settings, line_state, task, motion, step_s)
    state = replace(state, line=line_state, arrived=line_status.arrived, halt=None)
    if line_status.arrived:
        return _hold_station(settings, state, HoldStation(task.place, task.station_radius_m), motion, fence)
    distance_m, bearing_rad = motion.place.distance_and_bearing(task.place)
    return state, TaskStatus(
        HeadingTarget(line_status.course_rad, over_ground=True),
        Activity.LINE,
        task.place,
        task.acceptance_radius_m,
        bearing_rad,
        distance_m,
        line_status.cross_track_m,
    )


def _hold_station(
    settings: TaskSettings, state: TaskFollowerState, task: HoldStation, motion: VesselMotion, fence: Plan | None
) -> tuple[TaskFollowerState, TaskStatus]:
    placement = loiter_placement.update(settings, state.loiter_placement, task, fence)
    if placement is not None and placement.is_final:
        task = placement.circle
    distance_m, bearing_rad = motion.place.distance_and_bearing(task.centre)
    station, target = station_keeping.update(settings, state.station, task, motion, distance_m)
    has_arrived = distance_m <= task.radius_m and motion.spread_m <= task.radius_m
    state = replace(state, station=station, arrived=state.arrived or has_arrived, loiter_placement=placement)
    return state, TaskStatus(target, Activity.STATION, task.centre, task.radius_m, bearing_rad, distance_m)


def _orbit(
    settings: TaskSettings, state: TaskFollowerState, task: Orbit, motion: VesselMotion
) -> tuple[TaskFollowerState, TaskStatus]:
    orbit_state, course_rad = orbit.update(settings, state.orbit, task, motion)
    distance_m, bearing_rad = motion.place.distance_and_bearing(task.centre)
    radius_m = orbit.radius_m(settings, task)
    is_on_circle = abs(distance_m - radius_m) <= orbit.ON_CIRCLE_FRACTION * radius_m and motion.spread_m <= radius_m
    state = replace(state, orbit=orbit_state, arrived=state.arrived or is_on_circle)
    return state, TaskStatus(
        HeadingTarget(course_rad, over_ground=True),
        Activity.CIRCLE,
        task.centre,
        radius_m,
        bearing_rad,
        distance_m,
        radius_m - distance_m if task.clockwise else distance_m - radius_m,
    )
