"""Mission items in the units of the boat: the one place where MAVLink's numbers are converted.

What an item means for a boat that cannot stop:

| item | the boat |
| --- | --- |
| NAV_WAYPOINT | sails the line from the last place to it; with a hold time (param1) keeps station there so long |
| NAV_LOITER_UNLIM | goes there and keeps station until another item is asked for (param3: radius) |
| NAV_LOITER_TIME | goes there and keeps station for param1 seconds from the arrival (param3: radius) |
| NAV_LOITER_TURNS | goes round it param1 times (param3: radius, negative: anticlockwise) |
| NAV_RETURN_TO_LAUNCH | goes home or to the best rally point; where home is set meanwhile, to that |
| NAV_DELAY | goes on with what it does for param1 seconds, or until a time of day (UTC): with a heading after a heading item, otherwise keeping station |
| CONDITION_DELAY | as NAV_DELAY for param1 seconds; the items after it wait |
| CONDITION_DISTANCE | sails to the place of the next waypoint or loiter item; the items before that one wait until it is within param1 metres |
| CONDITION_YAW, NAV_SET_YAW_SPEED | turns to the heading; the item ends when it is within 5 deg of that, or after 10 min. A NAV_DELAY after it holds that heading; the speed is the sea's |
| DO_JUMP | goes on with item param1 (an index here, the link's is one more), param2 times, -1: always |
| DO_JUMP_TAG | goes on with the first JUMP_TAG of tag param1, param2 times, -1: always |
| DO_FENCE_ENABLE | heeds the fence from now on (param1 = 1) or not (0), whatever mode follows |
| DO_CHANGE_SPEED | nothing: a speed for planning |
| DO_SET_HOME | sets home, to where it is (param1 = 1) or to the place |

Relative angles count from the heading that the boat has when the item begins. An item without autocontinue halts the
mission when it is done: the boat goes on with what she does there, and the mission is paused until it is told to go on
(DO_PAUSE_CONTINUE, MISSION_START or AUTO asked for again, another item set). Headings and delays on a heading need no
position; what does waits for one.

Without a place (0, 0) a waypoint or loiter item means where the boat is.
"""  # noqa: E501 - a table

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.plan import Plan, PlanItem, number, place_of
from firmware_py.plans.items import FARTHEST_M, LONGEST_S, MOST_TURNS, Command
from firmware_py.plans.sequence import next_places, tags_of

LARGEST_RADIUS_M = 100_000.0
SECONDS_PER_DAY = 86_400


class MissionStep(msgspec.Struct, frozen=True):
    """One item in the units of the boat; what an item does not have stands at its default."""

    command: Command | None  # None: an item that is passed over
    place: Place | None = None
    radius_m: float | None = None  # None: the parameter's
    seconds: float = 0.0
    time_of_day_s: float | None = None
    turns: float = 0.0
    clockwise: bool = True
    angle_rad: float = 0.0
    relative: bool = False
    distance_m: float = 0.0
    enabled: bool = False
    target: int = 0
    times: int = 0  # -1: always
    autocontinue: bool = True


@functools.lru_cache(maxsize=4)
def steps_of(mission: Plan) -> tuple[MissionStep, ...]:
    """Convert a mission, once; what refers to another item is resolved."""
    items, tags = mission.items, tags_of(mission.items)
    return tuple(_resolved(items, tags, *pair) for pair in zip(items, next_places(items), strict=True))


def _resolved(items: Sequence[PlanItem], tags: Mapping[int, int], item: PlanItem, following: int | None) -> MissionStep:
    step = step_of(item)
    if step.command is Command.CONDITION_DISTANCE and following is not None:
        return replace(step, place=place_of(items[following]))
    if item.command == Command.JUMP_TO_TAG:
        return replace(step, target=tags.get(round(number(item.params[0], 0.0, 65535.0)), -1))
    return step


def step_of(item: PlanItem) -> MissionStep:
    """Convert an item; whatever numbers it holds, those of the step are finite and in range."""
    reader = _READERS.get(item.command)
    if reader is None:
        return MissionStep(None, autocontinue=item.autocontinue)
    return reader(item)


def _radius(value: float) -> float | None:
    return number(abs(value), 0.0, LARGEST_RADIUS_M) or None


