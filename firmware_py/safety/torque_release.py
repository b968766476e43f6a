"""Release of the servo torque while the command is constant and the load is small.

The torque is on again before the rudder moves, and at once when the released rudder is pushed away; then it is not
released again for AFTER_PUSH_S. The same holds for a servo that does not release its torque.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import RudderStatus

STEADY_RAD: Final = radians(0.05)
AT_COMMAND_RAD: Final = radians(1.0)
PUSHED_RAD: Final = radians(1.0)
IDLE_A: Final = 0.1
RELEASE_TIME_S: Final = 1.0  # maximum time that a servo takes to release
AFTER_PUSH_S: Final = 300.0


class TorqueReleaseSettings(msgspec.Struct, frozen=True):
    """Time of a constant command after which the torque is released; 0: never."""

    release_after_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> TorqueReleaseSettings:
        """Read the settings from the parameters."""
        return cls(release_after_s=parameters["RUD_REST_S"])


class TorqueReleaseState(msgspec.Struct, frozen=True):
    """The constant command and its begin; since when the torque is released, and until when it must not be."""

    command_rad: float = 0.0
    steady_since_s: float = 0.0
    released_since_s: float | None = None
    enabled_until_s: float = -math.inf

    @property
    def released(self) -> bool:
        """Whether the torque is released."""
        return self.released_since_s is not None


def update(
    settings: TorqueReleaseSettings, state: TorqueReleaseState, command_rad: float, rudder: RudderStatus, now_s: float
) -> TorqueReleaseState:
    """Return the state after a tick, with the decision whether the torque is released."""
    if settings.release_after_s <= 0.0 and not state.released:
        return state
    if settings.release_after_s <= 0.0 or abs(command_rad - state.command_rad) > STEADY_RAD:
        return TorqueReleaseState(command_rad, now_s, None, state.enabled_until_s)
    if not rudder.measured or rudder.current_a is None:
        return replace(state, released_since_s=None, steady_since_s=now_s)
    if state.released_since_s is not None:
        pushed = abs(rudder.angle_rad - command_rad) > PUSHED_RAD
        released = rudder.torque_on is False or now_s - state.released_since_s < RELEASE_TIME_S
        if pushed or not released:
            return TorqueReleaseState(command_rad, now_s, None, now_s + AFTER_PUSH_S)
        return state
    idle = (
        rudder.torque_on is True
        and abs(rudder.current_a) <= IDLE_A
        and abs(rudder.angle_rad - command_rad) <= AT_COMMAND_RAD
    )
    if not idle:
        return replace(state, steady_since_s=now_s)
    if now_s - state.steady_since_s >= settings.release_after_s and now_s >= state.enabled_until_s:
        return replace(state, released_since_s=now_s)
    return state
