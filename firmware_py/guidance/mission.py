"""Sails a mission: which item is under way, what task it gives, and when it is done.

A mission ends in keeping station, never in drifting.
"""

from __future__ import annotations

from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.guidance.mission_commands import TABLE, MissionInput, has_arrived, moment_of, station_task
from firmware_py.guidance.mission_progress import MissionProgress, after_item
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.tasks import GoTo, HoldStation
from firmware_py.plans.items import Command

__all__ = ["MissionInput", "MissionOutput", "update"]

ITEMS_PER_STEP: Final = 16  # that may be done with at once; the rest in the next step
IDLE_ITEMS: Final = 100  # done with at once, beyond those there are: then the jumps lead nowhere


class MissionOutput(msgspec.Struct, frozen=True):
    """The mission after a step, and the items that were reached; `home` and `fence_enabled` where an item sets them."""

    progress: MissionProgress
    reached: tuple[int, ...] = ()
    home: Place | None = None
    fence_enabled: bool | None = None


def update(progress: MissionProgress, given: MissionInput) -> MissionOutput:
    """Go through the items that are done with; `progress.task` is then what the boat is to do.

    Without a position it goes on as far as nothing asks where the boat is.
    """
    if progress.paused:
        centre = given.place if progress.pause_task is None else progress.pause_task.centre
        pause_task = None if centre is None else HoldStation(centre, given.settings.station_radius_m)
        return MissionOutput(replace(progress, pause_task=pause_task))
    reached: list[int] = []
    home: Place | None = None
    fence_enabled: bool | None = None
    for _ in range(ITEMS_PER_STEP):
        if progress.complete or progress.waiting:
            break
        if progress.index >= len(given.steps) or _leads_nowhere(progress, given):
            progress = _end(progress, given)
            break
        step = given.steps[progress.index]
        row = TABLE.get(step.command)
        if not progress.begun or (row is not None and row.chosen_anew):
            home_here = step.place or (given.place if given.spread_m == 0.0 else None)  # reckoned is not good enough
            begun = _begin(progress, step, given)
            if begun is None or (step.command is Command.SET_HOME and home_here is None):
                break
            progress = begun
            if step.command is Command.SET_HOME:
                home = home_here
            elif step.command is Command.FENCE_ENABLE:
                fence_enabled = step.enabled
        progress = _run_time(progress, step, given)
        if not _is_done(progress, step, given):
            progress = replace(progress, idle_items=0)
            break
        reached.append(progress.index)
        progress = after_item(progress, step) if step.autocontinue else replace(progress, waiting=True)
    if progress.task is None:
        # No item has given one yet: the boat stays, and does not drift.
        progress = replace(progress, task=station_task(progress, given))
    return MissionOutput(progress, tuple(reached), home, fence_enabled)


def _begin(progress: MissionProgress, step: MissionStep, given: MissionInput) -> MissionProgress | None:
    """Give the item's task; an item without one leaves the boat doing what it does; None: it cannot begin yet."""
    row = TABLE.get(step.command)
    if row is None:
        return replace(progress, begun=True)
    beginning = row.begin(progress, step, given)
    if beginning is None:
        return None
    task, line_start = beginning
    orbits = progress.orbits + (step.command is Command.LOITER_TURNS)
    return replace(progress, begun=True, task=task, line_start=line_start, orbits=orbits)


def _run_time(progress: MissionProgress, step: MissionStep, given: MissionInput) -> MissionProgress:
    """Let the item's time run; that from an arrival stands still while it is not known whether the boat is there."""
    row = TABLE.get(step.command)
    if row is None or not (row.timed_from_beginning or (_is_there(progress, given) and has_arrived(progress, given))):
        return progress
    progress = replace(progress, elapsed_s=progress.elapsed_s + given.step_s)
    if step.time_of_day_s is None or given.utc_s is None:
        return progress
    return replace(progress, until_utc_s=moment_of(step.time_of_day_s, given.utc_s, progress))


def _is_there(progress: MissionProgress, given: MissionInput) -> bool:
    task = progress.task
    return given.place is not None and (not isinstance(task, GoTo) or given.spread_m <= task.station_radius_m)


def _is_done(progress: MissionProgress, step: MissionStep, given: MissionInput) -> bool:
    row = TABLE.get(step.command)
    return row is None or row.is_done(progress, step, given)


def _leads_nowhere(progress: MissionProgress, given: MissionInput) -> bool:
    return progress.idle_items > len(given.steps) + IDLE_ITEMS


def _end(progress: MissionProgress, given: MissionInput) -> MissionProgress:
    """End the mission where it led; one that leads nowhere is unusable."""
    task = station_task(progress, given)
    if task is None:
        return progress  # without a position what was wanted last stands
    last = max(0, len(given.steps) - 1)
    unusable = not given.steps or _leads_nowhere(progress, given)
    return replace(
        progress,
        index=min(progress.index, last),
        begun=False,
        complete=True,
        unusable=unusable,
        task=task,
    )
