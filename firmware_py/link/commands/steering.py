"""Steering inputs: commands and setpoint messages with a heading or a position, and the stick of the operator."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping

from firmware_py.common.angles import radians, wrap_two_pi
from firmware_py.common.geodesy import Place
from firmware_py.common.intents import Answer, ManualRudder, SetHome, SteerHeading, SteerPosition, Verdict
from firmware_py.common.mode_table import MODES, BaseMode
from firmware_py.common.records import Severity
from firmware_py.link.commands.server import OVERTAKEN_S, CommandCall, CommandRow
from firmware_py.link.context import Handler, LinkContext, within
from firmware_py.link.latest import keep_latest
from firmware_py.link.mission.items import acknowledge
from firmware_py.link.peers import Peer, Sender, sender_of
from firmware_py.link.telemetry.fields import INT16_MAX, UINT16_MAX
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.plans.items import Command
from firmware_py.plans.problem import PlanResult

# MAV_FRAME: GLOBAL and GLOBAL_RELATIVE_ALT, their _INT forms, and the two over terrain. The altitude is ignored.
GLOBAL_FRAMES = frozenset({0, 3, 5, 6, 10, 11})

_MAX_ALTITUDE_M = 10_000.0
_MAX_OFFSET_M = 100_000.0  # limit of the flat-earth approximation

_CHANGE_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
_COURSE_OVER_GROUND, _HEADING = 0.0, 1.0  # HEADING_TYPE
_NEITHER_RELATIVE = "param{} is neither 0 (absolute) nor 1 (relative)"

Goal = SteerHeading | SteerPosition | str  # a goal, or the reason of a refusal

# POSITION_TARGET_TYPEMASK and ATTITUDE_TARGET_TYPEMASK: fields whose bit is set are ignored.
_IGNORE_POSITION = 0b0000_0000_0000_0011
_IGNORE_VELOCITY = 0b0000_0000_0001_1000
_IGNORE_YAW = 0b0000_0100_0000_0000
_IGNORE_ATTITUDE = 0b1000_0000

# MAV_FRAME
_LOCAL_NED, _LOCAL_OFFSET_NED = 1, 7
_BODY_FRAMES = frozenset({8, 9, 12})  # BODY_NED, BODY_OFFSET_NED, BODY_FRD: offsets ahead and to starboard
_RELATIVE_FRAMES = _BODY_FRAMES | {_LOCAL_OFFSET_NED}
_LOCAL_FRAMES = _BODY_FRAMES | {_LOCAL_NED, _LOCAL_OFFSET_NED}

GUIDED = 2  # `current` of a mission item that is a goal
_UNIT_TOLERANCE = 0.01  # of the norm of a quaternion
_MAX_RELATIVE_GOALS = 128  # stored for OVERTAKEN_S, in which two stations may send 20 per second each
_MIN_SPEED_M_S = 1e-3
_MAX_SPEED_M_S = 1e3

_FULL_STICK = 1000
_CENTRE_US, _FULL_US = 1500, 500  # pulse of the rudder amidships, and its change to full deflection
_RELEASE, _IGNORE = 0, UINT16_MAX  # of a channel in RC_CHANNELS_OVERRIDE
_OTHER_CHANNELS = tuple(f"chan{number}_raw" for number in range(2, 9))
_CHANNEL_1 = "channel 1 is the rudder in MANUAL, the heading in STEERING"


def position_goal(latitude_deg: float, longitude_deg: float, *, change_mode: bool = False) -> SteerPosition | str:
    """Return the goal, or the reason of a refusal; 0, 0 usually means unset fields."""
    if not within(latitude_deg, -90.0, 90.0) or not within(longitude_deg, -180.0, 180.0):
        return "latitude or longitude out of range"
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        return "position 0, 0 is not accepted"
    return SteerPosition(radians(latitude_deg), radians(longitude_deg), change_mode=change_mode)


def home_request(latitude_deg: float, longitude_deg: float, altitude_m: float) -> SetHome | str:
    """Return the request to set home, or the reason of a refusal; an altitude of NaN becomes 0."""
    if not within(latitude_deg, -90.0, 90.0) or not within(longitude_deg, -180.0, 180.0):
        return "latitude or longitude out of range"
    if latitude_deg == 0.0 and longitude_deg == 0.0:
        return "home at 0, 0 is not accepted"
    if math.isnan(altitude_m):
        altitude_m = 0.0
    if not within(altitude_m, -_MAX_ALTITUDE_M, _MAX_ALTITUDE_M):
        return "the altitude is out of range"
    return SetHome(radians(latitude_deg), radians(longitude_deg), altitude_m)


def offset_goal(latitude_rad: float, longitude_rad: float, north_m: float, east_m: float) -> SteerPosition | str:
    """Return the goal at an offset from a position, or the reason of a refusal."""
    if not within(north_m, -_MAX_OFFSET_M, _MAX_OFFSET_M) or not within(east_m, -_MAX_OFFSET_M, _MAX_OFFSET_M):
        return f"the position is not within {_MAX_OFFSET_M / 1e3:.0f} km"
    goal = Place(latitude_rad, longitude_rad).at_local_offset(north_m, east_m)
    if goal is None:
        return "local position beyond a pole"
    return SteerPosition(goal.latitude_rad, goal.longitude_rad)


def condition_yaw(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to an angle, absolute or relative to the present heading.

    param3 is the direction of the turn: 1 to starboard, -1 to port, 0 the shorter way, or by the sign of a relative
    angle. A negative relative angle without a direction is a turn to port. The turn rate (param2) is ignored.
    """
    angle_deg, _, direction, relative = call.parameters
    if relative not in (0.0, 1.0):
        return call.deny(_NEITHER_RELATIVE.format(4))
    if direction not in (-1.0, 0.0, 1.0):
        return call.deny("the direction is not -1, 0 or 1")
    min_angle_deg = -360.0 if relative and not direction else 0.0
    if not within(angle_deg, min_angle_deg, 360.0):
        return call.deny("the angle is not within 0 to 360 deg")
    turn = int(direction)
    signed_angle_deg = -angle_deg if relative and turn < 0 else angle_deg
    goal = SteerHeading(radians(signed_angle_deg), relative=relative == 1.0, turn=turn)
    return context.request(call.message, goal, call.now_s)


