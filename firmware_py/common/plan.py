"""Plans: a mission, a fence or the rally points, as immutable lists of items.

Items contain the numbers of MAVLink (MAV_CMD, MAV_FRAME, degrees times 1e7), because ground stations must get them back
unchanged; guidance converts them. Items are counted from 0. The link adds the home that ArduPilot's ground stations
expect as item 0 of a mission; all texts count like the ground stations (`first_item_number`).
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import struct
import zlib
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.geodesy import Place
from firmware_py.common.reading_notes import Location, abbreviate

MAX_PLAN_ITEMS = 2000
_ITEM = struct.Struct("<BHB4fiif")


class PlanKind(IntEnum):
    """Kind of plan, numbered as MAVLink's MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2


_ARDUPILOT_IDENTITY = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA, of LNK_IDENTITY


def first_item_number(identity: int, kind: PlanKind) -> int:
    """Return the number of the first item of a plan for operators and ground stations.

    It is 1 for missions with ArduPilot's ground stations, where item 0 is home. `identity` is LNK_IDENTITY.
    """
    return int(identity == _ARDUPILOT_IDENTITY and kind is PlanKind.MISSION)


class PlanItem(msgspec.Struct, frozen=True):
    """One item: `params` are param1 to param4 (NaN where unused), x and y latitude and longitude in 1e-7 deg."""

    command: int  # MAV_CMD
    frame: int = 0  # MAV_FRAME
    autocontinue: bool = True
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # single precision
    x: int = 0
    y: int = 0
    z: float = 0.0  # metres, single precision


def place_of(item: PlanItem) -> Place | None:
    """Return the place of an item, None for the present position (0, 0) and for impossible places."""
    if (item.x == 0 and item.y == 0) or abs(item.x) > 900_000_000 or abs(item.y) > 1_800_000_000:
        return None
    return Place(radians(item.x * 1e-7), radians(item.y * 1e-7))


def limit_number(value: float, low: float, high: float) -> float:
    """Return a parameter limited to its range; NaN counts as 0."""
    return min(max(0.0 if math.isnan(value) else value, low), high)


def _normalise_nan(item: PlanItem) -> PlanItem:
    """Remove sign and payload of NaN values, which text formats do not preserve."""
    if not math.isnan(sum(item.params) + item.z):
        return item
    first, second, third, fourth, z = [math.nan if math.isnan(value) else value for value in (*item.params, item.z)]
    return PlanItem(item.command, item.frame, item.autocontinue, (first, second, third, fourth), item.x, item.y, z)


def _pack(items: Iterable[PlanItem]) -> bytes:
    pack = _ITEM.pack
    try:
        return b"".join(
            [pack(item.frame, item.command, item.autocontinue, *item.params, item.x, item.y, item.z) for item in items]
        )
    except OverflowError as error:
        raise struct.error(str(error)) from None


def _unpack(data: bytes) -> tuple[PlanItem, ...]:
    return tuple(
        PlanItem(command, frame, bool(autocontinue), (first, second, third, fourth), x, y, z)
        for frame, command, autocontinue, first, second, third, fourth, x, y, z in _ITEM.iter_unpack(data)
    )


