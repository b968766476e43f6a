"""Plans: a mission, a fence or the rally points, as immutable lists of items.

An item carries the numbers of MAVLink (MAV_CMD, MAV_FRAME, degrees times 1e7), because plans
come from ground stations and go back to them to the last bit; what an item means in the
units of the boat is the business of guidance. Items are counted from 0; the home that
ArduPilot's ground stations expect as item 0 of a mission is put there by the link alone.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import IntEnum

from firmware_py.plain import Codec

MOST_ITEMS = 2000
_ITEM = struct.Struct("<BHB4fiif")


class PlanKind(IntEnum):
    """Which plan, numbered as MAVLink's MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


@dataclass(frozen=True, slots=True)
class PlanItem:
    """One item: `params` are param1 to param4 (NaN where unused), x and y latitude and longitude in 1e-7 deg."""

    command: int  # MAV_CMD
    frame: int = 0  # MAV_FRAME
    autocontinue: bool = True
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # single precision
    x: int = 0
    y: int = 0
    z: float = 0.0  # metres, single precision


def _with_plain_nan(item: PlanItem) -> PlanItem:
    """Forget sign and payload of a NaN, which text does not carry and nobody means."""
    if not any(math.isnan(value) for value in (*item.params, item.z)):
        return item
    first, second, third, fourth = (math.nan if math.isnan(value) else value for value in item.params)
    return replace(item, params=(first, second, third, fourth), z=math.nan if math.isnan(item.z) else item.z)


def _identity(items: Iterable[PlanItem]) -> int:
    checksum = 0
    for item in items:
        packed = _ITEM.pack(item.frame, item.command, item.autocontinue, *item.params, item.x, item.y, item.z)
        checksum = zlib.crc32(packed, checksum)
    return checksum


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A whole plan. `identity` is what MAVLink calls its opaque id: a checksum over the items, 0 for none.

    Plans are compared by identity: items may hold NaN, which is not equal to itself.
    """

    kind: PlanKind
    items: tuple[PlanItem, ...] = ()
    identity: int = field(default=0)

    @classmethod
    def of(cls, kind: PlanKind, items: Iterable[PlanItem]) -> Plan:
        """Make a plan of items; struct.error for numbers that no item can carry."""
        found = tuple(_with_plain_nan(item) for item in items)
        # The checksum of a plan that is there is never 0.
        return cls(kind, found, (_identity(found) or 1) if found else 0)

    def __eq__(self, other: object) -> bool:
        """Compare kind, number and checksum of the items."""
        return isinstance(other, Plan) and self._key() == other._key()

    def __hash__(self) -> int:
        """Hash what is compared."""
        return hash(self._key())

    def _key(self) -> tuple[PlanKind, int, int]:
        return self.kind, len(self.items), self.identity


@dataclass(frozen=True, slots=True)
class Plans:
    """The plans in force, one of each kind."""

    mission: Plan = Plan(PlanKind.MISSION)
    fence: Plan = Plan(PlanKind.FENCE)
    rally: Plan = Plan(PlanKind.RALLY)

    def of(self, kind: PlanKind) -> Plan:
        """Return the plan of a kind."""
        return (self.mission, self.fence, self.rally)[kind]

    def replaced(self, plan: Plan) -> Plans:
        """Return the plans with one of them replaced."""
        return replace(self, **{plan.kind.name.lower(): plan})


_CODEC = Codec([Plan])


def to_text(plan: Plan) -> str:
    """Write a plan as one line of text, as it is stored."""
    return _CODEC.to_text(plan)


def from_text(text: str) -> Plan:
    """Read a stored plan; ValueError for anything else, or one whose checksum is wrong."""
    stored: Plan = _CODEC.from_text(text)
    try:
        plan = Plan.of(stored.kind, stored.items)
    except struct.error as error:
        raise ValueError(f"a plan item cannot be carried: {error}") from None
    if plan != stored:
        raise ValueError("the checksum of the plan is wrong")
    return plan
