"""Sails a mission: which item is under way, what it has her do, and when it is done.

All that must outlive a restart of the autopilot is in `MissionProgress`, as durations and
not as moments. A mission ends in keeping station, never in drifting.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from firmware_py.common.angles import radians, wrap_pi, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.records import MissionState
from firmware_py.guidance.mission_step import SECONDS_PER_DAY, MissionStep, StepKind
from firmware_py.guidance.task_follower import TaskFollowerState
from firmware_py.guidance.tasks import GoTo, HoldHeading, HoldStation, Orbit, Task, TaskSettings, VesselMotion

ITEMS_PER_STEP = 16  # that may be done with at once; the rest in the next step
IDLE_ITEMS = 100  # done with at once, beyond those there are: then the jumps lead nowhere
ON_HEADING_RAD = radians(5.0)
LONGEST_TURN_S = 600.0


@dataclass(frozen=True, slots=True)
class MissionProgress:
    """How far the mission with checksum `identity` is; `index` counts from 0.

    `begun`: the item at index has its order. `elapsed_s` runs from the item's beginning, or
    from her arrival where it counts from there. `idle` counts the items done with since one
    last took time: many more than there are means a mission that leads nowhere.
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
    idle: int = 0
    orbits: int = 0
    jumps: tuple[tuple[int, int], ...] = ()
    place: Place | None = None  # where the next line begins
    order: Task | None = None
    halt: HoldStation | None = None  # what she does while paused


@dataclass(frozen=True, slots=True)
class MissionInput:
    """What a mission is sailed with in one step."""

    settings: TaskSettings
    steps: tuple[MissionStep, ...]
    motion: VesselMotion
    followed: TaskFollowerState
    step_s: float
    utc_s: float | None
    way_back: Callable[[], GoTo | None]


@dataclass(frozen=True, slots=True)
class MissionOutput:
    """What came of a step of the mission: `home` where an item sets it, else None."""

    progress: MissionProgress
    reached: tuple[int, ...] = ()
    home: Place | None = None


def for_plan(progress: MissionProgress, identity: int) -> MissionProgress:
    """Return the progress for the mission in force: a new mission begins at its first item."""
    if progress.identity == identity:
        return progress
    return MissionProgress(identity=identity, paused=progress.paused, halt=progress.halt)


def enter(progress: MissionProgress) -> MissionProgress:
    """Return the progress at the beginning of AUTO: on with the present item, anew after a complete mission."""
    if progress.complete or progress.unusable:
        progress = MissionProgress(identity=progress.identity)
    return replace(progress, started=True, begun=False, waiting=False, paused=False, place=None, order=None, halt=None)


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
        idle=0,
        jumps=() if restart else progress.jumps,
        place=None,
    )


def paused(progress: MissionProgress, steps: tuple[MissionStep, ...], *, halted: bool) -> MissionProgress:
    """Return the progress halted, or going on: also from an item without autocontinue that is done."""
    if not halted and progress.waiting and progress.index < len(steps):
        progress = _after(progress, steps[progress.index])
    return replace(progress, paused=halted, halt=None)


def state_of(progress: MissionProgress, count: int, *, running: bool) -> MissionState:
    """Return the state of the mission; `running`: she is armed and in AUTO."""
    if count == 0:
        return MissionState.NO_MISSION
    if progress.complete:
        return MissionState.COMPLETE
    if running:
        return MissionState.PAUSED if progress.paused else MissionState.ACTIVE
    return MissionState.PAUSED if progress.started else MissionState.NOT_STARTED


