"""Plan items on the wire: home as item 0 of a mission, sequence numbers, degrees and integers; duplicate messages."""

from __future__ import annotations

import math
from collections import OrderedDict

from firmware_py.common.plan import Plan, PlanItem, PlanKind, first_item_number
from firmware_py.common.reports import Home
from firmware_py.link.context import LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer, Sender, Station
from firmware_py.link.telemetry.fields import scaled_degrees
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.outbox import Priority
from firmware_py.plans.items import Command, has_place
from firmware_py.plans.problem import PlanProblem, PlanResult

KINDS = {int(kind): kind for kind in PlanKind}
NAMES = {PlanKind.MISSION: "mission", PlanKind.FENCE: "fence", PlanKind.RALLY: "rally points"}

_ITEM_INT = mavlink.MAVLink_mission_item_int_message
_ITEM = mavlink.MAVLink_mission_item_message
_ACK = mavlink.mavlink_map[47]
_INT32 = 1 << 31
_FRAMES_OF_HOME = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_AT_HOME = 1000  # 1e-7 deg: some 11 m

_DUPLICATE_S = 10.0  # maximum delay of a duplicate; a repeated request has another frame number
_REMEMBERED = 16


def item_of(message: Message, home_count: int) -> PlanItem | PlanProblem:
    """Return the item of a MISSION_ITEM or MISSION_ITEM_INT, with jump targets as in the plan; or its problem."""
    x, y = message.x, message.y
    if type(message).id == _ITEM.id:
        place = has_place(message.command)
        x, y = _whole(x, scaled=place), _whole(y, scaled=place)
        if x is None:
            return PlanProblem(None, PlanResult.INVALID_PARAM5_X, "x is out of range")
        if y is None:
            return PlanProblem(None, PlanResult.INVALID_PARAM6_Y, "y is out of range")
    jumps = message.command == Command.JUMP
    if jumps and 0.0 <= message.param1 < home_count:
        return PlanProblem(None, PlanResult.INVALID_PARAM1, "DO_JUMP: param1 is home, which is no item to go on with")
    first = message.param1 - home_count if jumps else message.param1
    parameters = (first, message.param2, message.param3, message.param4)
    return PlanItem(message.command, message.frame, bool(message.autocontinue), parameters, x, y, message.z)


def _whole(value: float, *, scaled: bool) -> int | None:
    """Return a coordinate as an integer, or None; NaN is 0 in an item without a position."""
    if math.isnan(value) and not scaled:
        return 0
    if not abs(value) < _INT32:
        return None
    number = round(value * 1e7) if scaled else int(value)
    return number if -_INT32 <= number < _INT32 else None


def new_plan_text(plan: Plan, autopilot: int) -> str:
    """Return the text on a new plan; a mission by its item numbers, since stations differ in counting home."""
    first, count = first_item_number(autopilot, plan.kind), len(plan.items)
    extent = f"items {first} to {first + count - 1}" if first and count else f"{count} items"
    return f"New {NAMES[plan.kind]}: {extent}"


def home_item(home: Home | None) -> PlanItem:
    """Return home as item 0 of a mission; at 0, 0 while there is no home."""
    if home is None:
        return PlanItem(int(Command.WAYPOINT))
    x, y = scaled_degrees(home.latitude_rad), scaled_degrees(home.longitude_rad)
    return PlanItem(int(Command.WAYPOINT), x=x, y=y, z=home.altitude_m)


def is_waypoint_for_home(message: Message, home: Home | None) -> bool:
    """Return whether item 0 of a received mission was meant as a waypoint to sail to.

    A station that knows item 0 as home sends it with an absolute altitude, or home itself, or zeros.
    """
    item = item_of(message, 0)
    if isinstance(item, PlanProblem) or not (item.x or item.y):
        return False
    if item.command == Command.WAYPOINT and item.frame in _FRAMES_OF_HOME:
        return False
    there = home_item(home)
    return max(abs(item.x - there.x), abs(item.y - there.y)) > _AT_HOME


def item_message(
    item: PlanItem, to: Sender, kind: PlanKind, sequence: int, *, home_count: int, current: bool, whole: bool
) -> Message:
    """Return an item as MISSION_ITEM_INT (`whole`) or as MISSION_ITEM."""
    first, second, third, fourth = item.params
    if item.command == Command.JUMP:
        first += home_count
    x: float = item.x
    y: float = item.y
    if not whole and has_place(item.command):
        x, y = x * 1e-7, y * 1e-7
    make = _ITEM_INT if whole else _ITEM
    head = (*to, sequence, item.frame, item.command, int(current), int(item.autocontinue))
    return make(*head, first, second, third, fourth, x, y, item.z, int(kind))


def acknowledge(context: LinkContext, peer: Peer, to: Sender, kind: int, result: PlanResult, identity: int = 0) -> None:
    """Send a MISSION_ACK; `identity` is the opaque id of an accepted plan."""
    context.send(peer, _ACK(*to, int(result), kind, identity), Priority.URGENT)


class DuplicateMessages:
    """The frame number of the latest message of each station, message type and plan type; bounded."""

    def __init__(self) -> None:
        """Start empty."""
        self._latest: OrderedDict[tuple[Station, int, int], tuple[tuple[int, int], float]] = OrderedDict()

    def is_duplicate(self, station: Station, message: Message, now_s: float) -> bool:
        """Return whether a message is a duplicate of the latest of its kind; store it if not."""
        key = (station, type(message).id, message.mission_type)
        mark = (getattr(message, "count", 0), message.get_seq())
        before, seen_s = self._latest.get(key, (None, 0.0))
        if mark == before and now_s - seen_s < _DUPLICATE_S:
            return True
        keep_latest(self._latest, key, (mark, now_s), _REMEMBERED)
        return False
