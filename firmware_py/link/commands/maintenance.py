"""Maintenance commands: rudder test on the bench, rudder centre, compass alignment and swing, storage."""

from __future__ import annotations

import math
from collections.abc import Mapping

from firmware_py.common.angles import degrees, radians, wrap_pi
from firmware_py.common.intents import Answer, BenchRudder, ForgetParameters, Request, SetParameter, Verdict
from firmware_py.common.interfaces import Calibrator
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.records import CalibrationState, Severity
from firmware_py.link.commands.server import ACCEPTED, CommandCall, CommandRow, PendingCommand, finish_when_stored
from firmware_py.link.context import LinkContext, within
from firmware_py.link.telemetry.status import swing_report_message

BENCH_S = 10.0  # after this time the rudder returns to amidships, unless the command is repeated

_CENTRE_US, _FULL_US = 1500.0, 500.0  # pulse of the rudder amidships, and its change to full deflection
_RUDDER_SERVO = 1.0
_TRIM = 2.0  # param4 of PREFLIGHT_CALIBRATION: the present position is neutral
_READ, _WRITE, _RESET = 0.0, 1.0, 2.0  # of PREFLIGHT_STORAGE
_ARMED = Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: armed")
_SUPPORTED_CALIBRATIONS = (
    "supported are the rudder centre (param4 = 2) and the compass (param2 = 1, or DO_START_MAG_CAL under way); "
    "FIXED_MAG_CAL_YAW aligns any compass to a known heading"
)
_COMPASS_TIMEOUT_S = 900.0

_DEVIATION_NAMES = tuple(f"CMP_DEV_{letter}" for letter in "ABCDE")


def set_servo(context: LinkContext, call: CommandCall) -> Answer:
    """Set the rudder angle for BENCH_S: servo 1, 1000 to 2000 us as in SERVO_OUTPUT_RAW."""
    servo, pulse_us = call.parameters[:2]
    if servo != _RUDDER_SERVO:
        return call.deny("only servo 1, the rudder, is supported")
    if not within(pulse_us, _CENTRE_US - _FULL_US, _CENTRE_US + _FULL_US):
        return call.deny("the pulse is not within 1000 to 2000 us")
    return context.request(call.message, BenchRudder((pulse_us - _CENTRE_US) / _FULL_US, BENCH_S), call.now_s)


