"""Messages that give a goal: heading, position, home, and the mission item that is to be gone to at once."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping

from firmware_py.common.angles import wrap_two_pi
from firmware_py.common.intents import SteerHeading, SteerPosition, Verdict
from firmware_py.common.records import Severity
from firmware_py.link.commands.memory import OVERTAKEN_S
from firmware_py.link.context import Handler, LinkContext, within
from firmware_py.link.latest import keep_latest
from firmware_py.link.mission.items import acknowledge
from firmware_py.link.peers import Peer, Sender, sender_of
from firmware_py.link.positions import GLOBAL_FRAMES, home_of, offset_goal, position_goal
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanResult

Goal = SteerHeading | SteerPosition | str  # a goal, or why it is none

# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK: a set bit says that the field is to be ignored.
_IGNORE_POSITION = 0b0000_0000_0000_0011
_IGNORE_VELOCITY = 0b0000_0000_0001_1000
_IGNORE_YAW = 0b0000_0100_0000_0000
_IGNORE_ATTITUDE = 0b1000_0000

# MAV_FRAME
_LOCAL_NED, _LOCAL_OFFSET_NED = 1, 7
_BODY_FRAMES = frozenset({8, 9, 12})  # BODY_NED, BODY_OFFSET_NED, BODY_FRD: offsets ahead and to starboard
_RELATIVE_FRAMES = _BODY_FRAMES | {_LOCAL_OFFSET_NED}
_LOCAL_FRAMES = _BODY_FRAMES | {_LOCAL_NED, _LOCAL_OFFSET_NED}

GUIDED = 2  # `current` of such an item
_UNIT_TOLERANCE = 0.01
_REMEMBERED = 128  # relative goals: two stations may send 20 a second each
_SLOWEST_M_S = 1e-3
_FASTEST_M_S = 1e3


class Setpoints:
    """SET_ATTITUDE_TARGET, SET_POSITION_TARGET_GLOBAL_INT and _LOCAL_NED, SET_HOME_POSITION: none is acknowledged."""

    def __init__(self, context: LinkContext) -> None:
        """Take the context to ask and to answer through."""
        self._context = context
        self._relative: OrderedDict[tuple[Sender, int], tuple[bytes, float]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the messages handled here."""
        return {82: self._attitude, 84: self._local, 86: self._global, 243: self._home}

    def _attitude(self, peer: Peer, message: Message, now_s: float) -> None:
        """Steer the heading of the attitude."""
        ignored = message.type_mask & _IGNORE_ATTITUDE
        goal = "the attitude is masked out" if ignored else attitude_goal(message.q)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _global(self, peer: Peer, message: Message, now_s: float) -> None:
        """Go to the position, or steer where velocity or yaw point."""
        mask = message.type_mask
        goal: Goal
        if message.coordinate_frame not in GLOBAL_FRAMES:
            goal = f"frame {message.coordinate_frame} is not a global one"
        elif not mask & _IGNORE_POSITION:
            goal = position_goal(message.lat_int * 1e-7, message.lon_int * 1e-7)
        else:
            goal = direction_goal(message, 0.0)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _local(self, peer: Peer, message: Message, now_s: float) -> None:
        """Go to the position, from home or from her, or steer where velocity or yaw point."""
        goal: Goal
        if message.coordinate_frame in _RELATIVE_FRAMES and self._is_repeated(message, now_s):
            return
        turned_rad = self._frame_heading_rad(message.coordinate_frame)
        if isinstance(turned_rad, str):
            goal = turned_rad
        elif not message.type_mask & _IGNORE_POSITION:
            goal = self._local_position(message, turned_rad)
        else:
            goal = direction_goal(message, turned_rad)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _home(self, peer: Peer, message: Message, now_s: float) -> None:
        """Set home to a position."""
        home = home_of(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        self._context.request_or_warn(peer, message, home, now_s)

    def _is_repeated(self, message: Message, now_s: float) -> bool:
        """Whether a goal relative to the boat came before, perhaps over another link; remember it."""
        key, frame = (sender_of(message), message.get_seq()), bytes(message.get_msgbuf())
        before, seen_s = self._relative.get(key, (b"", 0.0))
        if frame == before and now_s - seen_s < OVERTAKEN_S:
            return True
        keep_latest(self._relative, key, (frame, now_s), _REMEMBERED)
        return False

    def _frame_heading_rad(self, frame: int) -> float | str:
        """Return where a frame's x axis points, or why the frame cannot be used."""
        if frame not in _LOCAL_FRAMES:
            return f"frame {frame} is not a local one"
        if frame not in _BODY_FRAMES:
            return 0.0
        boat = self._context.snapshot
        if boat is None or boat.heading_rad is None or not boat.heading_ok:
            return "there is no heading to count from"
        return boat.heading_rad

    def _local_position(self, message: Message, turned_rad: float) -> Goal:
        boat = self._context.snapshot
        home = self._context.home
        if message.coordinate_frame == _LOCAL_NED:
            if home is None:
                return "there is no home to count from"
            return offset_goal(home.latitude_rad, home.longitude_rad, message.x, message.y)
        fix = boat.position if boat is not None and boat.position_ok else None
        if fix is None or fix.latitude_rad is None or fix.longitude_rad is None:
            return "there is no position to count from"
        north_m = message.x * math.cos(turned_rad) - message.y * math.sin(turned_rad)
        east_m = message.x * math.sin(turned_rad) + message.y * math.cos(turned_rad)
        return offset_goal(fix.latitude_rad, fix.longitude_rad, north_m, east_m)


def attitude_goal(q: list[float]) -> Goal:
    """Return the heading of a quaternion (w, x, y, z), or why it has none."""
    w, x, y, z = q
    # Not finite when any part is not; checked by range first, so that no square overflows.
    if not all(within(part, -1.1, 1.1) for part in q) or abs(math.hypot(w, x, y, z) - 1.0) > _UNIT_TOLERANCE:
        return "the quaternion is not a unit one"
    sine, cosine = 2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)
    if math.hypot(sine, cosine) < _UNIT_TOLERANCE:
        return "an attitude that points up or down has no heading"
    return SteerHeading(wrap_two_pi(math.atan2(sine, cosine)))


