"""Monitor of the rudder: does it follow its command, is it jammed, is the servo current too high.

The test is motion towards the command, not a model of the servo: a slow rudder is no fault, one that stands still is
jammed, one that moves elsewhere deviates. A rudder that is jammed or draws too much current is relieved: the command
follows the measured angle, so that the servo does not pull. At intervals it is tried again, for less time than a stall
that damages the servo.
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
MOVED_RAD: Final = radians(0.5)  # six counts of a coarse encoder
FREE_RAD: Final = radians(1.0)
RESPONSE_S: Final = 1.5
OVERLOAD_S: Final = 2.0
RELIEF_S: Final = 10.0
TRIAL_S: Final = 1.2
WIGGLE_RAD: Final = radians(6.0)


class RudderMonitorSettings(msgspec.Struct, frozen=True):
    """Maximum servo current; 0: no limit."""

    current_limit_a: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> RudderMonitorSettings:
        """Read the settings from the parameters."""
        return cls(current_limit_a=parameters["RUD_AMP_MAX"])


class RudderMonitorState(msgspec.Struct, frozen=True):
    """Angle and time of the last progress towards the command and of the last motion, and the verdicts.

    `side`: side on which the command lies. `jammed_rad`: angle at which the rudder jammed. `high_current_s`: since when
    the current is too high. `overloaded`: for OVERLOAD_S. `relieved_s`: when the rudder was last relieved, None: it is
    not. `release_rad`: the command that does not load the servo.
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
    def jammed(self) -> bool:
        """Whether the rudder stood still when it should have moved, and has not moved since."""
        return self.jammed_rad is not None

    def trial(self, now_s: float) -> bool:
        """Return whether a relieved rudder is being tried at now_s."""
        return self.relieved_s is not None and now_s - self.relieved_s >= RELIEF_S


def update(
    settings: RudderMonitorSettings, state: RudderMonitorState, rudder: RudderStatus, *, engaged: bool
) -> RudderMonitorState:
    """Return the state after a tick; `engaged`: the servo torque is on, as far as it is known."""
    state = _judge_current(state, rudder, settings.current_limit_a)
    if rudder.is_new and rudder.measured:
        state = _judge_motion(state, rudder, engaged=engaged)
    if not (state.jammed or state.overloaded):
        return state if state.relieved_s is None else replace(state, relieved_s=None)
    if state.relieved_s is None:
        return replace(state, relieved_s=rudder.t_s)
    if rudder.t_s - state.relieved_s < RELIEF_S + TRIAL_S:
        return state
    # The trial is over: without too high a current in it, the overload has ended.
    if state.high_current_s is None:
        state = replace(state, overloaded=False)
    return replace(state, relieved_s=rudder.t_s if state.jammed or state.overloaded else None)


def _judge_current(state: RudderMonitorState, rudder: RudderStatus, limit_a: float) -> RudderMonitorState:
    if not rudder.is_new or rudder.current_a is None or not abs(rudder.current_a) > limit_a > 0.0:
        return state if state.high_current_s is None else replace(state, high_current_s=None)
    since_s = rudder.t_s if state.high_current_s is None else state.high_current_s
    overloaded = state.overloaded or rudder.t_s - since_s >= OVERLOAD_S
    return replace(state, high_current_s=since_s, overloaded=overloaded)


def _judge_motion(state: RudderMonitorState, rudder: RudderStatus, *, engaged: bool) -> RudderMonitorState:
    t_s, angle_rad, jammed_rad = rudder.t_s, rudder.angle_rad, state.jammed_rad
    if jammed_rad is not None and abs(angle_rad - jammed_rad) > FREE_RAD:
        jammed_rad = None
    away_rad = rudder.command_rad - angle_rad
    side = 0 if abs(away_rad) <= AT_COMMAND_RAD or not engaged else (1 if away_rad > 0.0 else -1)
    motion_rad, motion_s = state.motion_rad, state.motion_s
    if motion_rad is None or side != state.side or abs(angle_rad - motion_rad) >= MOVED_RAD:
        motion_rad, motion_s = angle_rad, t_s
    progress_rad, progress_s, deviating = state.progress_rad, state.progress_s, False
    moved_rad = 0.0 if progress_rad is None else angle_rad - progress_rad
    if progress_rad is None or side == 0 or side != state.side or side * moved_rad >= MOVED_RAD:
        progress_rad, progress_s = angle_rad, t_s
    else:
        overdue = t_s - progress_s >= RESPONSE_S
        still = t_s - motion_s >= RESPONSE_S
        if overdue and still and jammed_rad is None:
            jammed_rad = angle_rad
        deviating = overdue and not still
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
        _release_rad(state, rudder),
    )


def _release_rad(state: RudderMonitorState, rudder: RudderStatus) -> float:
    """Return the measured angle or, while the rudder moves, half way from it to the command.

    The measured angle is older than the true one: a rudder commanded to it would oscillate.
    """
    angle_rad, before_rad, kept_rad = rudder.angle_rad, state.measured_rad, state.release_rad
    if before_rad is None or abs(angle_rad - before_rad) >= MOVED_RAD:
        return 0.5 * (rudder.command_rad + angle_rad)
    return angle_rad if kept_rad is None or abs(angle_rad - kept_rad) >= MOVED_RAD else kept_rad


def release_command(state: RudderMonitorState, command_rad: float, now_s: float) -> float:
    """Return the command that relieves the servo; in a trial, the true command or, if the rudder is there, a wiggle."""
    measured_rad, release_rad = state.measured_rad, state.release_rad
    if state.relieved_s is None or measured_rad is None:
        return command_rad
    if not state.trial(now_s):
        return measured_rad if release_rad is None else release_rad
    if abs(command_rad - measured_rad) > AT_COMMAND_RAD:
        return command_rad
    return measured_rad - math.copysign(WIGGLE_RAD, measured_rad)
