"""Commands that give a heading or a position to go to."""

from __future__ import annotations

from firmware_py.common.angles import radians
from firmware_py.common.intents import Answer, SteerHeading
from firmware_py.link.commands.server import CommandCall
from firmware_py.link.context import LinkContext, within
from firmware_py.link.positions import GLOBAL_FRAMES, position_goal

_CHANGE_MODE = 1  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
_COURSE_OVER_GROUND, _HEADING = 0.0, 1.0  # HEADING_TYPE
_HOW_RELATIVE = "param{} says neither absolute (0) nor relative (1)"


def condition_yaw(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to an angle: absolute, or relative to the present heading with the direction in param3.

    A negative relative angle without a direction means to port. The rate of turn
    (param2) is not ours to choose and is ignored.
    """
    angle_deg, _, direction, relative = call.parameters
    if relative not in (0.0, 1.0):
        return call.denied(_HOW_RELATIVE.format(4))
    if direction not in (-1.0, 0.0, 1.0):
        return call.denied("the direction is not -1, 0 or 1")
    lowest_deg = -360.0 if relative and not direction else 0.0
    if not within(angle_deg, lowest_deg, 360.0):
        return call.denied("the angle is not within 0 to 360 deg")
    turn = int(direction)
    turn_deg = -angle_deg if relative and turn < 0 else angle_deg
    goal = SteerHeading(radians(turn_deg), relative=relative == 1.0, turn=turn)
    return context.request(call.message, goal, call.now_s)


def change_heading(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to a heading or to a course over ground."""
    kind, angle_deg = call.parameters[:2]
    if kind not in (_COURSE_OVER_GROUND, _HEADING):
        return call.denied("the type is neither course over ground (0) nor heading (1)")
    if not within(angle_deg, 0.0, 360.0):
        return call.denied("the angle is not within 0 to 360 deg")
    goal = SteerHeading(radians(angle_deg), over_ground=kind == _COURSE_OVER_GROUND)
    return context.request(call.message, goal, call.now_s)


def set_yaw_speed(context: LinkContext, call: CommandCall) -> Answer:
    """Steer to an angle, absolute or (param3 = 1) from the present heading; a wave glider's speed is the sea's."""
    angle_deg, _, relative, _ = call.parameters
    if relative not in (0.0, 1.0):
        return call.denied(_HOW_RELATIVE.format(3))
    if not within(angle_deg, -360.0, 360.0):
        return call.denied("the angle is not within -360 to 360 deg")
    return context.request(call.message, SteerHeading(radians(angle_deg), relative=relative == 1.0), call.now_s)


def reposition(context: LinkContext, call: CommandCall) -> Answer:
    """Go to a position; speed, radius and yaw are ignored."""
    flags = call.parameters[1]
    if not within(flags, 0, 0xFFFF):
        return call.denied("the flags are not a number")
    if call.frame is not None and call.frame not in GLOBAL_FRAMES:
        return call.denied(f"frame {call.frame} is not a global one")
    goal = position_goal(*call.place_deg, change_mode=bool(int(flags) & _CHANGE_MODE))
    return call.denied(goal) if isinstance(goal, str) else context.request(call.message, goal, call.now_s)
