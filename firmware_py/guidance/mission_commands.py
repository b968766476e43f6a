"""Table of the mission commands with a duration: task and end condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from firmware_py.common.angles import radians, wrap_pi, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.guidance.mission_progress import MissionProgress
from firmware_py.guidance.mission_step import SECONDS_PER_DAY, MissionStep
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, HoldHeading, HoldStation, Orbit, Task, TaskSettings
from firmware_py.plans.items import Command

HEADING_TOLERANCE_RAD: Final = radians(5.0)
MAX_TURN_S: Final = 600.0  # then the item ends also on another heading


class MissionInput(msgspec.Struct, frozen=True):
    """Inputs of a mission step; `heading_rad` and `place` are None while unknown.

    `return_task` returns the task of RTL; it keeps the destination of the present return task while that is valid.
    """

    settings: TaskSettings
    steps: tuple[MissionStep, ...]
    heading_rad: float | None
    place: Place | None
    follower: TaskFollowerState
    step_s: float
    utc_s: float | None
    return_task: Callable[[Task | None], GoTo | None]
    spread_m: float = 0.0  # position error under dead reckoning


TaskAndLineStart = tuple[Task, Place | None]


class CommandRow(msgspec.Struct, frozen=True):
    """Functions of a command: `begin` returns its task and the start of the next line, `is_done` whether it has ended.

    `begin` returns None while position or heading is missing. With `restarts_each_step` it is called in each step,
    because its result may change. The timer starts at the arrival, or at the beginning with `timed_from_beginning`.
    """

    begin: Callable[[MissionProgress, MissionStep, MissionInput], TaskAndLineStart | None]
    is_done: Callable[[MissionProgress, MissionStep, MissionInput], bool]
    timed_from_beginning: bool = False
    restarts_each_step: bool = False


def has_arrived(progress: MissionProgress, inputs: MissionInput) -> bool:
    """Return whether the boat has arrived at the place of the present item, not only at that of the last task."""
    return inputs.follower.task == progress.task and inputs.follower.arrived


def station_task(progress: MissionProgress, inputs: MissionInput) -> Task | None:
    """Return the task to keep station at the place of the last task, or at the present position; None if unknown."""
    task = progress.task
    if isinstance(task, GoTo | HoldStation):
        return task
    place = task.centre if isinstance(task, Orbit) else inputs.place
    return None if place is None else HoldStation(place, inputs.settings.station_radius_m)


def next_utc_of(time_of_day_s: float, utc_s: float, progress: MissionProgress) -> float:
    """Return the first UTC time after the beginning of the item that has a time of day, in seconds.

    A stored time is kept, so that it can also pass during an interruption; it is recomputed if the clock is set back.
    """
    stored_utc_s = progress.until_utc_s
    if stored_utc_s is not None and stored_utc_s - utc_s <= SECONDS_PER_DAY:
        return stored_utc_s
    start_utc_s = utc_s - progress.elapsed_s
    return start_utc_s + (time_of_day_s - start_utc_s) % SECONDS_PER_DAY


def _begin_go_to(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    place = step.place or inputs.place
    if place is None:
        return None
    settings = inputs.settings
    acceptance_m, station_m = settings.acceptance_radius_m, settings.station_radius_m
    if step.command is Command.WAYPOINT:
        return GoTo(place, progress.line_start, step.radius_m or acceptance_m, station_m), place
    return GoTo(place, progress.line_start, acceptance_m, step.radius_m or station_m), place


def _begin_orbit(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    place = step.place or inputs.place
    if place is None:
        return None
    return Orbit(place, step.radius_m or inputs.settings.station_radius_m, step.clockwise, progress.orbits), place


def _begin_return(progress: MissionProgress, _step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    if inputs.place is None:
        return None
    task = inputs.return_task(progress.task if progress.begun else None)
    return (task, task.place) if task is not None else _begin_station(progress, inputs, None)


def _begin_hold_heading(_progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    base_rad = inputs.heading_rad if step.relative else 0.0
    return None if base_rad is None else (HoldHeading(wrap_two_pi(base_rad + step.angle_rad)), None)


def _begin_delay(progress: MissionProgress, _step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    if isinstance(progress.task, HoldHeading):
        return progress.task, None
    return _begin_station(progress, inputs, progress.line_start)


def _begin_approach(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> TaskAndLineStart | None:
    """Follow the line to the next place; the item of that place continues on the same line."""
    if step.place is None:
        return _begin_station(progress, inputs, progress.line_start)
    settings = inputs.settings
    task = GoTo(step.place, progress.line_start, settings.acceptance_radius_m, settings.station_radius_m)
    return task, progress.line_start


def _begin_station(
    progress: MissionProgress, inputs: MissionInput, line_start: Place | None
) -> TaskAndLineStart | None:
    task = station_task(progress, inputs)
    return None if task is None else (task, line_start)


def _is_hold_over(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> bool:
    return has_arrived(progress, inputs) and progress.elapsed_s >= step.seconds


def _is_never_done(_progress: MissionProgress, _step: MissionStep, _inputs: MissionInput) -> bool:
    return False


def _has_made_turns(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> bool:
    return has_arrived(progress, inputs) and inputs.follower.orbit.turned_rad >= 2.0 * math.pi * step.turns


def _is_reached(progress: MissionProgress, _step: MissionStep, inputs: MissionInput) -> bool:
    return has_arrived(progress, inputs)


def _is_on_heading(progress: MissionProgress, _step: MissionStep, inputs: MissionInput) -> bool:
    task = progress.task
    if not isinstance(task, HoldHeading) or progress.elapsed_s >= MAX_TURN_S:
        return True
    return (
        inputs.heading_rad is not None and abs(wrap_pi(task.heading_rad - inputs.heading_rad)) <= HEADING_TOLERANCE_RAD
    )


def _is_delay_over(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> bool:
    if step.time_of_day_s is None:
        return progress.elapsed_s >= step.seconds
    if inputs.utc_s is None or progress.until_utc_s is None:
        return progress.elapsed_s >= SECONDS_PER_DAY
    return inputs.utc_s >= progress.until_utc_s


def _is_near(progress: MissionProgress, step: MissionStep, inputs: MissionInput) -> bool:
    if step.place is None or has_arrived(progress, inputs):
        return True
    if inputs.place is None or inputs.spread_m > step.distance_m:
        return False
    return inputs.place.distance_and_bearing(step.place)[0] <= step.distance_m


# Other commands have no duration and leave the task unchanged.
TABLE: Final[Mapping[Command | None, CommandRow]] = {
    Command.WAYPOINT: CommandRow(_begin_go_to, _is_hold_over),
    Command.LOITER_UNLIMITED: CommandRow(_begin_go_to, _is_never_done),
    Command.LOITER_TIME: CommandRow(_begin_go_to, _is_hold_over),
    Command.LOITER_TURNS: CommandRow(_begin_orbit, _has_made_turns),
    Command.RETURN: CommandRow(_begin_return, _is_reached, restarts_each_step=True),
    Command.YAW: CommandRow(_begin_hold_heading, _is_on_heading, timed_from_beginning=True),
    Command.YAW_SPEED: CommandRow(_begin_hold_heading, _is_on_heading, timed_from_beginning=True),
    Command.CONDITION_DELAY: CommandRow(_begin_delay, _is_delay_over, timed_from_beginning=True),
    Command.CONDITION_DISTANCE: CommandRow(_begin_approach, _is_near),
    Command.DELAY: CommandRow(_begin_delay, _is_delay_over, timed_from_beginning=True),
}
