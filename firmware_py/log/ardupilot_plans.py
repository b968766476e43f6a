"""Missions, fences and rally points as ArduPilot messages. They are not read back."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_py.common.plan import Plan, PlanItem, PlanKind, first_item_number
from firmware_py.log.ardupilot_formats import FENCE, ITEM, RALLY
from firmware_py.log.message_rows import microseconds
from firmware_py.plans.items import Command, has_position

# AC_PolyFenceType
_FENCES: Final = {
    Command.INCLUDED_VERTEX: 98,
    Command.EXCLUDED_VERTEX: 97,
    Command.FENCE_RETURN: 95,
    Command.EXCLUDED_CIRCLE: 93,
    Command.INCLUDED_CIRCLE: 92,
}
_VERTICES: Final = (Command.INCLUDED_VERTEX, Command.EXCLUDED_VERTEX)
_CIRCLES: Final = (Command.INCLUDED_CIRCLE, Command.EXCLUDED_CIRCLE)


def plan_bytes(t_s: float, plan: Plan, identity: int) -> bytes:
    """Return the messages of a plan, none for an empty one; `identity` (LNK_IDENTITY) sets the item numbers."""
    time_us = microseconds(t_s)
    if plan.kind is PlanKind.MISSION:
        return b"".join(_mission(time_us, plan, first_item_number(identity, plan.kind)))
    total = len(plan.items)
    if plan.kind is PlanKind.FENCE:
        return b"".join(_fence_item(time_us, total, number, item) for number, item in enumerate(plan.items))
    return b"".join(
        RALLY.pack(time_us, total, number, item.x, item.y, item.z, 0) for number, item in enumerate(plan.items)
    )


def _mission(time_us: int, plan: Plan, first: int) -> Iterator[bytes]:
    total = len(plan.items) + first
    for number, item in enumerate(plan.items, start=first):
        target = first if item.command == Command.JUMP else 0
        coordinates = (item.x, item.y) if has_position(item.command) else (0, 0)
        params = (item.params[0] + target, *item.params[1:])
        yield ITEM.pack(time_us, total, number, item.command, *params, *coordinates, item.z, item.frame)


def _fence_item(time_us: int, total: int, number: int, item: PlanItem) -> bytes:
    kind = Command(item.command)
    count = round(item.params[0]) if kind in _VERTICES else 0
    radius_m = item.params[0] if kind in _CIRCLES else 0.0
    return FENCE.pack(time_us, total, number, _FENCES[kind], item.x, item.y, count, radius_m)