def calibrate(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Set the present rudder angle as amidships (param4 = 2), or calibrate the compass (param2 = 1).

    If the compass has its own calibration, that is started; the boat must be disarmed. Otherwise a swing is started.
    Other calibrations are refused with a remedy.
    """
    values = (*call.parameters, call.x, call.y, call.z)
    requested = {number: value for number, value in enumerate(values, start=1) if value and not math.isnan(value)}
    if not requested:
        return ACCEPTED
    if requested == {2: 1.0}:
        compass = context.suppliers.calibrator
        return begin_swing(context) if compass is None else _calibrate_compass(context, call, compass)
    if requested != {4: _TRIM}:
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: {_SUPPORTED_CALIBRATIONS}")
    snapshot = context.snapshot
    if snapshot is None or snapshot.armed:
        return _ARMED
    shaft_rad = snapshot.servo.shaft_rad if snapshot.servo is not None and snapshot.rudder_ok else None
    if shaft_rad is None or not math.isfinite(shaft_rad):
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: no rudder angle from the servo")
    answer = _set_parameter(context, call, "RUD_CENTRE_DEG", degrees(wrap_pi(shaft_rad)))
    if isinstance(answer, PendingCommand):
        # The bench command ends: relative to the new centre, its deflection is another angle.
        context.request(call.message, BenchRudder(0.0, 0.0), call.now_s)
    return answer


def _calibrate_compass(context: LinkContext, call: CommandCall, compass: Calibrator) -> Answer | PendingCommand:
    """Start the calibration of the compass itself, during which the boat is turned slowly through a circle."""
    if context.snapshot is None or context.snapshot.armed:
        return _ARMED
    if not compass.calibrate(call.now_s):
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: compass missing or busy")

    def poll() -> Answer | None:
        calibration = compass.calibration()
        if calibration.state is CalibrationState.RUNNING:
            return None
        if calibration.state is not CalibrationState.DONE:
            return Answer(Verdict.FAILED, calibration.text or "Compass calibration aborted")
        context.send_text(call.peer, Severity.NOTICE, calibration.text)
        return ACCEPTED

    context.send_text(call.peer, Severity.NOTICE, "Compass calibration: turn a full circle by hand, ashore")
    return PendingCommand(
        timeout_s=_COMPASS_TIMEOUT_S, percent=lambda: compass.calibration().percent, cancel=compass.cancel, poll=poll
    )


def align_compass(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Set the compass offset so that the present heading equals param1, in degrees from true north."""
    yaw_deg, mask = call.parameters[:2]
    if not within(yaw_deg, -360.0, 360.0):
        return call.deny("the yaw is not within -360 to 360 deg")
    if mask not in (0.0, 1.0) and not math.isnan(mask):
        return call.deny(f"compass mask (param2) {mask:g} is neither 0 nor 1")
    snapshot = context.snapshot
    if snapshot is None or snapshot.armed:
        return _ARMED
    if snapshot.heading_rad is None or not snapshot.heading_ok:
        return Answer(Verdict.TEMPORARILY_REJECTED, "Calibration refused: no valid heading")
    offset_rad = radians(context.request_handler.parameters()["CMP_OFFSET_DEG"])
    aligned_rad = wrap_pi(offset_rad + radians(yaw_deg) - snapshot.heading_rad)
    return _set_parameter(context, call, "CMP_OFFSET_DEG", degrees(aligned_rad))


def _set_parameter(context: LinkContext, call: CommandCall, name: str, value: float) -> Answer | PendingCommand:
    """Set a parameter; the command ends when it is stored."""
    answer = context.request(call.message, SetParameter(name, value), call.now_s)
    if answer.verdict is not Verdict.ACCEPTED:
        return answer
    text = f"{name} is now {context.request_handler.parameters()[name]:.2f}"
    return finish_when_stored(context, call, text, f"{name} active but not stored")


def manage_storage(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Reset the parameters that links have set (param1 = 2); read (0) and write (1) have no effect on the values."""
    parameters, plans = call.parameters[:2]
    if parameters not in (_READ, _WRITE, _RESET):
        return call.deny("param1 is neither 0 (read), 1 (write) nor 2 (reset)")
    if plans not in (_READ, _WRITE) and not math.isnan(plans) and plans != -1.0:
        return Answer(Verdict.UNSUPPORTED, f"{call.name}: plans are cleared by MISSION_CLEAR_ALL")
    if parameters == _RESET:
        answer = context.request(call.message, ForgetParameters(), call.now_s)
        if answer.verdict is not Verdict.ACCEPTED:
            return answer
        text = "Parameters reset to the vehicle file at the next start"
        return finish_when_stored(context, call, text, "not stored, parameters unchanged")
    if parameters == _READ:
        return ACCEPTED
    return finish_when_stored(context, call, "All settings stored", "not all stored; retrying")


def start_swing(context: LinkContext, call: CommandCall) -> Answer:
    """Start a swing if the mask selects the compass and `begin_swing` does not refuse it."""
    if (denial := _check_mask(call)) is not None:
        return denial
    return begin_swing(context)


def begin_swing(context: LinkContext) -> Answer:
    """Start a swing, or return the reason of a refusal."""
    swing, snapshot = context.request_handler.compass_swing, context.snapshot
    if snapshot is None or not snapshot.armed:
        return _refuse_swing("disarmed")
    if not snapshot.heading_ok:
        return _refuse_swing("no valid heading")
    if not snapshot.position_ok:
        return _refuse_swing("no position")
    if swing.report.state is not CalibrationState.NONE:
        return _refuse_swing("already in progress, cancel it first")
    swing.begin(context.request_handler.parameters())
    context.send_text_all(Severity.NOTICE, "Compass swing: sail all headings, 15 min each, then accept")
    return ACCEPTED


def accept_swing(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Set the proposed deviation parameters."""
    if (denial := _check_mask(call)) is not None:
        return denial
    swing = context.request_handler.compass_swing
    report = swing.report
    if report.state is not CalibrationState.DONE:
        return Answer(Verdict.TEMPORARILY_REJECTED, f"Compass swing: nothing to accept, {report.percent} % done")
    values = {
        name: round(degrees(value), 2) for name, value in zip(_DEVIATION_NAMES, report.estimated_rad, strict=True)
    }
    answer = _set_deviation(context, call, values, "set", can_undo=True)
    if isinstance(answer, PendingCommand):
        context.send_all(swing_report_message(report, is_saved=True))
    return answer


def cancel_swing(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """End a swing and discard its proposal, or restore the values before an accepted proposal.

    It is also accepted without a swing: QGroundControl tests in this way whether the command is supported.
    """
    if (denial := _check_mask(call)) is not None:
        return denial
    swing = context.request_handler.compass_swing
    if swing.former is not None:
        return _set_deviation(context, call, swing.former, "restored", can_undo=False)
    if swing.report.state is not CalibrationState.NONE:
        swing.end()
        context.send_text_all(Severity.NOTICE, "Compass swing: cancelled, nothing was set")
    return ACCEPTED


def _set_deviation(
    context: LinkContext, call: CommandCall, values: Mapping[str, float], action: str, *, can_undo: bool
) -> Answer | PendingCommand:
    """Set all five values (degrees) or none, and end the swing; `action` ends the text to the operator.

    `can_undo`: store the former values for a later cancel.
    """
    parameters = former = context.request_handler.parameters()
    try:
        for name, value in values.items():
            parameters = parameters.replaced(name, value)
    except ParameterError as error:
        return Answer(Verdict.DENIED, str(error))
    requests = [Request(call.now_s, SetParameter(name, value), *call.sender) for name, value in values.items()]
    answer = context.request_handler.decide_together(requests)
    if answer.verdict is not Verdict.ACCEPTED:
        return answer
    context.request_handler.compass_swing.end({name: former[name] for name in values} if can_undo else None)
    deviations = " ".join(f"{name[-1]} {value:.2f}" for name, value in values.items())
    text = f"Compass swing: {deviations} deg {action}"
    return finish_when_stored(context, call, text, "deviation active but not stored")


def _check_mask(call: CommandCall) -> Answer | None:
    """Return the refusal of a compass mask (param1), or None if it selects the compass."""
    mask = call.parameters[0]
    if mask in (0.0, 1.0) or math.isnan(mask):
        return None
    return call.deny(f"compass mask (param1) {mask:g} is neither 0 nor 1")


def _refuse_swing(reason: str) -> Answer:
    return Answer(Verdict.TEMPORARILY_REJECTED, f"Compass swing refused: {reason}")


COMMANDS = (
    CommandRow(183, "DO_SET_SERVO", set_servo, "disarmed, on the bench: rudder (servo 1) to param2 (us) for 10 s"),
    CommandRow(
        241,
        "PREFLIGHT_CALIBRATION",
        calibrate,
        "disarmed: param4 = 2 sets the present rudder angle as amidships (`RUD_CENTRE_DEG`); param2 = 1 has a PNI "
        "compass calibrate itself while the boat is turned through a circle (IN_PROGRESS, COMMAND_CANCEL); with "
        "another compass it is DO_START_MAG_CAL",
    ),
    CommandRow(
        245,
        "PREFLIGHT_STORAGE",
        manage_storage,
        "param1 = 2, disarmed: from the next start on the vehicle file's parameters; 0 and 1: they are always stored",
    ),
    CommandRow(
        42006,
        "FIXED_MAG_CAL_YAW",
        align_compass,
        "disarmed: the boat heads param1 (deg true) now; sets `CMP_OFFSET_DEG`",
    ),
    CommandRow(
        42424,
        "DO_START_MAG_CAL",
        start_swing,
        "armed, under way: estimate the deviation of compass A; progress in MAG_CAL_PROGRESS, MAG_CAL_REPORT and a "
        "text; nothing is saved before DO_ACCEPT_MAG_CAL (param3), retry and delays are ignored",
    ),
    CommandRow(
        42425,
        "DO_ACCEPT_MAG_CAL",
        accept_swing,
        "set the deviation that a swing of the compass proposes (`CMP_DEV_A` to `CMP_DEV_E`)",
    ),
    CommandRow(
        42426,
        "DO_CANCEL_MAG_CAL",
        cancel_swing,
        "end a swing and drop its proposal; after its acceptance: restore the former values",
    ),
)
