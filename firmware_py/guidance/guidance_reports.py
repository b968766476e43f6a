"""Reports of guidance: events to the operator, and records for the log and the link."""

from __future__ import annotations

from firmware_py.common.mode_table import Mode
from firmware_py.common.plan import Plans
from firmware_py.common.records import Event, Severity
from firmware_py.common.reports import Activity, MissionReport, Navigation
from firmware_py.guidance import loiter_placement, mission_progress
from firmware_py.guidance.guidance import GuidanceState, fence_margin_m
from firmware_py.guidance.loiter_placement import LoiterPlacement
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, Orbit, TaskSettings
from firmware_py.modes import ModeState


def fence_events(previous: GuidanceState, present: GuidanceState, plans: Plans) -> tuple[Event, ...]:
    """Return the events when a command or a mission item enables or disables the fence."""
    if present.fence_enabled is None or present.fence_enabled is previous.fence_enabled:
        return ()
    if present.fence_enabled and not plans.fence.items:
        return (Event(Severity.WARNING, "Fence enabled, but none is loaded: send one"),)
    return (Event(Severity.NOTICE, "Fence enabled" if present.fence_enabled else "Fence disabled"),)


def mission_events(previous: MissionProgress, present: MissionProgress, first_number: int) -> tuple[Event, ...]:
    """Return the events of the mission after a tick and its requests.

    `first_number` is the number of the first item in the count of the operator (plan.first_item_number).
    """
    if present.complete and not previous.complete:
        # An unusable mission is reported by its own fault.
        return () if present.unusable else (Event(Severity.NOTICE, "Mission complete: keeping station"),)
    events: list[Event] = []
    if present.waiting and not previous.waiting:
        events.append(
            Event(Severity.NOTICE, f"Mission paused after item {first_number + present.index}: no autocontinue")
        )
    if present.paused and not previous.paused:
        events.append(Event(Severity.NOTICE, "Mission paused: keeping station"))
    if mission_progress.is_halted(previous) and not mission_progress.is_halted(present):
        events.append(Event(Severity.NOTICE, "Mission resumed"))
    if present.begun and not present.waiting and (present.index != previous.index or not previous.begun):
        events.append(Event(Severity.INFO, f"Mission: item {first_number + present.index}"))
    return tuple(events)


def dead_reckoning_events(
    previous: TaskFollowerState, present: TaskFollowerState, *, begins: bool
) -> tuple[Event, ...]:
    """Return the events at the beginning of dead reckoning, and when the boat begins to wait for a fix."""
    events = [Event(Severity.NOTICE, "Dead reckoning started: position error grows")] if begins else []
    if present.halt is not None and present.halt != previous.halt:
        is_at_destination = isinstance(present.task, GoTo) and present.task.place == present.halt
        text = (
            "Probably at the waypoint (no GPS); waiting for a fix"
            if is_at_destination
            else "Position too uncertain; holding here until GPS returns"
        )
        events.append(Event(Severity.WARNING, text))
    return tuple(events)


def circle_events(settings: TaskSettings, previous: GuidanceState, present: GuidanceState) -> tuple[Event, ...]:
    """Return the events when a circle differs from the requested one, or is too small."""
    events: list[Event] = []
    radius_m, min_radius_m = present.status.radius_m or 0.0, loiter_placement.min_radius_m(settings)
    has_changed = (present.status.activity, radius_m) != (previous.status.activity, previous.status.radius_m)
    if present.status.activity is Activity.STATION and has_changed and radius_m < min_radius_m:
        text = f"Loiter radius {radius_m:.0f} m: below {min_radius_m:.0f} m the boat may drift out"
        events.append(Event(Severity.NOTICE, text))
    task = present.task
    if isinstance(task, Orbit) and task != previous.task and radius_m > task.radius_m:
        text = f"Circle radius {task.radius_m:.0f} m too small: circling at {radius_m:.0f} m"
        events.append(Event(Severity.NOTICE, text))
    placement = present.follower.loiter_placement
    if placement is not None and placement.is_final and placement is not previous.follower.loiter_placement:
        events += _placement_events(settings, placement)
    return tuple(events)


def _placement_events(settings: TaskSettings, placement: LoiterPlacement) -> list[Event]:
    task, circle = placement.task, placement.circle
    events: list[Event] = []
    if circle != task:
        moved_m, _ = task.centre.distance_and_bearing(circle.centre)
        text = f"Fence near: loiter radius {circle.radius_m:.0f} m, moved {moved_m:.0f} m inward"
        events.append(Event(Severity.NOTICE, text))
    if placement.margin_m < circle.radius_m + loiter_placement.overshoot_m(settings):
        events.append(Event(Severity.WARNING, "Fence too close to the loiter circle: breach possible"))
    return events


def navigation_report(state: GuidanceState, plans: Plans, *, fence_enabled: bool) -> Navigation:
    """Return the navigation record for the log and the link."""
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


def mission_report(state: GuidanceState, plans: Plans, modes: ModeState, first_number: int) -> MissionReport:
    """Return the mission record; the operator counts items from `first_number` (plan.first_item_number)."""
    count = len(plans.mission.items)
    progress = mission_progress.for_plan(state.mission, plans.mission.identity)
    return MissionReport(
        state=mission_progress.state_of(progress, count, running=modes.mode is Mode.AUTO and modes.armed),
        index=min(progress.index, count - 1) if count else None,
        first_item_number=first_number,
        count=count,
        reached_items=state.reached,
        identities=(plans.mission.identity, plans.fence.identity, plans.rally.identity),
    )
