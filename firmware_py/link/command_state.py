"""Commands on the state of the autopilot: mode, arming, checks."""

from __future__ import annotations

from firmware_py.intents import Answer, Arm, SetMode, Verdict
from firmware_py.link.commands import ACCEPTED, Call
from firmware_py.link.dialect import mavlink
from firmware_py.link.scene import UINT32_MAX
from firmware_py.link.session import Session, within
from firmware_py.records import Severity

_FORCE = 21196  # MAVLink's number for arming or disarming whatever the checks say
_CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def set_mode(session: Session, call: Call) -> Answer:
    """Enter a mode. Only custom modes: the flags of base_mode say nothing definite. The number is taken whole."""
    base_mode, custom_mode = call.parameters[:2]
    if not within(base_mode, 0, 255) or not int(base_mode) & _CUSTOM:
        return call.denied("only custom modes can be set")
    if not within(custom_mode, 0, UINT32_MAX) or custom_mode != int(custom_mode):
        return call.denied("the mode is not a whole number")
    return session.ask(call.message, SetMode(int(custom_mode)), call.now_s)


def arm_disarm(session: Session, call: Call) -> Answer:
    """Arm or disarm."""
    wanted, force = call.parameters[:2]
    if wanted not in (0.0, 1.0):
        return call.denied("param1 is neither 0 nor 1")
    return session.ask(call.message, Arm(wanted == 1.0, force == _FORCE), call.now_s)


def run_prearm_checks(session: Session, call: Call) -> Answer:
    """Say whether arming would be accepted, and why not."""
    if session.snapshot is None:
        return Answer(Verdict.TEMPORARILY_REJECTED, "PreArm: starting")
    if session.snapshot.armed:
        return Answer(Verdict.TEMPORARILY_REJECTED, "PreArm: already armed")
    refusal = session.suppliers.prearm_refusal(session.snapshot)
    severity, text = (Severity.WARNING, f"PreArm: {refusal}") if refusal else (Severity.INFO, "PreArm: all good")
    session.say(call.peer, severity, text, call.now_s)
    return ACCEPTED
