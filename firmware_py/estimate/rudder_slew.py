"""Estimated angle of a rudder that is not measured: a servo with dead time and limited rate.

The model turns at a constant rate towards the command that was sent one dead time ago, and stops there. It is the
slew model of marine steering gear (Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd edition,
section 9.5, without its first-order lag) with a dead time for the electronics. It has no load, no friction and no
mechanical stop, so an error of the real rudder does not show in it.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet

MAX_PENDING: Final = 64  # commands within the dead time: 1 s at 50 Hz


class SlewSettings(msgspec.Struct, frozen=True):
    """Rate of the servo under load, and dead time from the command to the begin of the motion."""

    rate_rad_s: float
    delay_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> SlewSettings:
        """Read the settings from the parameters."""
        return cls(rate_rad_s=radians(parameters["RUD_EST_DEG_S"]), delay_s=parameters["RUD_EST_LAG_S"])


class DelayedCommand(msgspec.Struct, frozen=True):
    """A command, and the time at which it was sent."""

    sent_s: float
    command_rad: float


class SlewState(msgspec.Struct, frozen=True):
    """Angle of the model at `t_s`, the command that it follows, and the commands within the dead time."""

    t_s: float
    angle_rad: float
    target_rad: float
    pending: tuple[DelayedCommand, ...] = ()


def begin(angle_rad: float, command_rad: float, now_s: float) -> SlewState:
    """Return the model at an angle; it follows the command without delay."""
    return SlewState(now_s, angle_rad, command_rad)


def update(settings: SlewSettings, state: SlewState, command_rad: float, now_s: float, *, is_driven: bool) -> SlewState:
    """Return the state at now_s; `command_rad` is the command that was sent at `state.t_s`.

    A rudder that is not driven keeps its angle, because no force on it is known.
    """
    if not is_driven:
        return SlewState(now_s, state.angle_rad, command_rad)
    newest_rad = state.pending[-1].command_rad if state.pending else state.target_rad
    pending = state.pending
    if command_rad != newest_rad:
        pending = (*pending, DelayedCommand(state.t_s, command_rad))
    t_s, angle_rad, target_rad = state.t_s, state.angle_rad, state.target_rad
    while pending and (pending[0].sent_s + settings.delay_s <= now_s or len(pending) > MAX_PENDING):
        start_s = min(max(pending[0].sent_s + settings.delay_s, t_s), now_s)
        angle_rad = _turn_towards(angle_rad, target_rad, settings.rate_rad_s * (start_s - t_s))
        t_s, target_rad, pending = start_s, pending[0].command_rad, pending[1:]
    angle_rad = _turn_towards(angle_rad, target_rad, settings.rate_rad_s * max(now_s - t_s, 0.0))
    return SlewState(now_s, angle_rad, target_rad, pending)


def _turn_towards(angle_rad: float, target_rad: float, max_turn_rad: float) -> float:
    """Return the angle after a turn of at most max_turn_rad towards the target."""
    difference_rad = target_rad - angle_rad
    return (
        target_rad if abs(difference_rad) <= max_turn_rad else angle_rad + math.copysign(max_turn_rad, difference_rad)
    )
