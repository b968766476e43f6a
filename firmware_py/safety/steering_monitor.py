"""Steering authority: whether she turns when the rudder moves.

The yaw rate that the model expects of the rudder, and the one that is estimated from compass and
receiver, both without their slow parts (trim, wind, current), are compared by regression over the
last minutes. No verdict is changed before the rudder has been moved enough to tell.

A rudder that holds a heading against wind and current moves as well, and she does not turn: that
she should not is what it moves for. So only a rudder far from where it was, while she is far from
where she should be, speaks against her; wind and trim do not come to so much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import decay_over, settled_yaw_rate

SLOW_S: Final = 60.0  # what changes slower than this is trim
MEMORY_S: Final = 120.0
EVIDENCE: Final = 20.0 * radians(0.3) ** 2  # [rad^2/s]: twenty seconds of 0.3 deg/s
LOST, REGAINED = 0.25, 0.5  # of the turn that the model expects
FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)


@dataclass(frozen=True, slots=True)
class SteeringMonitorState:
    """The expected yaw rate, the slow parts of rudder and turn, the sums of the regression, and the verdict.

    The slow parts begin amidships and without a turn: at the start she may be in the middle of one.
    """

    expected_rad_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_rate_rad_s: float = 0.0
    expected_square: float = 0.0
    product: float = 0.0
    lost: bool = False

    @property
    def share(self) -> float | None:
        """By what part of the expected turn she answers; None while the rudder has not been moved enough."""
        return self.product / self.expected_square if self.expected_square >= EVIDENCE else None


def update(
    state: SteeringMonitorState,
    rudder_rad: float,
    yaw_rate_rad_s: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    step_s: float,
    error_rad: float | None = None,
) -> SteeringMonitorState:
    """Take a tick's measured rudder and estimated yaw rate in; the model is that at the present speed.

    `error_rad` is how far she is off her heading, None while nobody steers for one.
    """
    if not (math.isfinite(rudder_rad) and math.isfinite(yaw_rate_rad_s)) or step_s <= 0.0:
        return state
    part = 1.0 - math.exp(-step_s / SLOW_S)
    slow_rudder_rad = state.slow_rudder_rad + part * (rudder_rad - state.slow_rudder_rad)
    slow_rate_rad_s = state.slow_rate_rad_s + part * (yaw_rate_rad_s - state.slow_rate_rad_s)
    steady_rad_s = turning_ability_1_s * (rudder_rad - slow_rudder_rad)
    decay = decay_over(step_s, turning_lag_s)
    expected_rad_s = settled_yaw_rate(state.expected_rad_s, steady_rad_s, decay)
    keep = math.exp(-step_s / MEMORY_S)
    turned_rad_s = clamp(yaw_rate_rad_s - slow_rate_rad_s, -radians(20.0), radians(20.0))
    off = error_rad is None or abs(error_rad) >= FAR_OFF_RAD
    telling = state.lost or (off and abs(rudder_rad - slow_rudder_rad) >= FAR_RUDDER_RAD)
    weight_s = step_s if telling else 0.0
    after = SteeringMonitorState(
        expected_rad_s,
        slow_rudder_rad,
        slow_rate_rad_s,
        keep * state.expected_square + weight_s * expected_rad_s * expected_rad_s,
        keep * state.product + weight_s * expected_rad_s * turned_rad_s,
        state.lost,
    )
    share = after.share
    if share is None:
        return after
    return replace(after, lost=share < (REGAINED if state.lost else LOST))
