"""Rudder state: last command, servo feedback, and their conversion to rudder angles."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import Inputs, RudderFeedback, RudderStatus
from firmware_py.control.rudder_limit import Linkage, RudderLimits

MAX_SHAFT_RAD: Final = 2.0 * math.pi  # larger feedback is invalid


class RudderSettings(msgspec.Struct, frozen=True):
    """Linkage between servo and rudder, and limits of angle and rate.

    `hold_s`: time for which the command is constant without a heading. `released_disarmed`: the servo has no torque
    while disarmed.
    """

    linkage: Linkage
    limits: RudderLimits
    hold_s: float
    released_disarmed: bool

    @classmethod
    def of(cls, parameters: ParameterSet) -> RudderSettings:
        """Read the settings from the parameters."""
        return cls(
            linkage=Linkage.of(parameters),
            limits=RudderLimits.of(parameters),
            hold_s=parameters["CTL_HOLD_S"],
            released_disarmed=bool(parameters["RUD_DISARMED"]),
        )


class RudderState(msgspec.Struct, frozen=True):
    """Last rudder command, last servo feedback, number of servo restarts and time of the last one."""

    command_rad: float = 0.0
    feedback: RudderFeedback | None = None
    restarts: int = 0
    restarted_s: float | None = None

    @property
    def feedback_s(self) -> float | None:
        """Time of the last feedback; None before the first."""
        return None if self.feedback is None else self.feedback.t_s


def update(settings: RudderSettings, state: RudderState, inputs: Inputs) -> tuple[RudderState, RudderStatus]:
    """Return the state updated with the feedback of a tick, and the rudder status."""
    now_s = inputs.tick.t_s
    if inputs.rudder:
        newest = inputs.rudder[-1]
        restarted_s = now_s if newest.restarts > state.restarts else state.restarted_s
        state = RudderState(state.command_rad, newest, newest.restarts, restarted_s)
    return state, _status(settings.linkage, state, now_s, is_new=bool(inputs.rudder))


def _status(linkage: Linkage, state: RudderState, now_s: float, *, is_new: bool) -> RudderStatus:
    feedback = state.feedback
    if feedback is None:
        return RudderStatus(now_s, state.command_rad, state.command_rad)
    shaft_rad, power_w = feedback.shaft_rad, None
    is_measured = shaft_rad is not None and abs(shaft_rad) <= MAX_SHAFT_RAD
    if feedback.voltage_v is not None and feedback.current_a is not None:
        power_w = feedback.voltage_v * abs(feedback.current_a)
    return RudderStatus(
        now_s,
        state.command_rad,
        linkage.to_rudder(shaft_rad) if shaft_rad is not None and is_measured else state.command_rad,
        measured=is_measured,
        is_new=is_new,
        feedback_s=feedback.t_s,
        torque_on=feedback.torque_on,
        current_a=feedback.current_a,
        power_w=power_w if power_w is not None and math.isfinite(power_w) else None,
    )