def update(progress: MissionProgress, voyage: MissionInput) -> MissionOutput:
    """Go through the items that are done with; `progress.order` is then what she is to do."""
    if progress.paused:
        halt = progress.halt or HoldStation(voyage.motion.place, voyage.settings.keep_m)
        return MissionOutput(replace(progress, halt=halt))
    reached: list[int] = []
    home: Place | None = None
    for _ in range(ITEMS_PER_STEP):
        if progress.complete or progress.waiting:
            break
        if progress.index >= len(voyage.steps) or _leads_nowhere(progress, voyage):
            progress = _ended(progress, voyage)
            break
        step = voyage.steps[progress.index]
        if not progress.begun:
            progress = _begun(progress, step, voyage)
            if step.kind is StepKind.SET_HOME:
                home = step.place or voyage.motion.place
        done, progress = _judged(progress, step, voyage)
        if not done:
            progress = replace(progress, idle=0)
            break
        reached.append(progress.index)
        progress = _next(progress, step)
    if progress.order is None:
        # No item has given one yet: she stays, and does not drift.
        progress = replace(progress, order=_staying(progress, voyage))
    return MissionOutput(progress, tuple(reached), home)


def _next(progress: MissionProgress, step: MissionStep) -> MissionProgress:
    if not step.autocontinue:
        return replace(progress, waiting=True)
    return _after(progress, step)


def _after(progress: MissionProgress, step: MissionStep) -> MissionProgress:
    index, jumps = progress.index + 1, progress.jumps
    if step.kind is StepKind.JUMP:
        made = dict(jumps).get(progress.index, 0)
        if step.target >= 0 and (step.times < 0 or made < step.times):
            jumps = (*(pair for pair in jumps if pair[0] != progress.index), (progress.index, made + 1))
            index = step.target
    return replace(
        progress, index=index, jumps=jumps, begun=False, waiting=False, elapsed_s=0.0, idle=progress.idle + 1
    )


def _leads_nowhere(progress: MissionProgress, voyage: MissionInput) -> bool:
    return progress.idle > len(voyage.steps) + IDLE_ITEMS


def _ended(progress: MissionProgress, voyage: MissionInput) -> MissionProgress:
    """End the mission where it led; one that leads nowhere is unusable."""
    last = max(0, len(voyage.steps) - 1)
    unusable = not voyage.steps or _leads_nowhere(progress, voyage)
    return replace(
        progress,
        index=min(progress.index, last),
        begun=False,
        complete=True,
        unusable=unusable,
        order=_staying(progress, voyage),
    )


def _staying(progress: MissionProgress, voyage: MissionInput) -> Task:
    """Return the order to keep station: at the place of the last order, else where she is."""
    order = progress.order
    if isinstance(order, GoTo | HoldStation):
        return order
    if isinstance(order, Orbit):
        return HoldStation(order.centre, voyage.settings.keep_m)
    return HoldStation(voyage.motion.place, voyage.settings.keep_m)


# --------------------------------------------------------------------- the kinds of items


def _begun(progress: MissionProgress, step: MissionStep, voyage: MissionInput) -> MissionProgress:
    """Give the item's order; an item without one leaves her doing what she does."""
    begin = None if step.kind is None else _ORDERS.get(step.kind)
    if begin is None:
        return replace(progress, begun=True)
    order, place = begin(progress, step, voyage)
    orbits = progress.orbits + (step.kind is StepKind.LOITER_TURNS)
    return replace(progress, begun=True, order=order, place=place, orbits=orbits)


Begun = tuple[Task, Place | None]


def _to_place(progress: MissionProgress, step: MissionStep, voyage: MissionInput) -> Begun:
    place = step.place or voyage.motion.place
    settings = voyage.settings
    if step.kind is StepKind.WAYPOINT:
        order = GoTo(place, progress.place, step.radius_m or settings.accept_m, settings.keep_m)
    else:
        order = GoTo(place, progress.place, settings.accept_m, step.radius_m or settings.keep_m)
    return order, place


def _round(progress: MissionProgress, step: MissionStep, voyage: MissionInput) -> Begun:
    place = step.place or voyage.motion.place
    return Orbit(place, step.radius_m or voyage.settings.keep_m, step.clockwise, progress.orbits), place


def _back(progress: MissionProgress, _step: MissionStep, voyage: MissionInput) -> Begun:
    order = voyage.way_back()
    return (_staying(progress, voyage), None) if order is None else (order, order.to)