def _waypoint(item: PlanItem) -> MissionStep:
    hold, radius = item.params[:2]
    return MissionStep(
        Command.WAYPOINT,
        place_of(item),
        _radius(radius),
        number(hold, 0.0, LONGEST_S),
        autocontinue=item.autocontinue,
    )


def _loiter(item: PlanItem) -> MissionStep:
    amount, _, radius, _ = item.params
    return MissionStep(
        Command(item.command),
        place_of(item),
        _radius(radius),
        number(amount, 0.0, LONGEST_S),
        turns=number(amount, 0.0, MOST_TURNS),
        clockwise=not radius < 0.0,
        autocontinue=item.autocontinue,
    )


def _delay(item: PlanItem) -> MissionStep:
    seconds, hour, minute, second = item.params
    time_of_day_s = None
    if seconds < 0.0 or (math.isnan(seconds) and hour >= 0.0):
        clock_s = 3600.0 * number(hour, 0.0, 23.0) + 60.0 * number(minute, 0.0, 59.0) + number(second, 0.0, 60.0)
        time_of_day_s = clock_s % SECONDS_PER_DAY
    return MissionStep(
        Command.DELAY,
        seconds=number(seconds, 0.0, LONGEST_S),
        time_of_day_s=time_of_day_s,
        autocontinue=item.autocontinue,
    )


def _yaw(item: PlanItem) -> MissionStep:
    angle_deg, _, direction, relative = item.params
    sign = -1.0 if relative == 1.0 and direction < 0.0 else 1.0
    return _heading(item, sign * number(angle_deg, -360.0, 360.0), relative=relative == 1.0)


def _yaw_speed(item: PlanItem) -> MissionStep:
    angle_deg, _, relative, _ = item.params
    return _heading(item, number(angle_deg, -360.0, 360.0), relative=relative == 1.0)


def _heading(item: PlanItem, angle_deg: float, *, relative: bool) -> MissionStep:
    return MissionStep(
        Command(item.command),
        angle_rad=wrap_two_pi(radians(angle_deg)),
        relative=relative,
        autocontinue=item.autocontinue,
    )


def _jump(item: PlanItem) -> MissionStep:
    target, times = item.params[:2]
    return MissionStep(
        Command.JUMP,
        target=round(number(target, -1.0, 1e6)),
        times=round(number(times, -1.0, 1e6)),
        autocontinue=item.autocontinue,
    )


def _jump_to_tag(item: PlanItem) -> MissionStep:
    return replace(_jump(item), target=-1)


def _distance(item: PlanItem) -> MissionStep:
    distance_m = number(item.params[0], 0.0, FARTHEST_M)
    return MissionStep(Command.CONDITION_DISTANCE, distance_m=distance_m, autocontinue=item.autocontinue)


def _condition_delay(item: PlanItem) -> MissionStep:
    seconds = number(item.params[0], 0.0, LONGEST_S)
    return MissionStep(Command.CONDITION_DELAY, seconds=seconds, autocontinue=item.autocontinue)


def _fence_enable(item: PlanItem) -> MissionStep:
    return MissionStep(Command.FENCE_ENABLE, enabled=item.params[0] == 1.0, autocontinue=item.autocontinue)


def _set_home(item: PlanItem) -> MissionStep:
    here = item.params[0] == 1.0
    return MissionStep(Command.SET_HOME, None if here else place_of(item), autocontinue=item.autocontinue)


def _plain(item: PlanItem) -> MissionStep:
    return MissionStep(Command(item.command), autocontinue=item.autocontinue)


_READERS: Mapping[int, Callable[[PlanItem], MissionStep]] = {
    Command.WAYPOINT: _waypoint,
    Command.LOITER_UNLIMITED: _loiter,
    Command.LOITER_TURNS: _loiter,
    Command.LOITER_TIME: _loiter,
    Command.RETURN: _plain,
    Command.DELAY: _delay,
    Command.CONDITION_DELAY: _condition_delay,
    Command.CONDITION_DISTANCE: _distance,
    Command.YAW: _yaw,
    Command.JUMP: _jump,
    Command.JUMP_TAG: _plain,
    Command.JUMP_TO_TAG: _jump_to_tag,
    Command.FENCE_ENABLE: _fence_enable,
    Command.CHANGE_SPEED: _plain,
    Command.SET_HOME: _set_home,
    Command.YAW_SPEED: _yaw_speed,
}
