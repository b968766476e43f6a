"""Steering authority: whether the boat turns when the rudder moves.

The yaw rate that the model expects of the rudder, and the one that the heading shows from block to block, both
without their slow parts (trim, wind, current), are compared by regression over the last minutes. No verdict is
changed before the rudder has been moved enough to tell.

A rudder that holds a heading against wind and current moves as well, and the boat does not turn: that it should
not is what the rudder moves for. So only a rudder far from where it was, while the boat is far from where it
should be, speaks against it; wind and trim do not come to so much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel, decay_over, settled_yaw_rate

SLOW_S: Final = 60.0  # what changes slower than this is trim
MEMORY_S: Final = 120.0
EVIDENCE: Final = 20.0 * radians(0.3) ** 2  # [rad^2/s]: twenty seconds of 0.3 deg/s
LOST, REGAINED = 0.25, 0.5  # of the turn that the model expects
FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)
BLOCK_S: Final = 2.0
ENOUGH_BLOCKS: Final = 30


@dataclass(frozen=True, slots=True)
class SteeringMonitorSettings:
    """The boat's model."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> SteeringMonitorSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


@dataclass(frozen=True, slots=True)
class SteeringMonitorState:
    """The expected yaw rate, the slow parts of rudder and turn, the sums of the regression, and the verdict.

    The slow parts begin amidships and without a turn: at the start the boat may be in the middle of one.
    `block`: time and heading at the beginning of the block over which the turn is measured; `turn_square`
    the mean square of such turns, `blocks` how many there were.
    """

    expected_rad_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_rate_rad_s: float = 0.0
    expected_square: float = 0.0
    product: float = 0.0
    unresponsive: bool = False
    block: tuple[float, float] | None = None
    turn_square: float = 0.0
    blocks: int = 0

    @property
    def share(self) -> float | None:
        """By what part of the expected turn the boat answers; None while the rudder has not been moved enough."""
        return self.product / self.expected_square if self.expected_square >= EVIDENCE else None

    @property
    def steering_lost(self) -> bool:
        """Whether the boat does not answer the rudder, once the sea lets that be told: to a sixth of the turn."""
        evidence = self.expected_square >= 36.0 * BLOCK_S * self.turn_square
        return self.unresponsive and evidence and self.blocks >= ENOUGH_BLOCKS


def update(
    settings: SteeringMonitorSettings,
    state: SteeringMonitorState,
    rudder_rad: float,
    heading_rad: float | None,
    speed_m_s: float,
    error_rad: float | None,
    now_s: float,
) -> SteeringMonitorState:
    """Take a tick's measured rudder and estimated heading in; nothing is learned without a heading.

    The turn is that of the heading over a block: the estimated yaw rate expects a turn of the
    rudder, and the heading is drawn back to what the compass says. `error_rad` is how far the
    boat is off the heading to steer, None while nobody steers for one.
    """
    if heading_rad is None or state.block is None:
        return replace(state, block=None if heading_rad is None else (now_s, heading_rad))
    begun_s, before_rad = state.block
    step_s = now_s - begun_s
    if step_s < BLOCK_S:
        return state
    yaw_rate_rad_s = wrap_pi(heading_rad - before_rad) / step_s
    ability_1_s, lag_s, _ = settings.model.scaled(clamp(speed_m_s / settings.model.speed_m_s, 0.1, 10.0))
    state = compare(state, rudder_rad, yaw_rate_rad_s, ability_1_s, lag_s, step_s, error_rad)
    part = max(1.0 / (state.blocks + 1.0), step_s / MEMORY_S)
    square = state.turn_square + part * (yaw_rate_rad_s * yaw_rate_rad_s - state.turn_square)
    return replace(state, block=(now_s, heading_rad), turn_square=square, blocks=min(state.blocks + 1, ENOUGH_BLOCKS))


def compare(
    state: SteeringMonitorState,
    rudder_rad: float,
    yaw_rate_rad_s: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    step_s: float,
    error_rad: float | None = None,
) -> SteeringMonitorState:
    """Compare a measured yaw rate with that which the model at the present speed expects of the rudder."""
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
    off_course = error_rad is None or abs(error_rad) >= FAR_OFF_RAD
    telling = state.unresponsive or (off_course and abs(rudder_rad - slow_rudder_rad) >= FAR_RUDDER_RAD)
    weight_s = step_s if telling else 0.0
    state = replace(
        state,
        expected_rad_s=expected_rad_s,
        slow_rudder_rad=slow_rudder_rad,
        slow_rate_rad_s=slow_rate_rad_s,
        expected_square=keep * state.expected_square + weight_s * expected_rad_s * expected_rad_s,
        product=keep * state.product + weight_s * expected_rad_s * turned_rad_s,
    )
    share = state.share
    if share is None:
        return state
    return replace(state, unresponsive=share < (REGAINED if state.unresponsive else LOST))
