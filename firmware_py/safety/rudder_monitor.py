"""Whether the rudder goes where it is sent, and when to stop pulling at it.

Judged by motion toward the command and not by a model of the servo: a slow one is not at
fault, one that stands still is jammed, one that moves elsewhere is astray. A rudder that is
jammed or draws too much is eased: the command follows the measured angle, so that nothing
pulls, and it is tried again now and then for a moment shorter than a stall that hurts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import radians

AWAY_RAD: Final = radians(3.0)  # nearer than this to the command it is where it shall be
MOVED_RAD: Final = radians(0.5)  # six counts of a coarse encoder
FREE_RAD: Final = radians(1.0)
PATIENCE_S: Final = 1.5
OVERLOAD_S: Final = 2.0
REST_S: Final = 10.0
TRIAL_S: Final = 1.2
WIGGLE_RAD: Final = radians(6.0)


@dataclass(frozen=True, slots=True)
class RudderSight:
    """What is seen of the rudder in a tick; the angle is None when the servo has not told a new one."""

    t_s: float
    sent_rad: float  # what the servo was last told
    measured_rad: float | None
    current_a: float | None
    engaged: bool  # the motor shall pull, and is not known to be without torque


@dataclass(frozen=True, slots=True)
class RudderMonitorState:
    """The angle and time of the last progress toward the command and of the last motion, and what follows.

    `side` is to which side the command lies. `stuck_rad` is where it jammed, `high_s` since
    when the current is too high, `overloaded` whether that has lasted; `eased_s` is when it
    was last eased, None while it is not.
    """

    anchor_rad: float | None = None
    anchor_s: float = 0.0
    still_rad: float | None = None
    still_s: float = 0.0
    side: int = 0
    measured_rad: float | None = None
    astray: bool = False
    stuck_rad: float | None = None
    high_s: float | None = None
    overloaded: bool = False
    eased_s: float | None = None

    @property
    def jammed(self) -> bool:
        """Whether it stood still when it should have moved, and has not moved since."""
        return self.stuck_rad is not None

    def trying(self, now_s: float) -> bool:
        """Whether an eased rudder is being tried at now_s."""
        return self.eased_s is not None and now_s - self.eased_s >= REST_S


def update(state: RudderMonitorState, sight: RudderSight, most_a: float) -> RudderMonitorState:
    """Take a tick in; most_a is the current that may flow, 0 for any."""
    state = _current_judged(state, sight, most_a)
    if sight.measured_rad is not None and math.isfinite(sight.measured_rad):
        state = _motion_judged(state, sight, sight.measured_rad)
    if not (state.jammed or state.overloaded):
        return state if state.eased_s is None else replace(state, eased_s=None)
    if state.eased_s is None:
        return replace(state, eased_s=sight.t_s)
    if sight.t_s - state.eased_s < REST_S + TRIAL_S:
        return state
    # The trial is over: what did not pull too hard in it is sound again.
    if state.high_s is None:
        state = replace(state, overloaded=False)
    return replace(state, eased_s=sight.t_s if state.jammed or state.overloaded else None)


def _current_judged(state: RudderMonitorState, sight: RudderSight, most_a: float) -> RudderMonitorState:
    if sight.current_a is None or not abs(sight.current_a) > most_a > 0.0:
        return state if state.high_s is None else replace(state, high_s=None)
    since_s = sight.t_s if state.high_s is None else state.high_s
    return replace(state, high_s=since_s, overloaded=state.overloaded or sight.t_s - since_s >= OVERLOAD_S)


def _motion_judged(state: RudderMonitorState, sight: RudderSight, measured_rad: float) -> RudderMonitorState:
    stuck_rad = state.stuck_rad
    if stuck_rad is not None and abs(measured_rad - stuck_rad) > FREE_RAD:
        stuck_rad = None
    away_rad = sight.sent_rad - measured_rad
    side = 0 if abs(away_rad) <= AWAY_RAD or not sight.engaged else (1 if away_rad > 0.0 else -1)
    still_rad, still_s = state.still_rad, state.still_s
    if still_rad is None or side != state.side or abs(measured_rad - still_rad) >= MOVED_RAD:
        still_rad, still_s = measured_rad, sight.t_s
    state = replace(state, still_rad=still_rad, still_s=still_s, measured_rad=measured_rad)
    anchor_rad = state.anchor_rad
    moved_rad = 0.0 if anchor_rad is None else measured_rad - anchor_rad
    if anchor_rad is None or side == 0 or side != state.side or side * moved_rad >= MOVED_RAD:
        return replace(state, anchor_rad=measured_rad, anchor_s=sight.t_s, side=side, astray=False, stuck_rad=stuck_rad)
    overdue = sight.t_s - state.anchor_s >= PATIENCE_S
    still = sight.t_s - still_s >= PATIENCE_S
    if overdue and still and stuck_rad is None:
        stuck_rad = measured_rad
    return replace(state, astray=overdue and not still, stuck_rad=stuck_rad)


def release_command(state: RudderMonitorState, command_rad: float, now_s: float) -> float:
    """Return the command that does not pull while the rudder is eased; a trial goes where she wants it, or wiggles."""
    held_rad = state.measured_rad
    if state.eased_s is None or held_rad is None:
        return command_rad
    if not state.trying(now_s):
        return held_rad
    if abs(command_rad - held_rad) > AWAY_RAD:
        return command_rad
    return held_rad - math.copysign(WIGGLE_RAD, held_rad)
