"""Rudder monitor: detects a rudder that deviates from its command or is jammed, and a servo current that is too high.

The test is the motion towards the command, without a model of the servo. A slow rudder is no fault, a rudder that does
not move is jammed, a rudder that moves in another direction deviates. A rudder that is jammed or has too high a current
is relieved: its command follows the measured angle, so that the servo has no torque. At intervals the true command is
tried again, for a shorter time than the stall that damages a servo.

A rudder whose angle is not measured cannot be judged by its motion: it neither deviates nor is it jammed. The yaw
response of the boat is then the only test (steering_loss.py, steering_reversal.py).
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import RudderStatus

AT_COMMAND_RAD: Final = radians(3.0)  # tolerance of the angle at the command
MIN_MOTION_RAD: Final = radians(0.5)  # six counts of a coarse encoder
MIN_FREE_MOTION_RAD: Final = radians(1.0)  # motion after which a jammed rudder is free
RESPONSE_S: Final = 1.5  # maximum time without motion, or without progress towards the command
OVERLOAD_S: Final = 2.0  # time of a high current before the servo is overloaded
RELIEF_S: Final = 10.0  # time before a trial
TRIAL_S: Final = 1.2  # duration of a trial
TRIAL_MOTION_RAD: Final = radians(6.0)  # movement in a trial of a rudder that is at its command


class RudderMonitorSettings(msgspec.Struct, frozen=True):
    """Maximum servo current; 0: no limit."""

    current_limit_a: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> RudderMonitorSettings:
        """Read the settings from the parameters."""
        return cls(current_limit_a=parameters["RUD_AMP_MAX"])


class RudderMonitorState(msgspec.Struct, frozen=True):
    """Angle and time of the last progress towards the command and of the last motion, and the results.

    `side`: direction to the command (1, -1; 0: at the command). `jammed_rad`: angle at which the rudder jammed, None:
    it is not jammed. `high_current_s`: time since which the current is too high. `overloaded`: it has been too high for
    OVERLOAD_S. `relieved_s`: time when the rudder was last relieved, None: it is not relieved. `measured_rad`: last
    measured angle. `release_rad`: command without torque of the servo.
    """

    progress_rad: float | None = None
    progress_s: float = 0.0
    motion_rad: float | None = None
    motion_s: float = 0.0
    side: int = 0
    measured_rad: float | None = None
    deviating: bool = False
    jammed_rad: float | None = None
    high_current_s: float | None = None
    overloaded: bool = False
    relieved_s: float | None = None
    release_rad: float | None = None

    @property
    def is_jammed(self) -> bool:
        """Whether the rudder did not move to its command, and has not moved since."""
        return self.jammed_rad is not None

    def is_in_trial(self, now_s: float) -> bool:
        """Return whether a relieved rudder is tried at now_s."""
        return self.relieved_s is not None and now_s - self.relieved_s >= RELIEF_S


def update(
    settings: RudderMonitorSettings, state: RudderMonitorState, rudder: RudderStatus, *, is_engaged: bool
) -> RudderMonitorState:
    """Return the state after a tick; `is_engaged`: the servo torque is on, or not known to be off."""
    state = _judge_current(state, rudder, settings.current_limit_a)
    if rudder.is_new and rudder.measured:
        state = state if rudder.is_repeated else _judge_motion(state, rudder, is_engaged=is_engaged)
    elif rudder.is_new and is_engaged and state.measured_rad is not None:
        state = _without_angle(state)
    if not (state.is_jammed or state.overloaded):
        return state if state.relieved_s is None else replace(state, relieved_s=None)
    if state.relieved_s is None:
        return replace(state, relieved_s=rudder.t_s)
    if rudder.t_s - state.relieved_s < RELIEF_S + TRIAL_S:
        return state
    # The trial has ended: if the current was not too high in it, the overload has ended.
    if state.high_current_s is None:
        state = replace(state, overloaded=False)
    return replace(state, relieved_s=rudder.t_s if state.is_jammed or state.overloaded else None)


def _without_angle(state: RudderMonitorState) -> RudderMonitorState:
    """Return the state without the results of the motion: the angle is no longer measured."""
    return RudderMonitorState(
        high_current_s=state.high_current_s, overloaded=state.overloaded, relieved_s=state.relieved_s
    )


def _judge_current(state: RudderMonitorState, rudder: RudderStatus, limit_a: float) -> RudderMonitorState:
    """Return the state after a check of the servo current."""
    if not rudder.is_new or rudder.current_a is None or not abs(rudder.current_a) > limit_a > 0.0:
        return state if state.high_current_s is None else replace(state, high_current_s=None)
    since_s = rudder.t_s if state.high_current_s is None else state.high_current_s
    overloaded = state.overloaded or rudder.t_s - since_s >= OVERLOAD_S
    return replace(state, high_current_s=since_s, overloaded=overloaded)


def _judge_motion(state: RudderMonitorState, rudder: RudderStatus, *, is_engaged: bool) -> RudderMonitorState:
    """Return the state after a check of the motion, with a new measured angle."""
    t_s, angle_rad, jammed_rad = rudder.t_s, rudder.angle_rad, state.jammed_rad
    if jammed_rad is not None and abs(angle_rad - jammed_rad) > MIN_FREE_MOTION_RAD:
        jammed_rad = None
    deviation_rad = rudder.command_rad - angle_rad
    side = 0 if abs(deviation_rad) <= AT_COMMAND_RAD or not is_engaged else (1 if deviation_rad > 0.0 else -1)
    motion_rad, motion_s = state.motion_rad, state.motion_s
    if motion_rad is None or side != state.side or abs(angle_rad - motion_rad) >= MIN_MOTION_RAD:
        motion_rad, motion_s = angle_rad, t_s
    progress_rad, progress_s, deviating = state.progress_rad, state.progress_s, False
    if progress_rad is None or side == 0 or side != state.side or side * (angle_rad - progress_rad) >= MIN_MOTION_RAD:
        progress_rad, progress_s = angle_rad, t_s
    else:
        is_overdue = t_s - progress_s >= RESPONSE_S
        is_still = t_s - motion_s >= RESPONSE_S
        if is_overdue and is_still and jammed_rad is None:
            jammed_rad = angle_rad
        deviating = is_overdue and not is_still
    return RudderMonitorState(
        progress_rad,
        progress_s,
        motion_rad,
        motion_s,
        side,
        angle_rad,
        deviating,
        jammed_rad,
        state.high_current_s,
        state.overloaded,
        state.relieved_s,
        _next_release_rad(state, rudder),
    )


def _next_release_rad(state: RudderMonitorState, rudder: RudderStatus) -> float:
    """Return the measured angle or, while the rudder moves, the mean of it and the command.

    The measured angle is late: with it as the command, a moving rudder would oscillate.
    """
    angle_rad, previous_rad, previous_release_rad = rudder.angle_rad, state.measured_rad, state.release_rad
    if previous_rad is None or abs(angle_rad - previous_rad) >= MIN_MOTION_RAD:
        return 0.5 * (rudder.command_rad + angle_rad)
    return (
        angle_rad
        if previous_release_rad is None or abs(angle_rad - previous_release_rad) >= MIN_MOTION_RAD
        else previous_release_rad
    )


def release_command(state: RudderMonitorState, command_rad: float, now_s: float) -> float:
    """Return the command without torque of the servo; in a trial, the true command or a small movement."""
    measured_rad, release_rad = state.measured_rad, state.release_rad
    if state.relieved_s is None or measured_rad is None:
        return command_rad
    if not state.is_in_trial(now_s):
        return measured_rad if release_rad is None else release_rad
    if abs(command_rad - measured_rad) > AT_COMMAND_RAD:
        return command_rad
    return measured_rad - math.copysign(TRIAL_MOTION_RAD, measured_rad)