def direction_goal(message: Message, turned_rad: float) -> Goal:
    """Return the goal in the velocity, else in the yaw, of a position target; `turned_rad` is its frame's heading."""
    mask = message.type_mask
    if not mask & _IGNORE_VELOCITY:
        north, east = message.vx, message.vy
        finite = within(north, -_FASTEST_M_S, _FASTEST_M_S) and within(east, -_FASTEST_M_S, _FASTEST_M_S)
        if not finite or math.hypot(north, east) < _SLOWEST_M_S:
            return "the velocity has no direction"
        return SteerHeading(wrap_two_pi(math.atan2(east, north) + turned_rad), over_ground=True)
    if not mask & _IGNORE_YAW:
        if not within(message.yaw, -2.0 * math.pi, 2.0 * math.pi):
            return "the yaw is not within a turn"
        return SteerHeading(wrap_two_pi(message.yaw + turned_rad))
    return "position, velocity and yaw are all masked out"


def go_to_waypoint(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Go to the place of a waypoint, and acknowledge it once the next start would."""
    result, text = _request_waypoint(context, message, now_s)

    def answer(kept: bool) -> None:  # noqa: FBT001 - the request handler's callback
        acknowledge(context, peer, sender_of(message), message.mission_type, result)
        if not kept:
            lost = "guided waypoint: taken, but it could not be stored; a restart may forget it"
            context.send_text_limited(peer, Severity.ERROR, lost, context.now_s)
        peer.outbox.flush(context.now_s)

    if result is PlanResult.ACCEPTED:
        context.request_handler.when_orders_stored(answer)
        return
    acknowledge(context, peer, sender_of(message), message.mission_type, result)
    if text:
        context.send_text_limited(peer, Severity.WARNING, text, now_s)


def _request_waypoint(context: LinkContext, message: Message, now_s: float) -> tuple[PlanResult, str]:
    if message.command != Command.WAYPOINT:
        return PlanResult.UNSUPPORTED, ""
    if message.frame not in GLOBAL_FRAMES:
        return PlanResult.UNSUPPORTED_FRAME, ""
    scale = 1.0 if type(message).id == mavlink.MAVLINK_MSG_ID_MISSION_ITEM else 1e-7
    goal = position_goal(message.x * scale, message.y * scale)
    if isinstance(goal, str):
        return PlanResult.INVALID, f"guided waypoint: {goal}"
    answer = context.request(message, goal, now_s)
    if answer.verdict is not Verdict.ACCEPTED:
        return PlanResult.DENIED, answer.text or "guided waypoint refused"
    return PlanResult.ACCEPTED, ""
