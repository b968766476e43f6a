"""Conversion of MAVLink mission items to SI units.

Meaning of the items for a boat that cannot stop:

| item | the boat |
| --- | --- |
| NAV_WAYPOINT | follows the line from the last waypoint; with a hold time (param1) keeps station there for that time |
| NAV_LOITER_UNLIM | goes there and keeps station until another item is set (param3: radius) |
| NAV_LOITER_TIME | goes there and keeps station for param1 seconds from the arrival (param3: radius) |
| NAV_LOITER_TURNS | circles the place param1 times (param3: radius, negative: anticlockwise) |
| NAV_RETURN_TO_LAUNCH | goes home or to the best rally point; to a new home if it is changed |
| NAV_DELAY | continues for param1 seconds, or until a time of day (UTC): on a heading after a heading item, otherwise keeping station |
| CONDITION_DELAY | as NAV_DELAY for param1 seconds; the next items wait |
| CONDITION_DISTANCE | goes to the next waypoint or loiter item; the items in between wait until the distance to it is at most param1 metres |
| CONDITION_YAW, NAV_SET_YAW_SPEED | turns to the heading; ends within 5 deg of it, or after 10 min. A following NAV_DELAY keeps that heading; the speed is ignored |
| DO_JUMP | continues with item param1 (an index here, one more on the link), param2 times, -1: always |
| DO_JUMP_TAG | continues with the first JUMP_TAG of tag param1, param2 times, -1: always |
| DO_FENCE_ENABLE | enables (param1 = 1) or disables (0) the fence, in all modes |
| DO_CHANGE_SPEED | no effect: the speed is for planning only |
| DO_SET_HOME | sets home to the present position (param1 = 1) or to the place of the item |

Relative angles are relative to the heading at the beginning of the item. After an item without autocontinue the
mission pauses: the task of the item continues until DO_PAUSE_CONTINUE, MISSION_START, AUTO or another item is
commanded. Headings and delays on a heading need no position; other items wait for one.

A waypoint or loiter item at (0, 0) means the present position.
"""  # noqa: E501 - a table

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, limit_number, place_of
from firmware_py.plans.items import MAX_DISTANCE_M, MAX_DURATION_S, MAX_TURNS, Command
from firmware_py.plans.sequence import next_places, tags_of

MAX_RADIUS_M = 100_000.0
SECONDS_PER_DAY = 86_400


class MissionStep(msgspec.Struct, frozen=True):
    """A mission item in SI units; fields that a command does not use keep their defaults."""

    command: Command | None  # None: the item is skipped
    place: Place | None = None
    radius_m: float | None = None  # None: the parameter applies
    seconds: float = 0.0
    time_of_day_s: float | None = None  # UTC
    turns: float = 0.0
    clockwise: bool = True
    angle_rad: float = 0.0
    relative: bool = False
    distance_m: float = 0.0
    enabled: bool = False
    target: int = 0  # index of the item to jump to; negative: none
    times: int = 0  # -1: always
    autocontinue: bool = True


@functools.lru_cache(maxsize=4)
def convert_mission(mission: Plan) -> tuple[MissionStep, ...]:
    """Convert a mission and resolve references between items; cached."""
    items, tags = mission.items, tags_of(mission.items)
    return tuple(_resolve_references(items, tags, *pair) for pair in zip(items, next_places(items), strict=True))


def _resolve_references(
    items: Sequence[PlanItem], tags: Mapping[int, int], item: PlanItem, next_place: int | None
) -> MissionStep:
    step = convert_item(item)
    if step.command is Command.CONDITION_DISTANCE and next_place is not None:
        return replace(step, place=place_of(items[next_place]))
    if item.command == Command.JUMP_TO_TAG:
        return replace(step, target=tags.get(round(limit_number(item.params[0], 0.0, 65535.0)), -1))
    return step


def convert_item(item: PlanItem) -> MissionStep:
    """Convert an item; all numbers of the step are finite and in range, also for an invalid item."""
    convert = _CONVERTERS.get(item.command)
    if convert is None:
        return MissionStep(None, autocontinue=item.autocontinue)
    return convert(item)


def _convert_radius(value: float) -> float | None:
    return limit_number(abs(value), 0.0, MAX_RADIUS_M) or None


def _convert_waypoint(item: PlanItem) -> MissionStep:
    hold_s, radius = item.params[:2]
    return MissionStep(
        Command.WAYPOINT,
        place_of(item),
        _convert_radius(radius),
        limit_number(hold_s, 0.0, MAX_DURATION_S),
        autocontinue=item.autocontinue,
    )


