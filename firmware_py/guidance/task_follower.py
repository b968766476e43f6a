"""Carries an order out: line, watch circle or circle, one step after the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

from firmware_py.common.geodesy import Place
from firmware_py.common.records import Activity
from firmware_py.guidance import line, orbit, station_keeping
from firmware_py.guidance.line import LineState
from firmware_py.guidance.orbit import OrbitState
from firmware_py.guidance.station_keeping import StationState
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


@dataclass(frozen=True, slots=True)
class TaskFollowerState:
    """How far the order has come: `arrived` at its place once, and the turns made round it."""

    order: Task | None = None
    arrived: bool = False
    line: LineState | None = None
    station: StationState = StationState()  # noqa: RUF009 - frozen
    orbit: OrbitState = OrbitState()  # noqa: RUF009 - frozen


@dataclass(frozen=True, slots=True)
class TaskStatus:
    """What came of a step, for the helm and for those who look on."""

    wanted: HeadingTarget | None = None
    activity: Activity = Activity.NOTHING
    target: Place | None = None
    radius_m: float | None = None
    bearing_rad: float | None = None
    distance_m: float | None = None
    cross_track_m: float | None = None


def update(
    settings: TaskSettings, state: TaskFollowerState, order: Task | None, motion: VesselMotion | None, step_s: float
) -> tuple[TaskFollowerState, TaskStatus]:
    """Carry an order out for step_s; a new one begins from where she is."""
    if order != state.order:
        state = TaskFollowerState(order)
    if order is None:
        return state, TaskStatus()
    if isinstance(order, HoldHeading):
        return state, TaskStatus(HeadingTarget(order.heading_rad, over_ground=False), Activity.HEADING)
    if motion is None:
        return state, TaskStatus()
    if isinstance(order, Orbit):
        return _orbit(settings, state, order, motion)
    if isinstance(order, GoTo) and not state.arrived:
        return _go(settings, state, order, motion, step_s)
    kept = order if isinstance(order, HoldStation) else HoldStation(order.to, order.keep_m)
    return _keep(settings, state, kept, motion)


def _go(
    settings: TaskSettings, state: TaskFollowerState, order: GoTo, motion: VesselMotion, step_s: float
) -> tuple[TaskFollowerState, TaskStatus]:
    begun = state.line or LineState(order.start or motion.place)
    after, course_rad, on = line.follow(settings, begun, order, motion, step_s)
    after, arrived = line.approach(settings, after, order, motion, on)
    state = replace(state, line=after, arrived=arrived)
    if arrived:
        return _keep(settings, state, HoldStation(order.to, order.keep_m), motion)
    distance_m, bearing_rad = motion.place.distance_and_bearing(order.to)
    return state, TaskStatus(
        HeadingTarget(course_rad, over_ground=True),
        Activity.LINE,
        order.to,
        order.accept_m,
        bearing_rad,
        distance_m,
        None if on is None else on.cross_track_m,
    )


def _keep(
    settings: TaskSettings, state: TaskFollowerState, order: HoldStation, motion: VesselMotion
) -> tuple[TaskFollowerState, TaskStatus]:
    distance_m, bearing_rad = motion.place.distance_and_bearing(order.centre)
    after, wanted = station_keeping.keep(settings, state.station, order, motion, distance_m)
    state = replace(state, station=after, arrived=state.arrived or distance_m <= order.keep_m)
    return state, TaskStatus(wanted, Activity.STATION, order.centre, order.keep_m, bearing_rad, distance_m)


def _orbit(
    settings: TaskSettings, state: TaskFollowerState, order: Orbit, motion: VesselMotion
) -> tuple[TaskFollowerState, TaskStatus]:
    after, course_rad = orbit.circle(settings, state.orbit, order, motion)
    distance_m, bearing_rad = motion.place.distance_and_bearing(order.centre)
    radius_m = orbit.radius_m(settings, order)
    near = abs(distance_m - radius_m) <= orbit.NEAR_PART * radius_m
    state = replace(state, orbit=after, arrived=state.arrived or near)
    return state, TaskStatus(
        HeadingTarget(course_rad, over_ground=True),
        Activity.CIRCLE,
        order.centre,
        radius_m,
        bearing_rad,
        distance_m,
        radius_m - distance_m if order.clockwise else distance_m - radius_m,
    )
