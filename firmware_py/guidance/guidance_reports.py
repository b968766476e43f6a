"""What is told of guidance: events to the operator, and where it takes the boat to the log and the link."""

from __future__ import annotations

from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plans
from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Activity, MissionReport, Navigation
from firmware_py.guidance import loiter_placement, mission_progress
from firmware_py.guidance.guidance import GuidanceState, fence_margin_m
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, Orbit, TaskSettings
from firmware_py.modes import ModeState


def fence_events(before: GuidanceState, after: GuidanceState, plans: Plans) -> tuple[Event, ...]:
    """Return what is told when a command or an item of the mission has the fence heeded or not."""
    if after.fence_enabled is None or after.fence_enabled is before.fence_enabled:
        return ()
    if after.fence_enabled and not plans.fence.items:
        return (Event(Severity.WARNING, "No fence to heed: send one"),)
    return (Event(Severity.NOTICE, "Fence heeded" if after.fence_enabled else "Fence not heeded"),)


def mission_events(before: MissionProgress, after: MissionProgress, first: int) -> tuple[Event, ...]:
    """Return what is told of the mission after a tick, the requests of which may have changed it, too.

    `first` is the number of the first item as the operator counts (plan.homes).
    """
    if after.complete and not before.complete:
        # That it cannot be sailed is a fault of its own.
        return () if after.unusable else (Event(Severity.NOTICE, "Mission complete: keeping station"),)
    events: list[Event] = []
    if after.waiting and not before.waiting:
        events.append(Event(Severity.NOTICE, f"Mission paused after item {first + after.index}: no autocontinue"))
    if after.paused and not before.paused:
        events.append(Event(Severity.NOTICE, "Mission paused: keeping station"))
    if mission_progress.is_halted(before) and not mission_progress.is_halted(after):
        events.append(Event(Severity.NOTICE, "Mission goes on"))
    if after.begun and not after.waiting and (after.index != before.index or not before.begun):
        events.append(Event(Severity.INFO, f"Mission: item {first + after.index}"))
    return tuple(events)


def dead_reckoning_events(before: TaskFollowerState, after: TaskFollowerState, *, begins: bool) -> tuple[Event, ...]:
    """Return what is told when a lost position is reckoned on, and where she waits for a fix."""
    events = [Event(Severity.NOTICE, "Goes on by reckoning from the last fix")] if begins else []
    if after.halt is not None and after.halt != before.halt:
        there = isinstance(after.task, GoTo) and after.task.place == after.halt
        text = (
            "Reckoned to be there: waits for a fix to say so"
            if there
            else "Reckoned too coarsely: waits here for a fix"
        )
        events.append(Event(Severity.WARNING, text))
    return tuple(events)


def circle_events(settings: TaskSettings, before: GuidanceState, after: GuidanceState) -> tuple[Event, ...]:
    """Return what is told of a circle that is not what was asked for: as she begins to keep it, and as it is moved."""
    events: list[Event] = []
    radius_m, min_radius_m = after.status.radius_m or 0.0, loiter_placement.min_radius_m(settings)
    began = (after.status.activity, radius_m) != (before.status.activity, before.status.radius_m)
    if after.status.activity is Activity.STATION and began and radius_m < min_radius_m:
        text = f"Watch circle of {radius_m:.0f} m: in a current she holds no less than {min_radius_m:.0f} m"
        events.append(Event(Severity.NOTICE, text))
    task = after.task
    if isinstance(task, Orbit) and task != before.task and radius_m > task.radius_m:
        text = f"Circle of {task.radius_m:.0f} m: too tight, she goes round at {radius_m:.0f} m"
        events.append(Event(Severity.NOTICE, text))
    found, known = after.follower.loiter_placement, before.follower.loiter_placement
    if found is not None and found.found and found is not known:
        events += _placement_events(settings, found)
    return tuple(events)


def _placement_events(settings: TaskSettings, found: loiter_placement.LoiterPlacement) -> list[Event]:
    moved_m, _ = found.task.centre.distance_and_bearing(found.circle.centre)
    events: list[Event] = []
    if found.circle != found.task:
        text = f"Fence is near: watch circle of {found.circle.radius_m:.0f} m, moved {moved_m:.0f} m inward"
        events.append(Event(Severity.NOTICE, text))
    if found.margin_m < found.circle.radius_m + loiter_placement.overshoot_m(settings):
        events.append(Event(Severity.WARNING, "Fence leaves no room for her watch circle: she may swing over it"))
    return events


def report(state: GuidanceState, plans: Plans, *, fence_enabled: bool) -> Navigation:
    """Return where guidance takes the boat, for the log and the link."""
    status = state.status
    return Navigation(
        activity=status.activity,
        target_latitude_rad=None if status.target is None else status.target.latitude_rad,
        target_longitude_rad=None if status.target is None else status.target.longitude_rad,
        radius_m=status.radius_m,
        cross_track_m=status.cross_track_m,
        arrived=state.follower.arrived and status.activity is not Activity.NOTHING,
        fence_enabled=fence_enabled,
        fence_margin_m=fence_margin_m(state, plans, enabled=fence_enabled),
    )


def mission_report(state: GuidanceState, plans: Plans, modes: ModeState, first: int) -> MissionReport:
    """Return the mission as the operator follows it, who counts its items from `first` (plan.homes)."""
    count = len(plans.mission.items)
    progress = mission_progress.for_plan(state.mission, plans.mission.identity)
    return MissionReport(
        state=mission_progress.state_of(progress, count, running=modes.mode is Mode.AUTO and modes.armed),
        index=min(progress.index, count - 1) if count else None,
        first=first,
        count=count,
        reached=state.reached,
        identities=(plans.mission.identity, plans.fence.identity, plans.rally.identity),
    )
