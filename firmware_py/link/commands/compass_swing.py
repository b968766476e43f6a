"""A swing of the compass under way: begun, accepted and cancelled as ground stations do it with ArduPilot.

Stations ask for their calibration to be saved by itself; here nothing is set before it is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from firmware_py.common.angles import degrees
from firmware_py.common.intents import Answer, Request, SetParameter, Verdict
from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.records import CalibrationState, Severity
from firmware_py.link.commands.pending import PendingCommand, once_stored
from firmware_py.link.commands.server import ACCEPTED, CommandCall
from firmware_py.link.context import LinkContext
from firmware_py.link.telemetry.compass_swing import report_of

_NAMES = tuple(f"CMP_DEV_{letter}" for letter in "ABCDE")


def start(context: LinkContext, call: CommandCall) -> Answer:
    """Begin to look on while she sails; refused where she could sail for days without anything to be seen."""
    if (denial := _denial(call)) is not None:
        return denial
    return begin(context)


def begin(context: LinkContext) -> Answer:
    """Begin a swing, or say what it lacks."""
    swing, boat = context.request_handler.compass_swing, context.snapshot
    if boat is None or not boat.armed:
        return _refused("disarmed")
    if not boat.heading_ok:
        return _refused("no valid heading")
    if not boat.position_ok:
        return _refused("no position")
    if swing.report.state is not CalibrationState.NONE:
        return _refused("one is under way, cancel it first")
    swing.begin(context.request_handler.parameters())
    text = "Compass swing: sail courses all round, a quarter of an hour each; nothing is set until you accept"
    context.send_text_all(Severity.NOTICE, text)
    return ACCEPTED


def accept(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """Make the parameters what is proposed."""
    if (denial := _denial(call)) is not None:
        return denial
    swing = context.request_handler.compass_swing
    report = None if swing is None else swing.report
    if swing is None or report is None or report.state is not CalibrationState.DONE:
        percent = 0 if report is None else report.percent
        return Answer(
            Verdict.TEMPORARILY_REJECTED, f"Compass swing: nothing to accept, {percent} percent of it is done"
        )
    values = {name: round(degrees(value), 2) for name, value in zip(_NAMES, report.found_rad, strict=True)}
    answer = _set(context, call, values, "is in force", undo=True)
    if isinstance(answer, PendingCommand):
        context.send_all(report_of(report, saved=True))
    return answer


def cancel(context: LinkContext, call: CommandCall) -> Answer | PendingCommand:
    """End a swing, drop its proposal, or take back the one that was accepted last.

    Accepted when there is nothing to be cancelled, too: QGroundControl asks so whether this is known here.
    """
    if (denial := _denial(call)) is not None:
        return denial
    swing = context.request_handler.compass_swing
    if swing.former is not None:
        return _set(context, call, swing.former, "is taken back", undo=False)
    if swing.report.state is not CalibrationState.NONE:
        swing.end()
        context.send_text_all(Severity.NOTICE, "Compass swing: cancelled, nothing was set")
    return ACCEPTED


def _set(
    context: LinkContext, call: CommandCall, values: Mapping[str, float], what: str, *, undo: bool
) -> Answer | PendingCommand:
    """Set all five or none, and end the swing; `undo`: what they were is kept, to go back to."""
    parameters = before = context.request_handler.parameters()
    try:
        for name, value in values.items():
            parameters = parameters.replaced(name, value)
    except ParameterError as error:
        return Answer(Verdict.DENIED, str(error))
    requests = [Request(call.now_s, SetParameter(name, value), *call.sender) for name, value in values.items()]
    answer = context.request_handler.decide_together(requests)
    if answer.verdict is not Verdict.ACCEPTED:
        return answer
    context.request_handler.compass_swing.end({name: before[name] for name in values} if undo else None)
    shown = " ".join(f"{name[-1]} {value:.2f}" for name, value in values.items())
    text = f"Compass swing: {shown} deg {what}"
    return once_stored(context, call, text, "the deviation is in force but could not be stored")


def _denial(call: CommandCall) -> Answer | None:
    mask = call.parameters[0]
    return None if mask in (0.0, 1.0) or math.isnan(mask) else call.denied("there is one compass, mask 0 or 1")


def _refused(why: str) -> Answer:
    return Answer(Verdict.TEMPORARILY_REJECTED, f"Compass swing refused: {why}")
