"""What a plan may hold: judged before it is accepted, from a link, a file or the store."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from firmware_py.plan import MOST_ITEMS, Plan


class PlanResult(IntEnum):
    """Why a plan is refused, numbered as MAVLink's MAV_MISSION_RESULT."""

    ACCEPTED = 0
    ERROR = 1
    UNSUPPORTED_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    INVALID_PARAM1 = 6
    INVALID_PARAM2 = 7
    INVALID_PARAM3 = 8
    INVALID_PARAM4 = 9
    INVALID_PARAM5_X = 10
    INVALID_PARAM6_Y = 11
    INVALID_PARAM7 = 12
    INVALID_SEQUENCE = 13
    DENIED = 14
    OPERATION_CANCELLED = 15


@dataclass(frozen=True, slots=True)
class PlanFault:
    """The first thing that is wrong with a plan: where (None: the plan as a whole), how, and in words."""

    index: int | None
    result: PlanResult
    text: str


def fault_of(plan: Plan) -> PlanFault | None:
    """Return the first thing that is wrong with a plan, or None."""
    if len(plan.items) > MOST_ITEMS:
        return PlanFault(None, PlanResult.NO_SPACE, f"{len(plan.items)} items; at most {MOST_ITEMS} are kept")
    for index, item in enumerate(plan.items):
        if not math.isfinite(item.z):
            return PlanFault(index, PlanResult.INVALID_PARAM7, f"item {index}: the altitude is not a number")
    return None
