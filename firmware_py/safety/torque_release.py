"""Lets the rudder servo rest: torque is released while the command stands and nothing pulls.

It engages again before it moves, and at once when the released rudder is pushed away; then it
is not released again for a while. A servo that cannot be released says so and is left alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import radians

STEADY_RAD: Final = radians(0.05)
THERE_RAD: Final = radians(1.0)
PUSHED_RAD: Final = radians(1.0)
IDLE_A: Final = 0.1
WAKE_S: Final = 1.0  # how long a servo may take to release
AFTER_PUSH_S: Final = 300.0


@dataclass(frozen=True, slots=True)
class TorqueReleaseState:
    """The command that stands and since when; since when the servo rests, and until when it must not."""

    command_rad: float = 0.0
    since_s: float = 0.0
    resting_s: float | None = None
    awake_until_s: float = -math.inf


@dataclass(frozen=True, slots=True)
class ServoSight:
    """What the servo says: its angle, current and torque, as far as they are known."""

    angle_rad: float | None = None
    current_a: float | None = None
    torque_on: bool | None = None


def update(
    state: TorqueReleaseState, command_rad: float, servo: ServoSight, now_s: float, rest_s: float
) -> TorqueReleaseState:
    """Decide whether the servo rests from now on; rest_s is how long the command must have stood, 0 for never."""
    if rest_s <= 0.0 or abs(command_rad - state.command_rad) > STEADY_RAD:
        return TorqueReleaseState(command_rad, now_s, None, state.awake_until_s)
    if servo.angle_rad is None or servo.current_a is None:
        return replace(state, resting_s=None, since_s=now_s)
    if state.resting_s is not None:
        pushed = abs(servo.angle_rad - command_rad) > PUSHED_RAD
        released = servo.torque_on is False or now_s - state.resting_s < WAKE_S
        if pushed or not released:
            return TorqueReleaseState(command_rad, now_s, None, now_s + AFTER_PUSH_S)
        return state
    idle = (
        servo.torque_on is True and abs(servo.current_a) <= IDLE_A and abs(servo.angle_rad - command_rad) <= THERE_RAD
    )
    if not idle:
        return replace(state, since_s=now_s)
    if now_s - state.since_s >= rest_s and now_s >= state.awake_until_s:
        return replace(state, resting_s=now_s)
    return state
