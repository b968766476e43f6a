"""Commands of the workshop: the rudder on the bench, its centre, the compass's mounting, what is stored."""

from __future__ import annotations

import math

from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.intents import Answer, BenchRudder, ForgetParameters, SetParameter, Verdict
from firmware_py.common.interfaces import Calibrator
from firmware_py.common.records import CalibrationState, Severity
from firmware_py.link.commands import compass_swing
from firmware_py.link.commands.pending import PendingCommand, once_stored
from firmware_py.link.commands.server import ACCEPTED, CommandCall
from firmware_py.link.context import LinkContext, within

BENCH_S = 10.0  # a rudder on the bench goes back amidships unless it is told again

_CENTRE_US, _FULL_US = 1500.0, 500.0
_RUDDER_SERVO = 1.0
_TRIM = 2.0  # param4 of PREFLIGHT_CALIBRATION: the present position is neutral
_READ, _WRITE, _RESET = 0.0, 1.0, 2.0
_ARMED = Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: armed")
_NOT_CALIBRATED_HERE = (
    "there are the rudder's centre (param4 = 2) and the compass (param2 = 1, or DO_START_MAG_CAL under way); "
    "FIXED_MAG_CAL_YAW aligns any compass to a known heading"
)
CIRCLE_TIMEOUT_S = 900.0


def set_servo(context: LinkContext, call: CommandCall) -> Answer:
    """Hold the rudder somewhere for a while, on the bench: servo 1, 1000 to 2000 us as in SERVO_OUTPUT_RAW."""
    servo, pulse_us = call.parameters[:2]
    if servo != _RUDDER_SERVO:
        return call.denied("there is servo 1, the rudder, only")
    if not within(pulse_us, _CENTRE_US - _FULL_US, _CENTRE_US + _FULL_US):
        return call.denied("the pulse is not within 1000 to 2000 us")
    return context.request(call.message, BenchRudder((pulse_us - _CENTRE_US) / _FULL_US, BENCH_S), call.now_s)


def calibrate(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Take the rudder as it stands for amidships (param4 = 2), or calibrate the compass (param2 = 1).

    A compass that can does so by itself, disarmed; else a swing under way is begun. The rest is refused with what to do
    instead.
    """
    asked = (*call.parameters, call.x, call.y, call.z)
    wanted = {number: value for number, value in enumerate(asked, start=1) if value and not math.isnan(value)}
    if not wanted:
        return ACCEPTED
    if wanted == {2: 1.0}:
        compass = context.suppliers.calibrator
        return compass_swing.begin(context) if compass is None else _calibrate_compass(context, call, compass)
    if wanted != {4: _TRIM}:
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: {_NOT_CALIBRATED_HERE}")
    boat = context.snapshot
    if boat is None or boat.armed:
        return _ARMED
    shaft_rad = boat.servo.shaft_rad if boat.servo is not None and boat.rudder_ok else None
    if shaft_rad is None or not math.isfinite(shaft_rad):
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: the rudder servo gives no angle")
    answer = _set(context, call, "RUD_CENTRE_DEG", degrees(wrap_pi(shaft_rad)))
    if isinstance(answer, PendingCommand):
        # Off the bench: from the new centre the old deflection is another place.
        context.request(call.message, BenchRudder(0.0, 0.0), call.now_s)
    return answer


def _calibrate_compass(context: LinkContext, call: CommandCall, compass: Calibrator) -> Answer | PendingCommand:
    """Have the compass sample while the boat is turned slowly through a full circle; it may be cancelled."""
    if context.snapshot is None or context.snapshot.armed:
        return _ARMED
    if not compass.calibrate(call.now_s):
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: the compass is not there or at it already")

    def ended() -> Answer | None:
        now = compass.calibration()
        if now.state is CalibrationState.RUNNING:
            return None
        if now.state is not CalibrationState.DONE:
            return Answer(Verdict.FAILED, now.text or "Compass calibration was broken off")
        context.send_text(call.peer, Severity.NOTICE, now.text)
        return ACCEPTED

    context.send_text(call.peer, Severity.NOTICE, "Compass calibration: turn her slowly through a full circle")
    return PendingCommand(
        timeout_s=CIRCLE_TIMEOUT_S,
        percent=lambda: compass.calibration().percent,
        cancel=compass.call_off,
        poll=ended,
    )


def align_compass(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Mount the compass so that its heading now is the one that is known: from true north, in degrees."""
    yaw_deg, compasses = call.parameters[:2]
    if not within(yaw_deg, -360.0, 360.0):
        return call.denied("the yaw is not within -360 to 360 deg")
    if compasses not in (0.0, 1.0) and not math.isnan(compasses):
        return call.denied("there is one compass, mask 0 or 1")
    boat = context.snapshot
    if boat is None or boat.armed:
        return _ARMED
    if boat.heading_rad is None or not boat.heading_ok:
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: no valid heading")
    offset_rad = radians(context.request_handler.parameters()["CMP_OFFSET_DEG"])
    aligned_rad = wrap_pi(offset_rad + radians(yaw_deg) - boat.heading_rad)
    return _set(context, call, "CMP_OFFSET_DEG", degrees(aligned_rad))


def _set(context: LinkContext, call: CommandCall, name: str, value: float) -> Answer | PendingCommand:
    """Set a parameter, and be done once it is on disk."""
    answer = context.request(call.message, SetParameter(name, value), call.now_s)
    if answer.verdict is not Verdict.ACCEPTED:
        return answer
    text = f"{name} is now {context.request_handler.parameters()[name]:.2f}"
    return once_stored(context, call, text, f"{name} is in force but could not be stored")


def storage(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Read or write what is stored, which is always what is in force; or (param1 = 2) forget what links have set."""
    parameters, plans = call.parameters[:2]
    if parameters not in (_READ, _WRITE, _RESET):
        return call.denied("param1 is neither 0 (read), 1 (write) nor 2 (reset)")
    if plans not in (_READ, _WRITE) and not math.isnan(plans) and plans != -1.0:
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: plans are cleared by MISSION_CLEAR_ALL")
    if parameters == _RESET:
        answer = context.request(call.message, ForgetParameters(), call.now_s)
        if answer.verdict is not Verdict.ACCEPTED:
            return answer
        text = "Parameters are those of the vehicle file from the next start on"
        return once_stored(context, call, text, "this could not be stored; they stay as they are")
    if parameters == _READ:
        return ACCEPTED
    return once_stored(context, call, "All is stored", "not all could be stored; it is tried again by itself")
