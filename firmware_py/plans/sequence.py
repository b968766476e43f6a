"""References between the items of a mission: jumps, tags, and next places."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from firmware_py.common.plan import PlanItem
from firmware_py.plans.items import ROWS, Command
from firmware_py.plans.problem import PlanProblem, PlanResult


def tags_of(items: Sequence[PlanItem]) -> Mapping[int, int]:
    """Return the index of the first JUMP_TAG of each tag."""
    tags: dict[int, int] = {}
    for index, item in enumerate(items):
        if item.command == Command.JUMP_TAG and math.isfinite(item.params[0]):
            tags.setdefault(int(item.params[0]), index)
    return tags


def jump_target(item: PlanItem, tags: Mapping[int, int]) -> int | None:
    """Return the index of the target of a jump; None for an unknown tag and for other items."""
    if item.command == Command.JUMP:
        return int(item.params[0])
    return tags.get(int(item.params[0])) if item.command == Command.JUMP_TO_TAG else None


def next_places(items: Sequence[PlanItem]) -> list[int | None]:
    """Return for each item the index of the next item with a place, or None if it is uncertain.

    It is uncertain before a jump, before an item with another destination, and if the place is the present position.
    """
    next_place: int | None = None
    places: list[int | None] = []
    for index in range(len(items) - 1, -1, -1):
        places.append(next_place)
        item = items[index]
        row = ROWS.get(item.command)
        if row is None or row.command in (Command.CONDITION_DELAY, Command.CONDITION_DISTANCE):
            continue
        if row.has_duration:
            next_place = index if row.has_place and (item.x or item.y) else None
        elif row.command in (Command.JUMP, Command.JUMP_TO_TAG):
            next_place = None
    return places[::-1]


def order_problem(items: Sequence[PlanItem]) -> PlanProblem | None:
    """Return the problem of the first reference to a missing item, or of an endless loop without duration."""
    tags = tags_of(items)
    for index, (item, next_place) in enumerate(zip(items, next_places(items), strict=True)):
        target = jump_target(item, tags)
        if item.command == Command.JUMP_TO_TAG and target is None:
            return PlanProblem(index, PlanResult.INVALID_PARAM1, "DO_JUMP_TAG: no JUMP_TAG with this tag")
        if target is not None and target >= len(items):
            return PlanProblem(index, PlanResult.INVALID_PARAM1, "DO_JUMP: the target item does not exist")
        if item.command == Command.CONDITION_DISTANCE and next_place is None:
            return PlanProblem(index, PlanResult.INVALID, "CONDITION_DISTANCE: no item with a position follows")
    return _loop_problem(items, tags)


def _loop_problem(items: Sequence[PlanItem], tags: Mapping[int, int]) -> PlanProblem | None:
    visited = bytearray(len(items))  # 1: on the present path, 2: without a loop
    for start, item in enumerate(items):
        if jump_target(item, tags) is None or visited[start]:
            continue
        last_jump = _find_endless_loop(items, tags, start, visited)
        if last_jump is not None:
            name = ROWS[items[last_jump].command].name
            text = f"{name}: endless loop without an item that takes time"
            return PlanProblem(last_jump, PlanResult.INVALID_PARAM1, text)
    return None


def _find_endless_loop(
    items: Sequence[PlanItem], tags: Mapping[int, int], start: int, visited: bytearray
) -> int | None:
    """Follow the items without duration from `start`; return the last jump of a loop, or None without a loop."""
    stack = [(start, iter(_successors(items, tags, start)))]
    visited[start] = 1
    while stack:
        index, successors = stack[-1]
        successor = next(successors, None)
        if successor is None:
            visited[index] = 2
            stack.pop()
        elif visited[successor] == 1:
            # Each loop contains a jump.
            return next(jump for jump, _ in reversed(stack) if jump_target(items[jump], tags) is not None)
        elif not visited[successor]:
            visited[successor] = 1
            stack.append((successor, iter(_successors(items, tags, successor))))
    return None


def _successors(items: Sequence[PlanItem], tags: Mapping[int, int], index: int) -> tuple[int, ...]:
    """Return the items that can follow for ever: after a limited number of jumps the next item follows."""
    item = items[index]
    if ROWS[item.command].has_duration:
        return ()
    target = jump_target(item, tags)
    if target is not None and item.params[1] < 0.0:
        return (target,)
    return (index + 1,) if index + 1 < len(items) else ()
