"""What each command of a mission has the boat do, and when it is done: one row for each that takes time."""

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

ON_HEADING_RAD: Final = radians(5.0)
LONGEST_TURN_S: Final = 600.0


class MissionInput(msgspec.Struct, frozen=True):
    """What a mission is sailed with in one step.

    Without a heading or a place `heading_rad` or `place` is None. `return_task` takes the way back that was chosen
    before, and keeps to it while its place is one to return to.
    """

    settings: TaskSettings
    steps: tuple[MissionStep, ...]
    heading_rad: float | None
    place: Place | None
    follower: TaskFollowerState
    step_s: float
    utc_s: float | None
    return_task: Callable[[Task | None], GoTo | None]
    spread_m: float = 0.0  # of a place that is reckoned


Beginning = tuple[Task, Place | None]


class CommandRow(msgspec.Struct, frozen=True):
    """The task that a command begins, with the place that the next line starts from, and whether it is done.

    `begin` is None while it cannot begin, because it is not known where the boat is or how it heads. One that is
    `chosen_anew` begins in each step: what it goes by may change under way.

    Its time runs from the arrival, or from its beginning when `timed_from_beginning`.
    """

    begin: Callable[[MissionProgress, MissionStep, MissionInput], Beginning | None]
    is_done: Callable[[MissionProgress, MissionStep, MissionInput], bool]
    timed_from_beginning: bool = False
    chosen_anew: bool = False


def has_arrived(progress: MissionProgress, given: MissionInput) -> bool:
    """Return whether the task of the present item has arrived; what the task before has reached says nothing of it."""
    return given.follower.task == progress.task and given.follower.arrived


def station_task(progress: MissionProgress, given: MissionInput) -> Task | None:
    """Return the task to keep station: at the place of the last task, else where the boat is, if that is known."""
    task = progress.task
    if isinstance(task, GoTo | HoldStation):
        return task
    place = task.centre if isinstance(task, Orbit) else given.place
    return None if place is None else HoldStation(place, given.settings.station_radius_m)


def moment_of(time_of_day_s: float, utc_s: float, progress: MissionProgress) -> float:
    """Return when a time of day comes first after the item's beginning, in UTC; once known it stays.

    So it has come, too, when the boat was about something else then. Of a clock that was put back it is found anew.
    """
    known = progress.until_utc_s
    if known is not None and known - utc_s <= SECONDS_PER_DAY:
        return known
    begun_utc_s = utc_s - progress.elapsed_s
    return begun_utc_s + (time_of_day_s - begun_utc_s) % SECONDS_PER_DAY


# ------------------------------------------------------------------------------- beginnings


def _go_to(progress: MissionProgress, step: MissionStep, given: MissionInput) -> Beginning | None:
    place = step.place or given.place
    if place is None:
        return None
    settings = given.settings
    acceptance_m, station_m = settings.acceptance_radius_m, settings.station_radius_m
    if step.command is Command.WAYPOINT:
        return GoTo(place, progress.line_start, step.radius_m or acceptance_m, station_m), place
    return GoTo(place, progress.line_start, acceptance_m, step.radius_m or station_m), place


def _orbit(progress: MissionProgress, step: MissionStep, given: MissionInput) -> Beginning | None:
    place = step.place or given.place
    if place is None:
        return None
    return Orbit(place, step.radius_m or given.settings.station_radius_m, step.clockwise, progress.orbits), place


def _return(progress: MissionProgress, _step: MissionStep, given: MissionInput) -> Beginning | None:
    if given.place is None:
        return None
    task = given.return_task(progress.task if progress.begun else None)
    return (task, task.place) if task is not None else _station(progress, given, None)


def _hold_heading(_progress: MissionProgress, step: MissionStep, given: MissionInput) -> Beginning | None:
    base_rad = given.heading_rad if step.relative else 0.0
    return None if base_rad is None else (HoldHeading(wrap_two_pi(base_rad + step.angle_rad)), None)


def _delay(progress: MissionProgress, _step: MissionStep, given: MissionInput) -> Beginning | None:
    if isinstance(progress.task, HoldHeading):
        return progress.task, None
    return _station(progress, given, progress.line_start)


def _approach(progress: MissionProgress, step: MissionStep, given: MissionInput) -> Beginning | None:
    """Sail the line to the next place, which the item of that place will go on with."""
    if step.place is None:
        return _station(progress, given, progress.line_start)
    settings = given.settings
    task = GoTo(step.place, progress.line_start, settings.acceptance_radius_m, settings.station_radius_m)
    return task, progress.line_start


def _station(progress: MissionProgress, given: MissionInput, line_start: Place | None) -> Beginning | None:
    task = station_task(progress, given)
    return None if task is None else (task, line_start)


# ------------------------------------------------------------------------------------- ends


def _after_hold(progress: MissionProgress, step: MissionStep, given: MissionInput) -> bool:
    return has_arrived(progress, given) and progress.elapsed_s >= step.seconds


def _never(_progress: MissionProgress, _step: MissionStep, _given: MissionInput) -> bool:
    return False


def _turns_made(progress: MissionProgress, step: MissionStep, given: MissionInput) -> bool:
    return has_arrived(progress, given) and given.follower.orbit.turned_rad >= 2.0 * math.pi * step.turns


def _on_arrival(progress: MissionProgress, _step: MissionStep, given: MissionInput) -> bool:
    return has_arrived(progress, given)


def _on_heading(progress: MissionProgress, _step: MissionStep, given: MissionInput) -> bool:
    task = progress.task
    if not isinstance(task, HoldHeading) or progress.elapsed_s >= LONGEST_TURN_S:
        return True
    return given.heading_rad is not None and abs(wrap_pi(task.heading_rad - given.heading_rad)) <= ON_HEADING_RAD


def _delay_over(progress: MissionProgress, step: MissionStep, given: MissionInput) -> bool:
    if step.time_of_day_s is None:
        return progress.elapsed_s >= step.seconds
    if given.utc_s is None or progress.until_utc_s is None:
        return progress.elapsed_s >= SECONDS_PER_DAY
    return given.utc_s >= progress.until_utc_s


def _near(progress: MissionProgress, step: MissionStep, given: MissionInput) -> bool:
    if step.place is None or has_arrived(progress, given):
        return True
    if given.place is None or given.spread_m > step.distance_m:
        return False
    return given.place.distance_and_bearing(step.place)[0] <= step.distance_m


# A command that is not here takes no time and leaves the boat doing what it does.
TABLE: Final[Mapping[Command | None, CommandRow]] = {
    Command.WAYPOINT: CommandRow(_go_to, _after_hold),
    Command.LOITER_UNLIMITED: CommandRow(_go_to, _never),
    Command.LOITER_TIME: CommandRow(_go_to, _after_hold),
    Command.LOITER_TURNS: CommandRow(_orbit, _turns_made),
    Command.RETURN: CommandRow(_return, _on_arrival, chosen_anew=True),
    Command.YAW: CommandRow(_hold_heading, _on_heading, timed_from_beginning=True),
    Command.YAW_SPEED: CommandRow(_hold_heading, _on_heading, timed_from_beginning=True),
    Command.CONDITION_DELAY: CommandRow(_delay, _delay_over, timed_from_beginning=True),
    Command.CONDITION_DISTANCE: CommandRow(_approach, _near),
    Command.DELAY: CommandRow(_delay, _delay_over, timed_from_beginning=True),
}
