"""Heading controllers for each value of CTL_MODE: from a heading error to a rudder demand.

The calculation is in law.py. A new controller needs its law, a function here, a row of TABLE, and a value of the
parameter CTL_MODE; its state is a field of `LawState`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import msgspec

from firmware_py.common.parameters import ParameterSet
from firmware_py.control import law
from firmware_py.control.law import IDLE, Gains, LawSettings, LawState
from firmware_py.model.heading_estimate import HeadingEstimate


class HeadingControllerInput(msgspec.Struct, frozen=True):
    """Input of a controller in a tick.

    `error_rad` is the goal minus the heading, positive to starboard; in a turn of more than half a circle it is limited
    to pi. `estimate` is None while only the fixed-gain observer is available. `command_rad` is the rudder command of
    the previous tick, `gain_reduction` the divisor of the gain, 1 or more.
    """

    error_rad: float
    yaw_rate_rad_s: float
    estimate: HeadingEstimate | None
    command_rad: float
    step_s: float
    gain_reduction: float


Controller = Callable[[LawState, HeadingControllerInput], tuple[LawState, float | None]]
"""A controller with its settings: returns its state and the rudder demand [rad], or None if it cannot steer."""


def steer_by_fixed_gains(gains: Gains, _state: LawState, inputs: HeadingControllerInput) -> tuple[LawState, float]:
    """Return the rudder demand [rad] of the fixed gains, which have no state."""
    return IDLE, law.s_surface(gains, inputs.error_rad, inputs.yaw_rate_rad_s)


def steer_by_schedule(
    settings: LawSettings, state: LawState, inputs: HeadingControllerInput
) -> tuple[LawState, float | None]:
    """Return the state and the rudder demand [rad] of the scheduled law; None without an estimate."""
    if inputs.estimate is None:
        return IDLE, None
    return law.steer(
        settings, state, inputs.estimate, inputs.error_rad, inputs.command_rad, inputs.step_s, inputs.gain_reduction
    )


# By the value of CTL_MODE.
TABLE: Final[Mapping[int, Callable[[ParameterSet], Controller]]] = {
    0: lambda parameters: partial(steer_by_fixed_gains, Gains.of(parameters)),
    1: lambda parameters: partial(steer_by_schedule, LawSettings.of(parameters)),
}


class HeadingControllerSettings(msgspec.Struct, frozen=True):
    """The chosen controller, and the fixed gains that replace it if it cannot steer."""

    controller: Controller
    fallback: Gains

    @classmethod
    def of(cls, parameters: ParameterSet) -> HeadingControllerSettings:
        """Read the settings from the parameters."""
        return cls(controller=TABLE[int(parameters["CTL_MODE"])](parameters), fallback=Gains.of(parameters))


def update(
    settings: HeadingControllerSettings, state: LawState, inputs: HeadingControllerInput
) -> tuple[LawState, float]:
    """Return the state and the rudder demand [rad]; the fixed gains replace a controller that cannot steer."""
    state, demand_rad = settings.controller(state, inputs)
    return steer_by_fixed_gains(settings.fallback, state, inputs) if demand_rad is None else (state, demand_rad)
