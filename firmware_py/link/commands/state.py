"""Commands on the state of the autopilot: mode, arming, checks."""

from __future__ import annotations

import math

from firmware_py.common.intents import Answer, Arm, Restart, SetMode, Verdict
from firmware_py.common.mode_table import Mode
from firmware_py.common.records import Severity
from firmware_py.link.commands.server import ACCEPTED, PARAM1_NOT_0_OR_1, CommandAction, CommandCall, CommandRow
from firmware_py.link.context import LinkContext, within
from firmware_py.link.telemetry import identity
from firmware_py.link.telemetry.fields import INT32_MAX, UINT32_MAX
from firmware_py.link.wire.dialect import mavlink

_FORCE = 21196  # MAVLink's number for arming or disarming without checks
_FORCE_RESTART = 20190226  # REBOOT_SHUTDOWN_CONDITIONS_FORCE, in param6
_CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def set_mode(context: LinkContext, call: CommandCall) -> Answer:
    """Enter the custom mode param2; the flags in param1 must include CUSTOM_MODE_ENABLED."""
    base_mode, custom_mode = call.parameters[:2]
    if not within(base_mode, 0, 255) or not int(base_mode) & _CUSTOM:
        return call.deny("only custom modes can be set")
    if not within(custom_mode, 0, UINT32_MAX) or custom_mode != int(custom_mode):
        return call.deny("the mode is not a whole number")
    return context.request(call.message, SetMode(int(custom_mode)), call.now_s)


def set_standard_mode(context: LinkContext, call: CommandCall) -> Answer:
    """Enter the mode of a MAV_STANDARD_MODE."""
    number = call.parameters[0]
    mode = identity.mode_of_standard(int(number)) if within(number, 0, 255) and number == int(number) else None
    if mode is None:
        return Answer(Verdict.FAILED, f"{call.name}: standard mode not supported; use 5 (RTL) or 6 (AUTO)")
    return context.request(call.message, SetMode(mode), call.now_s)


def _make_mode_action(mode: Mode) -> CommandAction:
    def enter_mode(context: LinkContext, call: CommandCall) -> Answer:
        return context.request(call.message, SetMode(int(mode)), call.now_s)

    return enter_mode


return_to_launch = _make_mode_action(Mode.RTL)


def loiter(context: LinkContext, call: CommandCall) -> Answer:
    """Enter LOITER at the present position (param5 and param6: 0, NaN or INT32_MAX); refuse another one."""
    if any(value not in (0.0, INT32_MAX) and not math.isnan(value) for value in (call.x, call.y)):
        return call.deny("position not supported; use DO_REPOSITION")
    return context.request(call.message, SetMode(int(Mode.LOITER)), call.now_s)


def restart(context: LinkContext, call: CommandCall) -> Answer:
    """Restart the autopilot (param1 = 1) or shut it down (2).

    The computer (param2) and other components (param3) cannot be restarted; NaN means "not used".
    """
    action, computer, component = call.parameters[:3]
    if action not in (0.0, 1.0, 2.0):
        return call.deny("param1 is neither 0, 1 (restart) nor 2 (shut down)")
    if any(not math.isnan(value) and value != 0.0 for value in (computer, component)):
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: only the autopilot itself can be restarted")
    if action == 0.0:
        return ACCEPTED
    return context.request(call.message, Restart(shutdown=action == 2.0, force=call.y == _FORCE_RESTART), call.now_s)


def arm_disarm(context: LinkContext, call: CommandCall) -> Answer:
    """Arm (param1 = 1) or disarm (0)."""
    state, force = call.parameters[:2]
    if state not in (0.0, 1.0):
        return call.deny(PARAM1_NOT_0_OR_1)
    return context.request(call.message, Arm(state == 1.0, force == _FORCE), call.now_s)


def run_prearm_checks(context: LinkContext, call: CommandCall) -> Answer:
    """Report whether arming would be accepted, or the reason of a refusal."""
    if context.snapshot is None:
        return Answer(Verdict.TEMPORARILY_REJECTED, "PreArm: starting")
    if context.snapshot.armed:
        return Answer(Verdict.TEMPORARILY_REJECTED, "PreArm: already armed")
    refusal = context.snapshot.prearm_refusal
    severity, text = (Severity.WARNING, f"PreArm: {refusal}") if refusal else (Severity.INFO, "PreArm: all good")
    context.send_text_limited(call.peer, severity, text, call.now_s)
    return ACCEPTED


def send_banner(context: LinkContext, call: CommandCall) -> Answer:
    """Report the name and version of the program."""
    version = context.version
    version_text = f"{version.major}.{version.minor}.{version.patch}"
    commit = f" (git {version.commit})" if version.commit else ""
    context.send_text_limited(call.peer, Severity.INFO, f"Rambler {version_text}{commit}", call.now_s)
    return ACCEPTED


COMMANDS = (
    CommandRow(17, "NAV_LOITER_UNLIM", loiter, "enter LOITER at the present position; another position is refused"),
    CommandRow(20, "NAV_RETURN_TO_LAUNCH", return_to_launch, "enter RTL"),
    CommandRow(176, "DO_SET_MODE", set_mode, "enter the custom mode param2"),
    CommandRow(
        246,
        "PREFLIGHT_REBOOT_SHUTDOWN",
        restart,
        "disarmed, or forced by param6 = 20190226: restart the autopilot (param1 = 1), end it (2)",
    ),
    CommandRow(262, "DO_SET_STANDARD_MODE", set_standard_mode, "enter AUTO (param1 = 6) or RTL (5)"),
    CommandRow(400, "COMPONENT_ARM_DISARM", arm_disarm, "arm (param1 = 1) or disarm (0); param2 = 21196 forces"),
    CommandRow(401, "RUN_PREARM_CHECKS", run_prearm_checks, "report the reason that prevents arming", repeatable=True),
    CommandRow(42428, "DO_SEND_BANNER", send_banner, "report the version", repeatable=True),
)
