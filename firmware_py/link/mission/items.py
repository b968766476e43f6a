"""Conversion of plan items to and from MAVLink messages, home as item 0, and detection of duplicate messages.

`home_count` is the number of items before those of the plan: 1 if item 0 is home, as in a mission of ArduPilot, or 0.
"""

from __future__ import annotations

import math
from collections import OrderedDict

from msgspec.structs import replace

from firmware_py.common.plan import Plan, PlanItem, PlanKind, first_item_number
from firmware_py.common.reports import Home
from firmware_py.link.context import LinkContext
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer, Sender, Station
from firmware_py.link.telemetry.fields import scaled_degrees
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.outbox import Priority
from firmware_py.plans.items import Command, has_position
from firmware_py.plans.problem import PlanProblem, PlanResult
from firmware_py.plans.validation import item_problem

KINDS = {int(kind): kind for kind in PlanKind}  # by MAV_MISSION_TYPE
NAMES = {PlanKind.MISSION: "mission", PlanKind.FENCE: "fence", PlanKind.RALLY: "rally points"}

_ITEM_INT = mavlink.MAVLink_mission_item_int_message
_ITEM = mavlink.MAVLink_mission_item_message
_ACK = mavlink.mavlink_map[47]  # MISSION_ACK
_INT32 = 1 << 31
_FRAMES_OF_HOME = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_HOME_TOLERANCE = 1000  # 1e-7 deg: about 11 m

_MAX_DUPLICATE_DELAY_S = 10.0  # a request that the station repeats has another frame number
_MAX_LATEST_MESSAGES = 16


def item_of(message: Message, home_count: int) -> PlanItem | PlanProblem:
    """Return the plan item of a MISSION_ITEM or MISSION_ITEM_INT, or its problem; jump targets are plan indices."""
    x, y = message.x, message.y
    if type(message).id == _ITEM.id:
        has_degrees = has_position(message.command)
        x, y = _to_int32(x, is_degrees=has_degrees), _to_int32(y, is_degrees=has_degrees)
        if x is None:
            return PlanProblem(None, PlanResult.INVALID_PARAM5_X, "x is out of range")
        if y is None:
            return PlanProblem(None, PlanResult.INVALID_PARAM6_Y, "y is out of range")
    is_jump = message.command == Command.JUMP
    if is_jump and 0.0 <= message.param1 < home_count:
        return PlanProblem(None, PlanResult.INVALID_PARAM1, "DO_JUMP: param1 is home, not a mission item")
    param1 = message.param1 - home_count if is_jump else message.param1
    params = (param1, message.param2, message.param3, message.param4)
    return PlanItem(message.command, message.frame, bool(message.autocontinue), params, x, y, message.z)


def valid_item(message: Message, kind: PlanKind, index: int, home_count: int) -> PlanItem | PlanProblem:
    """Return the item of a message if it is valid in a plan, or its first problem; `index` is its index in the plan."""
    item = item_of(message, home_count)
    if isinstance(item, PlanProblem):
        return replace(item, index=index)
    return item_problem(kind, index, item) or item


def _to_int32(value: float, *, is_degrees: bool) -> int | None:
    """Return a coordinate of MISSION_ITEM as in MISSION_ITEM_INT (degrees in 1e-7 deg), or None if it is out of range.

    In an item without a position, NaN becomes 0.
    """
    if math.isnan(value) and not is_degrees:
        return 0
    if not math.isfinite(value):
        return None
    integer = round(value * 1e7) if is_degrees else int(value)
    return integer if -_INT32 <= integer < _INT32 else None


def new_plan_text(plan: Plan, autopilot: int) -> str:
    """Return the text for a new plan; a mission has item numbers, because ground stations count home differently."""
    first_number, count = first_item_number(autopilot, plan.kind), len(plan.items)
    items = f"items {first_number} to {first_number + count - 1}" if first_number and count else f"{count} items"
    return f"New {NAMES[plan.kind]}: {items}"


def home_item(home: Home | None) -> PlanItem:
    """Return home as item 0 of a mission, at 0, 0 if home is not set."""
    if home is None:
        return PlanItem(int(Command.WAYPOINT))
    x, y = scaled_degrees(home.latitude_rad), scaled_degrees(home.longitude_rad)
    return PlanItem(int(Command.WAYPOINT), x=x, y=y, z=home.altitude_m)


def is_waypoint_for_home(message: Message, home: Home | None) -> bool:
    """Return whether item 0 of a received mission is a waypoint instead of home.

    A ground station that uses item 0 for home sends an absolute altitude, the present home position, or zeros.
    """
    item = item_of(message, 0)
    if isinstance(item, PlanProblem) or not (item.x or item.y):
        return False
    if item.command == Command.WAYPOINT and item.frame in _FRAMES_OF_HOME:
        return False
    expected = home_item(home)
    return max(abs(item.x - expected.x), abs(item.y - expected.y)) > _HOME_TOLERANCE


def item_message(
    item: PlanItem, recipient: Sender, kind: PlanKind, sequence: int, *, home_count: int, is_current: bool, is_int: bool
) -> Message:
    """Return an item as MISSION_ITEM_INT (`is_int`) or as MISSION_ITEM."""
    param1, param2, param3, param4 = item.params
    if item.command == Command.JUMP:
        param1 += home_count
    x: float = item.x
    y: float = item.y
    if not is_int and has_position(item.command):
        x, y = x * 1e-7, y * 1e-7
    make_message = _ITEM_INT if is_int else _ITEM
    header = (*recipient, sequence, item.frame, item.command, int(is_current), int(item.autocontinue))
    return make_message(*header, param1, param2, param3, param4, x, y, item.z, int(kind))


def acknowledge(
    context: LinkContext, peer: Peer, recipient: Sender, kind: int, result: PlanResult, identity: int = 0
) -> None:
    """Send a MISSION_ACK; `identity` is the opaque id of an accepted plan."""
    context.send(peer, _ACK(*recipient, int(result), kind, identity), Priority.URGENT)


class DuplicateMessages:
    """Frame numbers of the latest messages by station, message type and plan type; bounded."""

    def __init__(self) -> None:
        """Start without messages."""
        # By key: `count` of MISSION_COUNT and frame number, time of reception.
        self._latest: OrderedDict[tuple[Station, int, int], tuple[tuple[int | None, int], float]] = OrderedDict()

    def is_duplicate(self, station: Station, message: Message, now_s: float) -> bool:
        """Return whether a message is a duplicate of the latest of its type; otherwise store it as the latest."""
        key = (station, type(message).id, message.mission_type)
        frame_key = (getattr(message, "count", None), message.get_seq())
        latest_key, received_s = self._latest.get(key, (None, 0.0))
        if frame_key == latest_key and now_s - received_s < _MAX_DUPLICATE_DELAY_S:
            return True
        keep_latest(self._latest, key, (frame_key, now_s), _MAX_LATEST_MESSAGES)
        return False