class Plan:
    """An immutable plan; `identity` is the opaque id of MAVLink: a checksum of the items, 0 for an empty plan.

    Plans are compared by identity, because items may contain NaN. It is not a Struct, because it is encoded in packed
    form with its checksum (`as_plain`).
    """

    __slots__ = ("identity", "items", "kind")

    def __init__(self, kind: PlanKind, items: tuple[PlanItem, ...] = (), identity: int = 0) -> None:
        """Create a plan from rounded items; `of` rounds items and computes the identity."""
        self.kind: Final = kind
        self.items: Final = items
        self.identity: Final = identity

    @classmethod
    def of(cls, kind: PlanKind, items: Iterable[PlanItem]) -> Plan:
        """Create a plan of items, rounded to their MAVLink precision; struct.error for numbers out of range."""
        packed = _pack(_normalise_nan(item) for item in items)
        # The checksum 0 is reserved for an empty plan.
        return cls(kind, _unpack(packed), (zlib.crc32(packed) or 1) if packed else 0)

    def __eq__(self, other: object) -> bool:
        """Compare kind, number of items and checksum."""
        return isinstance(other, Plan) and self._key() == other._key()

    def __hash__(self) -> int:
        """Hash the compared values."""
        return hash(self._key())

    def __repr__(self) -> str:
        """Return the full content."""
        return f"Plan({self.kind!r}, {self.items!r}, {self.identity})"

    def _key(self) -> tuple[PlanKind, int, int]:
        return self.kind, len(self.items), self.identity


class Plans(msgspec.Struct, frozen=True):
    """The active plans, one of each kind."""

    mission: Plan = Plan(PlanKind.MISSION)
    fence: Plan = Plan(PlanKind.FENCE)
    rally: Plan = Plan(PlanKind.RALLY)

    def of(self, kind: PlanKind) -> Plan:
        """Return the plan of a kind."""
        return (self.mission, self.fence, self.rally)[kind]

    def replaced(self, plan: Plan) -> Plans:
        """Return the plans with one of them replaced."""
        return replace(self, **{plan.kind.name.lower(): plan})


def as_plain(plan: Plan) -> dict[str, Any]:
    """Return a plan as plain values with packed items, because encoding 2000 records takes as long as a tick."""
    items = base64.b64encode(_pack(plan.items)).decode()
    return {"kind": int(plan.kind), "identity": plan.identity, "items": items}


def from_plain(data: Any) -> Plan:
    """Return the plan that `as_plain` gave; ValueError for anything else, or when the checksum is wrong."""
    if not isinstance(data, dict) or not isinstance(data.get("items"), str) or not data.keys() >= _FIELDS:
        raise ValueError("not a plan")
    if type(data["kind"]) is not int or type(data["identity"]) is not int:
        raise ValueError("the kind of the plan is not a number")
    try:
        items = _unpack(base64.b64decode(data["items"], validate=True))
    except (binascii.Error, struct.error):
        raise ValueError("the items of the plan are damaged") from None
    plan = Plan.of(PlanKind(data["kind"]), items)
    if plan.identity != data["identity"]:
        raise ValueError("the checksum of the plan is wrong")
    return plan


_FIELDS: Final = frozenset(("kind", "identity", "items"))
_VERSION: Final = 1


def note_unknown(data: Any, location: Location) -> None:
    """Report unknown fields of the plain values of a plan."""
    for name in sorted(data.keys() - _FIELDS) if isinstance(data, dict) else ():
        location.note(f"field {abbreviate(name)} is not known here, ignored")


def to_text(plan: Plan) -> str:
    """Return a plan as one line of text for the store."""
    stored = {"version": _VERSION, "plan": as_plain(plan), "$": "_Stored"}  # earlier versions need "$"
    return json.dumps(stored, separators=(",", ":"))


def from_text(text: str) -> tuple[Plan, tuple[str, ...]]:
    """Return a stored plan and notes on ignored parts; ValueError for invalid text or a wrong checksum."""
    try:
        stored = json.loads(text)
    except RecursionError:
        raise ValueError("the text is nested too deeply") from None
    if not isinstance(stored, dict) or "plan" not in stored:
        raise ValueError("not a plan")
    location = Location("plan", {})
    version = stored.get("version", _VERSION)
    if type(version) is not int or version > _VERSION:
        location.add(f"written by a later version ({abbreviate(version)}, here {_VERSION}), read by name")
    for name in sorted(stored.keys() - {"version", "plan", "$"}):
        location.add(f"field {abbreviate(name)} is not known here, ignored")
    note_unknown(stored["plan"], location)
    return from_plain(stored["plan"]), tuple(location.notes)
