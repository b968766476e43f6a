"""Release of the servo torque while the command is constant and the load is small.

The torque is on again before the rudder moves. It is on again at once if a force moves the released rudder, or if the
servo does not release its torque; then it is not released for RELEASE_BLOCK_S.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import RudderStatus

STEADY_RAD: Final = radians(0.05)  # largest change of a constant command
AT_COMMAND_RAD: Final = radians(1.0)
PUSHED_RAD: Final = radians(1.0)  # deviation of a rudder that a force has moved
IDLE_A: Final = 0.1  # largest current of a small load
RELEASE_TIME_S: Final = 1.0  # maximum time until a servo has released its torque
RELEASE_BLOCK_S: Final = 300.0


class TorqueReleaseSettings(msgspec.Struct, frozen=True):
    """Time of a constant command after which the torque is released; 0: never."""

    release_after_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> TorqueReleaseSettings:
        """Read the settings from the parameters."""
        return cls(release_after_s=parameters["RUD_REST_S"])


class TorqueReleaseState(msgspec.Struct, frozen=True):
    """Constant command and its start; times since which the torque is released, and until which it stays enabled."""

    command_rad: float = 0.0
    steady_since_s: float = 0.0
    released_since_s: float | None = None
    enabled_until_s: float = -math.inf

    @property
    def is_released(self) -> bool:
        """Whether the torque is released."""
        return self.released_since_s is not None


def update(
    settings: TorqueReleaseSettings, state: TorqueReleaseState, command_rad: float, rudder: RudderStatus, now_s: float
) -> TorqueReleaseState:
    """Return the state after a tick; `is_released` is the decision."""
    if settings.release_after_s <= 0.0 and not state.is_released:
        return state
    if settings.release_after_s <= 0.0 or abs(command_rad - state.command_rad) > STEADY_RAD:
        return TorqueReleaseState(command_rad, now_s, None, state.enabled_until_s)
    if not rudder.measured or rudder.current_a is None:
        return replace(state, released_since_s=None, steady_since_s=now_s)
    if state.released_since_s is not None:
        is_pushed = abs(rudder.angle_rad - command_rad) > PUSHED_RAD
        is_released = rudder.torque_on is False or now_s - state.released_since_s < RELEASE_TIME_S
        if is_pushed or not is_released:
            return TorqueReleaseState(command_rad, now_s, None, now_s + RELEASE_BLOCK_S)
        return state
    is_idle = (
        rudder.torque_on is True
        and abs(rudder.current_a) <= IDLE_A
        and abs(rudder.angle_rad - command_rad) <= AT_COMMAND_RAD
    )
    if not is_idle:
        return replace(state, steady_since_s=now_s)
    if now_s - state.steady_since_s >= settings.release_after_s and now_s >= state.enabled_until_s:
        return replace(state, released_since_s=now_s)
    return state