def change_heading(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to a heading or to a course over ground."""
    heading_type, angle_deg = call.parameters[:2]
    if heading_type not in (_COURSE_OVER_GROUND, _HEADING):
        return call.deny("the type is neither course over ground (0) nor heading (1)")
    if not within(angle_deg, 0.0, 360.0):
        return call.deny("the angle is not within 0 to 360 deg")
    goal = SteerHeading(radians(angle_deg), over_ground=heading_type == _COURSE_OVER_GROUND)
    return context.request(call.message, goal, call.now_s)


def set_yaw_speed(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to an angle, absolute or (param3 = 1) relative to the present heading; the speed is ignored."""
    angle_deg, _, relative, _ = call.parameters
    if relative not in (0.0, 1.0):
        return call.deny(_NEITHER_RELATIVE.format(3))
    if not within(angle_deg, -360.0, 360.0):
        return call.deny("the angle is not within -360 to 360 deg")
    return context.request(call.message, SteerHeading(radians(angle_deg), relative=relative == 1.0), call.now_s)


def reposition(context: LinkContext, call: CommandCall) -> Answer:
    """Go to a position; speed, radius and yaw are ignored."""
    flags = call.parameters[1]
    if not within(flags, 0, 0xFFFF):
        return call.deny(f"flags (param2) {flags:g} are not within 0 to 65535")
    if call.frame is not None and call.frame not in GLOBAL_FRAMES:
        return call.deny(f"frame {call.frame} is not a global one")
    goal = position_goal(*call.position_deg, change_mode=bool(int(flags) & _CHANGE_MODE))
    return call.deny(goal) if isinstance(goal, str) else context.request(call.message, goal, call.now_s)


class Setpoints:
    """Executes SET_ATTITUDE_TARGET, SET_POSITION_TARGET_GLOBAL_INT, _LOCAL_NED and SET_HOME_POSITION.

    MAVLink has no acknowledgement for these messages; a refusal is a STATUSTEXT.
    """

    def __init__(self, context: LinkContext) -> None:
        """Store the context, which sends messages and passes on requests."""
        self._context = context
        self._relative_goals: OrderedDict[tuple[Sender, int], tuple[bytes, float]] = OrderedDict()

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {
            mavlink.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: self._set_attitude,
            mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._set_local_position,
            mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: self._set_global_position,
            mavlink.MAVLINK_MSG_ID_SET_HOME_POSITION: self._set_home,
        }

    def _set_attitude(self, peer: Peer, message: Message, now_s: float) -> None:
        """Steer to the heading of the attitude."""
        is_masked = message.type_mask & _IGNORE_ATTITUDE
        goal = "the attitude is masked out" if is_masked else attitude_goal(message.q)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _set_global_position(self, peer: Peer, message: Message, now_s: float) -> None:
        """Go to the position, or steer to the direction of velocity or yaw."""
        mask = message.type_mask
        goal: Goal
        if message.coordinate_frame not in GLOBAL_FRAMES:
            goal = f"frame {message.coordinate_frame} is not a global one"
        elif not mask & _IGNORE_POSITION:
            goal = position_goal(message.lat_int * 1e-7, message.lon_int * 1e-7)
        else:
            goal = direction_goal(message, 0.0)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _set_local_position(self, peer: Peer, message: Message, now_s: float) -> None:
        """Go to the position relative to home or boat, or steer to the direction of velocity or yaw."""
        goal: Goal
        if message.coordinate_frame in _RELATIVE_FRAMES and self._is_duplicate(message, now_s):
            return
        frame_rad = self._frame_heading_rad(message.coordinate_frame)
        if isinstance(frame_rad, str):
            goal = frame_rad
        elif not message.type_mask & _IGNORE_POSITION:
            goal = self._local_position(message, frame_rad)
        else:
            goal = direction_goal(message, frame_rad)
        self._context.request_or_warn(peer, message, goal, now_s)

    def _set_home(self, peer: Peer, message: Message, now_s: float) -> None:
        """Set home to a position."""
        home = home_request(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        self._context.request_or_warn(peer, message, home, now_s)

    def _is_duplicate(self, message: Message, now_s: float) -> bool:
        """Return whether a relative goal is a duplicate, also by another link; otherwise store it."""
        key, frame = (sender_of(message), message.get_seq()), bytes(message.get_msgbuf())
        stored = self._relative_goals.get(key)
        if stored is not None and stored[0] == frame and now_s - stored[1] < OVERTAKEN_S:
            return True
        keep_latest(self._relative_goals, key, (frame, now_s), _MAX_RELATIVE_GOALS)
        return False

    def _frame_heading_rad(self, frame: int) -> float | str:
        """Return the direction of the x axis of a frame, or the reason of a refusal."""
        if frame not in _LOCAL_FRAMES:
            return f"frame {frame} is not a local one"
        if frame not in _BODY_FRAMES:
            return 0.0
        snapshot = self._context.snapshot
        if snapshot is None or snapshot.heading_rad is None or not snapshot.heading_ok:
            return "no valid heading for a relative goal"
        return snapshot.heading_rad

    def _local_position(self, message: Message, frame_rad: float) -> Goal:
        snapshot = self._context.snapshot
        home = self._context.home
        if message.coordinate_frame == _LOCAL_NED:
            if home is None:
                return "no home for a relative goal"
            return offset_goal(home.latitude_rad, home.longitude_rad, message.x, message.y)
        fix = snapshot.position if snapshot is not None and snapshot.position_ok else None
        if fix is None or fix.latitude_rad is None or fix.longitude_rad is None:
            return "no valid position for a relative goal"
        north_m = message.x * math.cos(frame_rad) - message.y * math.sin(frame_rad)
        east_m = message.x * math.sin(frame_rad) + message.y * math.cos(frame_rad)
        return offset_goal(fix.latitude_rad, fix.longitude_rad, north_m, east_m)


def attitude_goal(q: list[float]) -> Goal:
    """Return the heading of a quaternion (w, x, y, z), or the reason of a refusal."""
    w, x, y, z = q
    # The range check comes first, so that no square overflows; it also rejects NaN.
    if not all(within(component, -1.1, 1.1) for component in q) or abs(math.hypot(w, x, y, z) - 1.0) > _UNIT_TOLERANCE:
        return "the quaternion is not normalized"
    sine, cosine = 2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)
    if math.hypot(sine, cosine) < _UNIT_TOLERANCE:
        return "attitude points up or down: no heading"
    return SteerHeading(wrap_two_pi(math.atan2(sine, cosine)))


def direction_goal(message: Message, frame_rad: float) -> Goal:
    """Return the direction of the velocity or, if that is masked out, of the yaw; `frame_rad`: heading of the frame."""
    mask = message.type_mask
    if not mask & _IGNORE_VELOCITY:
        north, east = message.vx, message.vy
        is_in_range = within(north, -_MAX_SPEED_M_S, _MAX_SPEED_M_S) and within(east, -_MAX_SPEED_M_S, _MAX_SPEED_M_S)
        if not is_in_range or math.hypot(north, east) < _MIN_SPEED_M_S:
            return "the velocity has no direction"
        return SteerHeading(wrap_two_pi(math.atan2(east, north) + frame_rad), over_ground=True)
    if not mask & _IGNORE_YAW:
        if not within(message.yaw, -2.0 * math.pi, 2.0 * math.pi):
            return "the yaw is not within one turn"
        return SteerHeading(wrap_two_pi(message.yaw + frame_rad))
    return "position, velocity and yaw are all masked out"


def go_to_waypoint(context: LinkContext, peer: Peer, message: Message, now_s: float) -> None:
    """Go to the position of a waypoint, and acknowledge once the goal is stored for the next start."""
    result, refusal = _request_waypoint(context, message, now_s)

    def finish(is_stored: bool) -> None:  # noqa: FBT001 - callback of the request handler
        acknowledge(context, peer, sender_of(message), message.mission_type, result)
        if not is_stored:
            text = "guided waypoint active but not stored"
            context.send_text_limited(peer, Severity.ERROR, text, context.now_s)
        peer.outbox.flush(context.now_s)

    if result is PlanResult.ACCEPTED:
        context.request_handler.when_orders_stored(finish)
        return
    acknowledge(context, peer, sender_of(message), message.mission_type, result)
    if refusal:
        context.send_text_limited(peer, Severity.WARNING, refusal, now_s)


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


class ManualControl:
    """Converts MANUAL_CONTROL and RC_CHANNELS_OVERRIDE into rudder deflections."""

    def __init__(self, context: LinkContext) -> None:
        """Store the context, which sends messages and passes on requests."""
        self._context = context
        self._ignored_reason = ""  # latest report

    def handlers(self) -> Mapping[int, Handler]:
        """Return the message handlers by message id."""
        return {
            mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL: self._control_manually,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._override_channel,
        }

    def _control_manually(self, peer: Peer, message: Message, now_s: float) -> None:
        """Set the rudder by the roll axis y, or by the yaw axis r if y is marked invalid."""
        axis = message.r if message.y == INT16_MAX else message.y
        if axis == INT16_MAX:
            return
        is_valid = within(axis, -_FULL_STICK, _FULL_STICK)
        intent = ManualRudder(axis / _FULL_STICK) if is_valid else "the stick is not within -1000 to 1000"
        self._context.request_or_warn(peer, message, intent, now_s)

    def _override_channel(self, peer: Peer, message: Message, now_s: float) -> None:
        """Set the rudder by channel 1 (1000 to 2000 us; 0 releases it); an ignored override is reported once."""
        pulse_us, is_set = message.chan1_raw, message.chan1_raw not in (_RELEASE, _IGNORE)
        if is_set and not within(pulse_us, _CENTRE_US - _FULL_US, _CENTRE_US + _FULL_US):
            self._context.request_or_warn(peer, message, "channel 1 is not within 1000 to 2000", now_s)
            return
        self._report_ignored_override(peer, message, now_s)
        if pulse_us == _IGNORE:
            return
        self._context.override_us = (now_s, pulse_us) if is_set else None
        deflection = (pulse_us - _CENTRE_US) / _FULL_US if is_set else None
        self._context.request_or_warn(peer, message, ManualRudder(deflection), now_s)

    def _report_ignored_override(self, peer: Peer, message: Message, now_s: float) -> None:
        reason = self._reason_ignored(message)
        if reason and reason != self._ignored_reason:
            self._context.send_text_limited(peer, Severity.NOTICE, reason, now_s)
        self._ignored_reason = reason

    def _reason_ignored(self, message: Message) -> str:
        """Return the reason why an override is ignored; empty if it has an effect or only releases channels."""
        snapshot = self._context.snapshot
        if message.chan1_raw not in (_RELEASE, _IGNORE):
            if snapshot is not None and not snapshot.armed:
                return "RC override ignored: disarmed"
            if snapshot is not None and not MODES[snapshot.mode].base_mode & BaseMode.MANUAL_INPUT:
                return f"RC override ignored in {snapshot.mode.name}: {_CHANNEL_1}"
            return ""
        if any(getattr(message, name) not in (_RELEASE, _IGNORE) for name in _OTHER_CHANNELS):
            return f"RC override ignored: {_CHANNEL_1}"
        return ""


COMMANDS = (
    CommandRow(
        115,
        "CONDITION_YAW",
        condition_yaw,
        "heading param1 (deg), absolute or (param4 = 1) relative to the present one, to starboard or port (param3)",
        relative=True,
    ),
    CommandRow(
        192,
        "DO_REPOSITION",
        reposition,
        "go to param5, param6; flag 1 in param2 enters GUIDED; speed, radius and yaw are ignored",
    ),
    CommandRow(
        213,
        "NAV_SET_YAW_SPEED",
        set_yaw_speed,
        "heading param1 (deg), absolute or (param3 = 1) relative to the present one; speed is ignored",
        relative=True,
    ),
    CommandRow(
        43002, "GUIDED_CHANGE_HEADING", change_heading, "heading (param1 = 1) or course over ground (0) param2 (deg)"
    ),
)
