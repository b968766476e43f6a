"""Mission execution: the current item, its task and its end. After the last item the boat keeps station."""

from __future__ import annotations

from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.geodesy import Place
from firmware_py.guidance.mission_commands import TABLE, MissionInput, has_arrived, next_utc_of, station_task
from firmware_py.guidance.mission_progress import MissionProgress, after_item
from firmware_py.guidance.mission_step import MissionStep
from firmware_py.guidance.tasks import GoTo, HoldStation
from firmware_py.plans.items import Command

__all__ = ["MissionInput", "MissionOutput", "update"]

MAX_ITEMS_PER_STEP: Final = 16  # items without duration; the others follow in the next step
MAX_IDLE_ITEMS: Final = 100  # consecutive items without duration, in addition to the length of the mission


class MissionOutput(msgspec.Struct, frozen=True):
    """Progress after a step, the items reached in it, and `home` and `fence_enabled` if an item has set them."""

    progress: MissionProgress
    reached: tuple[int, ...] = ()
    home: Place | None = None
    fence_enabled: bool | None = None


def update(progress: MissionProgress, inputs: MissionInput) -> MissionOutput:
    """Advance to the first item that is not done; `progress.task` is the task of the boat.

    Without a position the mission advances until an item needs one.
    """
    if progress.paused:
        centre = inputs.place if progress.pause_task is None else progress.pause_task.centre
        pause_task = None if centre is None else HoldStation(centre, inputs.settings.station_radius_m)
        return MissionOutput(replace(progress, pause_task=pause_task))
    reached: list[int] = []
    home: Place | None = None
    fence_enabled: bool | None = None
    for _ in range(MAX_ITEMS_PER_STEP):
        if progress.complete or progress.waiting:
            break
        if progress.index >= len(inputs.steps) or _is_endless(progress, inputs):
            progress = _complete(progress, inputs)
            break
        step = inputs.steps[progress.index]
        row = TABLE.get(step.command)
        if not progress.begun or (row is not None and row.restarts_each_step):
            new_home = step.place or (inputs.place if inputs.spread_m == 0.0 else None)  # only with a fix
            begun_progress = _begin(progress, step, inputs)
            if begun_progress is None or (step.command is Command.SET_HOME and new_home is None):
                break
            progress = begun_progress
            if step.command is Command.SET_HOME:
                home = new_home
            elif step.command is Command.FENCE_ENABLE:
                fence_enabled = step.enabled
        progress = _advance_timer(progress, step, inputs)
        if not _is_done(progress, step, inputs):
            progress = replace(progress, idle_items=0)
            break
        reached.append(progress.index)
        progress = after_item(progress, step) if step.autocontinue else replace(progress, waiting=True)
    if progress.task is None:
        # No item has set a task yet: keep station.
        progress = replace(progress, task=station_task(progress, inputs))
    return MissionOutput(progress, tuple(reached), home, fence_enabled)


def _begin(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> MissionProgress | None:
    """Return the progress at the begun item with its task, else the previous task; None if it cannot begin yet."""
    row = TABLE.get(step.command)
    if row is None:
        return replace(progress, begun=True)
    beginning = row.begin(progress, step, inputs)
    if beginning is None:
        return None
    task, line_start = beginning
    orbits = progress.orbits + (step.command is Command.LOITER_TURNS)
    return replace(progress, begun=True, task=task, line_start=line_start, orbits=orbits)


def _advance_timer(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> MissionProgress:
    """Advance the timer of the item; a timer that starts at the arrival stops while the position is uncertain."""
    row = TABLE.get(step.command)
    if row is None or not (
        row.timed_from_beginning or (_is_position_certain(progress, inputs) and has_arrived(progress, inputs))
    ):
        return progress
    progress = replace(progress, elapsed_s=progress.elapsed_s + inputs.step_s)
    if step.time_of_day_s is None or inputs.utc_s is None:
        return progress
    return replace(progress, until_utc_s=next_utc_of(step.time_of_day_s, inputs.utc_s, progress))


def _is_position_certain(progress: MissionProgress, inputs: MissionInput) -> bool:
    task = progress.task
    return inputs.place is not None and (not isinstance(task, GoTo) or inputs.spread_m <= task.station_radius_m)


def _is_done(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> bool:
    row = TABLE.get(step.command)
    return row is None or row.is_done(progress, step, inputs)


def _is_endless(progress: MissionProgress, inputs: MissionInput) -> bool:
    return progress.idle_items > len(inputs.steps) + MAX_IDLE_ITEMS


def _complete(progress: MissionProgress, inputs: MissionInput) -> MissionProgress:
    """Return the completed mission, which keeps station; a mission with an endless loop is unusable."""
    task = station_task(progress, inputs)
    if task is None:
        return progress  # no position: the last target is kept
    last_index = max(0, len(inputs.steps) - 1)
    is_unusable = not inputs.steps or _is_endless(progress, inputs)
    return replace(
        progress, index=min(progress.index, last_index), begun=False, complete=True, unusable=is_unusable, task=task
    )
