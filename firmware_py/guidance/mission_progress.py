"""Progress of a mission. It is stored for a restart of the autopilot; therefore its times are UTC or durations."""

from __future__ import annotations

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.common.reports import MissionState
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.tasks import HoldStation, Task
from firmware_py.plans.items import Command


class MissionProgress(msgspec.Struct, frozen=True):
    """Progress of the mission with checksum `identity`; `index` counts from 0.

    `started`: AUTO has executed it. `begun`: the item at `index` has its task. `unusable`: it is empty or an endless
    loop. `elapsed_s` is the time since the beginning of the item or since the arrival, depending on the command;
    `until_utc_s` is the end of a delay. `idle_items` counts consecutive items without duration, to detect an endless
    loop, `orbits` the begun LOITER_TURNS, and `jumps` the executed jumps of each jump item as (index, count).
    `line_start` is the start of the next line, None for the present position.
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
    """Return the progress for the loaded mission: a new mission begins at its first item."""
    if progress.identity == identity:
        return progress
    return MissionProgress(identity=identity, paused=progress.paused, pause_task=progress.pause_task)


def enter(progress: MissionProgress) -> MissionProgress:
    """Return the progress after a change to AUTO: the present item continues, a complete mission restarts.

    A halted mission stays halted, because a restart, arming or the end of a failsafe may also enter AUTO. If the
    operator selects AUTO, `resume_mission` is called.
    """
    if progress.complete or progress.unusable:
        progress = MissionProgress(identity=progress.identity)
    task = progress.task if progress.waiting else None
    return replace(progress, started=True, begun=progress.waiting, line_start=None, task=task, pause_task=None)


def at_item(progress: MissionProgress, index: int, *, restart: bool) -> MissionProgress:
    """Return the progress at another item."""
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
    """Return the progress at the following item: the next one, or the target of a jump."""
    index, jumps, idle_items = progress.index + 1, progress.jumps, progress.idle_items + 1
    if step.command is Command.JUMP:
        jump_count = dict(jumps).get(progress.index, 0)
        if step.target >= 0 and (step.times < 0 or jump_count < step.times):
            jumps = (*(pair for pair in jumps if pair[0] != progress.index), (progress.index, jump_count + 1))
            index = step.target
            if step.times >= 0:
                idle_items = 0  # the loop of a limited jump ends
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
    """Return the paused progress."""
    return replace(progress, paused=True, pause_task=None)


def resume_mission(progress: MissionProgress, steps: tuple[MissionStep, ...]) -> MissionProgress:
    """Return the resumed progress, also after an item without autocontinue; unchanged if it is not halted."""
    if not is_halted(progress):
        return progress
    if progress.waiting and progress.index < len(steps):
        progress = after_item(progress, steps[progress.index])
    return replace(progress, paused=False, pause_task=None)


def is_halted(progress: MissionProgress) -> bool:
    """Return whether the mission is paused by a request or after an item without autocontinue."""
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
