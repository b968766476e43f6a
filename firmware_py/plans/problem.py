"""Problem of a plan: result for MAVLink, and text."""

from __future__ import annotations

from enum import IntEnum

import msgspec


class PlanResult(IntEnum):
    """Reason for the refusal of a plan, numbered as MAVLink's MAV_MISSION_RESULT."""

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


class PlanProblem(msgspec.Struct, frozen=True):
    """The first problem of a plan: index of the item (None: the whole plan), result and text."""

    index: int | None
    result: PlanResult
    text: str

    def message(self, first_number: int) -> str:
        """Return the text with the number of the item; `first_number` as from `first_item_number`."""
        return self.text if self.index is None else f"item {self.index + first_number}: {self.text}"
