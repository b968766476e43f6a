"""How far a mission is: all of it that must outlive a restart of the autopilot, with no moment but in UTC."""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.reports import MissionState
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.tasks import HoldStation, Task
from firmware_py.plans.items import Command


class MissionProgress(msgspec.Struct, frozen=True):
    """How far the mission with checksum `identity` is; `index` counts from 0.

    `begun`: the item at index has its task. `elapsed_s` runs from the item's beginning, or
    from the arrival where it counts from there; `until_utc_s` is the time of day that it waits
    for. `idle_items` counts the items done with since one last took time: many more than there are
    means a mission that leads nowhere.
    """

    identity: int = 0
    index: int = 0
    started: bool = False
    begun: bool = False
    waiting: bool = False  # at an item without autocontinue
    complete: bool = False
    paused: bool = False
    unusable: bool = False
    elapsed_s: float = 0.0
    until_utc_s: float | None = None
    idle_items: int = 0
    orbits: int = 0
    jumps: tuple[tuple[int, int], ...] = ()
    line_start: Place | None = None
    task: Task | None = None
    pause_task: HoldStation | None = None


def for_plan(progress: MissionProgress, identity: int) -> MissionProgress:
    """Return the progress for the mission in force: a new mission begins at its first item."""
    if progress.identity == identity:
        return progress
    return MissionProgress(identity=identity, paused=progress.paused, pause_task=progress.pause_task)


def enter(progress: MissionProgress) -> MissionProgress:
    """Return the progress at the beginning of AUTO: on with the present item, anew after a complete mission.

    A mission that is halted stays so, because a restart, an arming or the end of a failsafe may lead here; that an
    operator asks for AUTO is another thing (`go_on`).
    """
    if progress.complete or progress.unusable:
        progress = MissionProgress(identity=progress.identity)
    task = progress.task if progress.waiting else None
    return replace(progress, started=True, begun=progress.waiting, line_start=None, task=task, pause_task=None)


def at_item(progress: MissionProgress, index: int, *, restart: bool) -> MissionProgress:
    """Return the progress with another item under way."""
    return replace(
        progress,
        index=index,
        begun=False,
        waiting=False,
        complete=False,
        unusable=False,
        elapsed_s=0.0,
        until_utc_s=None,
        idle_items=0,
        jumps=() if restart else progress.jumps,
        line_start=None,
    )


def after_item(progress: MissionProgress, step: MissionStep) -> MissionProgress:
    """Return the progress at the item that follows one that is done: the next one, or where a jump leads."""
    index, jumps, idle_items = progress.index + 1, progress.jumps, progress.idle_items + 1
    if step.command is Command.JUMP:
        made = dict(jumps).get(progress.index, 0)
        if step.target >= 0 and (step.times < 0 or made < step.times):
            jumps = (*(pair for pair in jumps if pair[0] != progress.index), (progress.index, made + 1))
            index = step.target
            if step.times >= 0:
                idle_items = 0  # a time less: whatever it goes round over, it comes to an end
    return replace(
        progress,
        index=index,
        jumps=jumps,
        begun=False,
        waiting=False,
        elapsed_s=0.0,
        until_utc_s=None,
        idle_items=idle_items,
    )


def pause(progress: MissionProgress) -> MissionProgress:
    """Return the progress halted."""
    return replace(progress, paused=True, pause_task=None)


def go_on(progress: MissionProgress, steps: tuple[MissionStep, ...]) -> MissionProgress:
    """Return the progress going on, also from an item without autocontinue that is done; the same if nothing halts."""
    if not is_halted(progress):
        return progress
    if progress.waiting and progress.index < len(steps):
        progress = after_item(progress, steps[progress.index])
    return replace(progress, paused=False, pause_task=None)


def is_halted(progress: MissionProgress) -> bool:
    """Return whether the mission waits to be told to go on: by a request, or after an item without autocontinue."""
    return progress.paused or progress.waiting


def state_of(progress: MissionProgress, count: int, *, running: bool) -> MissionState:
    """Return the state of the mission; `running`: the boat is armed and in AUTO."""
    if count == 0:
        return MissionState.NO_MISSION
    if progress.complete:
        return MissionState.COMPLETE
    if running:
        return MissionState.PAUSED if is_halted(progress) else MissionState.ACTIVE
    return MissionState.PAUSED if progress.started else MissionState.NOT_STARTED
