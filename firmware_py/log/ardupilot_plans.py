"""Missions, fences and rally points as ArduPilot messages. A replay ignores them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py.common.plan import Plan, PlanItem, PlanKind, first_item_number
from firmware_py.log.ardupilot_formats import FENCE, MISSION_ITEM, RALLY
from firmware_py.log.message_rows import microseconds
from firmware_py.plans.items import Command, has_position

# Numbers of ArduPilot's AC_PolyFenceType.
_FENCE_TYPES: Final = {
    Command.INCLUDED_VERTEX: 98,
    Command.EXCLUDED_VERTEX: 97,
    Command.FENCE_RETURN: 95,
    Command.EXCLUDED_CIRCLE: 93,
    Command.INCLUDED_CIRCLE: 92,
}
_VERTEX_COMMANDS: Final = (Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX)
_CIRCLE_COMMANDS: Final = (Command.INCLUDED_CIRCLE, Command.EXCLUDED_CIRCLE)


def encode_plan(t_s: float, plan: Plan, identity: int) -> bytes:
    """Return the messages of a plan; `identity` (LNK_IDENTITY) determines the number of the first item."""
    time_us = microseconds(t_s)
    if plan.kind is PlanKind.MISSION:
        return b"".join(_encode_mission(time_us, plan, first_item_number(identity, plan.kind)))
    total = len(plan.items)
    if plan.kind is PlanKind.FENCE:
        return b"".join(_encode_fence_item(time_us, total, number, item) for number, item in enumerate(plan.items))
    return b"".join(
        RALLY.pack(time_us, total, number, item.x, item.y, item.z, 0) for number, item in enumerate(plan.items)
    )


def _encode_mission(time_us: int, plan: Plan, first_number: int) -> Iterator[bytes]:
    total = len(plan.items) + first_number
    for number, item in enumerate(plan.items, start=first_number):
        number_offset = first_number if item.command == Command.JUMP else 0
        coordinates = (item.x, item.y) if has_position(item.command) else (0, 0)
        params = (item.params[0] + number_offset, *item.params[1:])
        yield MISSION_ITEM.pack(time_us, total, number, item.command, *params, *coordinates, item.z, item.frame)


def _encode_fence_item(time_us: int, total: int, number: int, item: PlanItem) -> bytes:
    command = Command(item.command)
    count = round(item.params[0]) if command in _VERTEX_COMMANDS else 0
    radius_m = item.params[0] if command in _CIRCLE_COMMANDS else 0.0
    return FENCE.pack(time_us, total, number, _FENCE_TYPES[command], item.x, item.y, count, radius_m)
