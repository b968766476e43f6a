"""Steering authority: whether the boat turns when the rudder moves.

What the model expects her to turn of the rudder is compared, block by block, with what her heading shows, both
without their slow parts (trim, wind, current). The two are summed up since she last answered. She does not
answer once that has gone on for several of her turning lags, and for a turn that the estimate of the heading
could not have missed; a rudder that has only just been put over tells nothing.

A rudder that holds a heading against wind and current moves as well, and the boat does not turn: that it should
not is what the rudder moves for. So only a rudder far from where it was, while the boat is far from where it
should be and the rudder is to bring her there, speaks against it; wind and trim do not come to so much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.model.kt import KtModel, decay_over, exact_step

SLOW_S: Final = 60.0  # what changes slower than this is trim
MEMORY_S: Final = 120.0  # for what was seen, while nothing can be told
LOST, REGAINED = 0.125, 0.5  # of the turn that the model expects
OWN_SHARE: Final = 0.5  # of what turns her without a rudder, that is taken for sure
FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)
BLOCK_S: Final = 2.0
# What it takes to tell: time, the turn expected in it, and that by the uncertainty of the heading.
LEAST_S: Final = 28.0
LEAST_LAGS: Final = 3.0
LEAST_TURN_RAD: Final = radians(15.0)
LEAST_SPREADS: Final = 8.0


@dataclass(frozen=True, slots=True)
class SteeringMonitorSettings:
    """The boat's model."""

    model: KtModel

    @classmethod
    def of(cls, parameters: ParameterSet) -> SteeringMonitorSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters))


@dataclass(frozen=True, slots=True)
class SteeringInput:
    """What a tick shows: the measured rudder, the estimated heading and its standard deviation, the speed, the error.

    `heading_rad` is None while nothing is to be learned. `error_rad` is how far the boat is off the heading to
    steer, None while nobody steers for one.
    """

    rudder_rad: float
    heading_rad: float | None
    heading_sd_rad: float
    speed_m_s: float
    error_rad: float | None


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of time: when and with what heading it began, and the integral of the rudder [rad s] up to `t_s`."""

    begun_s: float
    heading_rad: float
    t_s: float
    rudder_rad_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SteeringMonitorState:
    """The yaw rate that the model has, the slow parts of rudder, turn and speed, the sums, and the verdict.

    The slow parts begin amidships and without a turn: at the start the boat may be in the middle of one. They wait
    while the rudder tells, or a long turn would become the trim, and a turn that does not come a loss of way: a filter
    that expects a turn of the rudder believes that sooner than a lost blade. `telling_s`, `expected_rad` and
    `turned_rad`: for how long the rudder has told since she last bore the verdict out, what she should have turned in
    it, and what she has.
    """

    rate_rad_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_rate_rad_s: float = 0.0
    slow_speed_m_s: float | None = None
    telling_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0
    unresponsive: bool = False
    block: Block | None = None


def update(
    settings: SteeringMonitorSettings, state: SteeringMonitorState, given: SteeringInput, now_s: float
) -> SteeringMonitorState:
    """Take a tick in. The turn is that of the heading over a block, and the rudder its mean.

    The estimated yaw rate would not do: it expects a turn of the rudder, and the heading is drawn back to what the
    compass says.
    """
    if given.heading_rad is None or not math.isfinite(given.rudder_rad):
        return state if state.block is None else replace(state, block=None)
    block = state.block
    if block is None or now_s < block.t_s:
        return replace(state, block=Block(now_s, given.heading_rad, now_s))
    rudder_rad_s = block.rudder_rad_s + given.rudder_rad * (now_s - block.t_s)
    step_s = now_s - block.begun_s
    if step_s < BLOCK_S:
        return replace(state, block=replace(block, t_s=now_s, rudder_rad_s=rudder_rad_s))
    turned_rad = wrap_pi(given.heading_rad - block.heading_rad)
    state = compare(settings.model, state, given, rudder_rad_s / step_s, turned_rad, step_s)
    return replace(state, block=Block(now_s, given.heading_rad, now_s))


def compare(
    model: KtModel,
    state: SteeringMonitorState,
    given: SteeringInput,
    rudder_rad: float,
    turned_rad: float,
    step_s: float,
) -> SteeringMonitorState:
    """Compare what the boat turned in a block with what the model expects of its mean rudder."""
    slow_speed_m_s = given.speed_m_s if state.slow_speed_m_s is None else state.slow_speed_m_s
    model = model.at_speed(clamp(slow_speed_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s))
    over_rad = rudder_rad - state.slow_rudder_rad
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(state.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    error_rad = given.error_rad
    # A rudder that stops a turn is no order to turn.
    ordered = error_rad is None or (abs(error_rad) >= FAR_OFF_RAD and error_rad * over_rad > 0.0)
    telling = ordered and abs(over_rad) >= FAR_RUDDER_RAD
    if telling:
        sign = math.copysign(1.0, expected_rad)
        # Without her blade she is turned by what the trim held her against, and that is no answer to the rudder.
        by_itself_rad = OWN_SHARE * max(-sign * state.slow_rudder_rad, 0.0) * model.turning_ability_1_s * step_s
        answered_rad = sign * (turned_rad - state.slow_rate_rad_s * step_s) - by_itself_rad
        state = replace(
            state,
            telling_s=state.telling_s + step_s,
            expected_rad=state.expected_rad + abs(expected_rad),
            turned_rad=state.turned_rad + answered_rad,
        )
        state = judge(state, given.heading_sd_rad, model.turning_lag_s)
    else:
        keep = math.exp(-step_s / MEMORY_S)
        state = replace(
            state,
            telling_s=keep * state.telling_s,
            expected_rad=keep * state.expected_rad,
            turned_rad=keep * state.turned_rad,
        )
    # By hand she may be kept straight with any trim.
    if not telling or error_rad is None:
        part = 1.0 - math.exp(-step_s / SLOW_S)
        state = replace(
            state,
            slow_rudder_rad=state.slow_rudder_rad + part * over_rad,
            slow_rate_rad_s=state.slow_rate_rad_s + part * (turned_rad / step_s - state.slow_rate_rad_s),
            slow_speed_m_s=slow_speed_m_s + part * (given.speed_m_s - slow_speed_m_s),
        )
    return replace(state, rate_rad_s=rate_rad_s)


def judge(state: SteeringMonitorState, heading_sd_rad: float, lag_s: float) -> SteeringMonitorState:
    """Change the verdict once there is enough to tell; begin the sums anew where they bear out the one there is."""
    share = REGAINED if state.unresponsive else LOST
    answers = state.turned_rad >= share * state.expected_rad
    enough = state.telling_s >= max(LEAST_S, LEAST_LAGS * lag_s) and state.expected_rad >= max(
        LEAST_TURN_RAD, LEAST_SPREADS * heading_sd_rad
    )
    if answers != state.unresponsive:
        return replace(state, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
    if not enough:
        return state
    return replace(state, unresponsive=not state.unresponsive, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