def _to_heading(_progress: MissionProgress, step: MissionStep, voyage: MissionInput) -> Begun:
    base_rad = voyage.motion.heading_rad if step.relative else 0.0
    return HoldHeading(wrap_two_pi(base_rad + step.angle_rad)), None


def _delayed(progress: MissionProgress, _step: MissionStep, voyage: MissionInput) -> Begun:
    if isinstance(progress.order, HoldHeading):
        return progress.order, None
    return _staying(progress, voyage), progress.place


_ORDERS: Mapping[StepKind, Callable[[MissionProgress, MissionStep, MissionInput], Begun]] = {
    StepKind.WAYPOINT: _to_place,
    StepKind.LOITER_UNLIMITED: _to_place,
    StepKind.LOITER_TIME: _to_place,
    StepKind.LOITER_TURNS: _round,
    StepKind.RETURN: _back,
    StepKind.YAW: _to_heading,
    StepKind.YAW_SPEED: _to_heading,
    StepKind.DELAY: _delayed,
}


def _judged(progress: MissionProgress, step: MissionStep, voyage: MissionInput) -> tuple[bool, MissionProgress]:
    """Whether the item is done, and the progress with its time run on."""
    judge = None if step.kind is None else _JUDGES.get(step.kind)
    if judge is None:
        return True, progress
    # What the order before has reached says nothing of this one.
    arrived = voyage.followed.order == progress.order and voyage.followed.arrived
    counting = arrived or step.kind in _COUNT_FROM_BEGINNING
    progress = replace(progress, elapsed_s=progress.elapsed_s + voyage.step_s) if counting else progress
    return judge(progress, step, voyage, arrived), progress


def _after_hold(progress: MissionProgress, step: MissionStep, _voyage: MissionInput, arrived: bool) -> bool:  # noqa: FBT001
    return arrived and progress.elapsed_s >= step.seconds


def _never(_progress: MissionProgress, _step: MissionStep, _voyage: MissionInput, _arrived: bool) -> bool:  # noqa: FBT001
    return False


def _turned(_progress: MissionProgress, step: MissionStep, voyage: MissionInput, arrived: bool) -> bool:  # noqa: FBT001
    return arrived and voyage.followed.orbit.turned_rad >= 2.0 * math.pi * step.turns


def _at_end(_progress: MissionProgress, _step: MissionStep, _voyage: MissionInput, arrived: bool) -> bool:  # noqa: FBT001
    return arrived


def _on_heading(progress: MissionProgress, _step: MissionStep, voyage: MissionInput, _arrived: bool) -> bool:  # noqa: FBT001
    order = progress.order
    if not isinstance(order, HoldHeading) or progress.elapsed_s >= LONGEST_TURN_S:
        return True
    return abs(wrap_pi(order.heading_rad - voyage.motion.heading_rad)) <= ON_HEADING_RAD


def _delay_over(progress: MissionProgress, step: MissionStep, voyage: MissionInput, _arrived: bool) -> bool:  # noqa: FBT001
    if step.time_of_day_s is None:
        return progress.elapsed_s >= step.seconds
    if voyage.utc_s is None:
        return progress.elapsed_s >= SECONDS_PER_DAY
    # The moment has come when less than half a day has gone by since.
    since_s = (voyage.utc_s - step.time_of_day_s) % SECONDS_PER_DAY
    return since_s < min(0.5 * SECONDS_PER_DAY, progress.elapsed_s + voyage.step_s)


_COUNT_FROM_BEGINNING = frozenset({StepKind.DELAY, StepKind.YAW, StepKind.YAW_SPEED})
_JUDGES: Mapping[StepKind, Callable[[MissionProgress, MissionStep, MissionInput, bool], bool]] = {
    StepKind.WAYPOINT: _after_hold,
    StepKind.LOITER_UNLIMITED: _never,
    StepKind.LOITER_TIME: _after_hold,
    StepKind.LOITER_TURNS: _turned,
    StepKind.RETURN: _at_end,
    StepKind.YAW: _on_heading,
    StepKind.YAW_SPEED: _on_heading,
    StepKind.DELAY: _delay_over,
}