def _convert_loiter(item: PlanItem) -> MissionStep:
    amount, _, radius, _ = item.params
    return MissionStep(
        Command(item.command),
        place_of(item),
        _convert_radius(radius),
        limit_number(amount, 0.0, MAX_DURATION_S),
        turns=limit_number(amount, 0.0, MAX_TURNS),
        clockwise=not radius < 0.0,
        autocontinue=item.autocontinue,
    )


def _convert_delay(item: PlanItem) -> MissionStep:
    seconds, hour, minute, second = item.params
    time_of_day_s = None
    if seconds < 0.0 or (math.isnan(seconds) and hour >= 0.0):
        clock_s = (
            3600.0 * limit_number(hour, 0.0, 23.0)
            + 60.0 * limit_number(minute, 0.0, 59.0)
            + limit_number(second, 0.0, 60.0)
        )
        time_of_day_s = clock_s % SECONDS_PER_DAY
    return MissionStep(
        Command.DELAY,
        seconds=limit_number(seconds, 0.0, MAX_DURATION_S),
        time_of_day_s=time_of_day_s,
        autocontinue=item.autocontinue,
    )


def _convert_yaw(item: PlanItem) -> MissionStep:
    angle_deg, _, direction, relative = item.params
    sign = -1.0 if relative == 1.0 and direction < 0.0 else 1.0
    return _make_heading_step(item, sign * limit_number(angle_deg, -360.0, 360.0), relative=relative == 1.0)


def _convert_yaw_speed(item: PlanItem) -> MissionStep:
    angle_deg, _, relative, _ = item.params
    return _make_heading_step(item, limit_number(angle_deg, -360.0, 360.0), relative=relative == 1.0)


def _make_heading_step(item: PlanItem, angle_deg: float, *, relative: bool) -> MissionStep:
    return MissionStep(
        Command(item.command),
        angle_rad=wrap_two_pi(radians(angle_deg)),
        relative=relative,
        autocontinue=item.autocontinue,
    )


def _convert_jump(item: PlanItem) -> MissionStep:
    target, times = item.params[:2]
    return MissionStep(
        Command.JUMP,
        target=round(limit_number(target, -1.0, 1e6)),
        times=round(limit_number(times, -1.0, 1e6)),
        autocontinue=item.autocontinue,
    )


def _convert_condition_distance(item: PlanItem) -> MissionStep:
    distance_m = limit_number(item.params[0], 0.0, MAX_DISTANCE_M)
    return MissionStep(Command.CONDITION_DISTANCE, distance_m=distance_m, autocontinue=item.autocontinue)


def _convert_condition_delay(item: PlanItem) -> MissionStep:
    seconds = limit_number(item.params[0], 0.0, MAX_DURATION_S)
    return MissionStep(Command.CONDITION_DELAY, seconds=seconds, autocontinue=item.autocontinue)


def _convert_fence_enable(item: PlanItem) -> MissionStep:
    return MissionStep(Command.FENCE_ENABLE, enabled=item.params[0] == 1.0, autocontinue=item.autocontinue)


def _convert_set_home(item: PlanItem) -> MissionStep:
    uses_present = item.params[0] == 1.0
    return MissionStep(Command.SET_HOME, None if uses_present else place_of(item), autocontinue=item.autocontinue)


def _convert_without_parameters(item: PlanItem) -> MissionStep:
    return MissionStep(Command(item.command), autocontinue=item.autocontinue)


_CONVERTERS: Mapping[int, Callable[[PlanItem], MissionStep]] = {
    Command.WAYPOINT: _convert_waypoint,
    Command.LOITER_UNLIMITED: _convert_loiter,
    Command.LOITER_TURNS: _convert_loiter,
    Command.LOITER_TIME: _convert_loiter,
    Command.RETURN: _convert_without_parameters,
    Command.DELAY: _convert_delay,
    Command.CONDITION_DELAY: _convert_condition_delay,
    Command.CONDITION_DISTANCE: _convert_condition_distance,
    Command.YAW: _convert_yaw,
    Command.JUMP: _convert_jump,
    Command.JUMP_TAG: _convert_without_parameters,
    Command.JUMP_TO_TAG: _convert_jump,  # with the target of convert_mission
    Command.FENCE_ENABLE: _convert_fence_enable,
    Command.CHANGE_SPEED: _convert_without_parameters,
    Command.SET_HOME: _convert_set_home,
    Command.YAW_SPEED: _convert_yaw_speed,
}
