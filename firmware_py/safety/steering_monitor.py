"""Steering monitor: tests whether the boat responds to its rudder and turns in the commanded direction.

It averages the rudder over blocks for two tests: loss of steering (steering_loss.py) and reversed steering, for example
by a wrong RUD_REVERSE (steering_reversal.py).

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, wrap_pi
from firmware_py.model.kt import KtModel, scaled
from firmware_py.safety import steering_loss, steering_reversal
from firmware_py.safety.steering_loss import SteeringLossState
from firmware_py.safety.steering_reversal import ReversalState, Turn, commanded_turn_s

TRIM_TIME_CONSTANT_S: Final = 60.0  # of the low-pass filter that gives the trim
BLOCK_S: Final = 2.0


class SteeringInput(NamedTuple):
    """Measured rudder of a tick, estimated heading and its standard deviation, speed, heading error.

    `heading_rad` is NaN while the tests cannot be made. `compass_rad` is the heading of the compass (NaN: none),
    `error_rad` the goal minus the heading (NaN: the boat does not steer to a heading). `diffusion_rad2_s`, that of the
    heading, and `trim_rad`, the mean rudder bias, are learned values (0: not yet learned).
    """

    rudder_rad: float
    heading_rad: float
    heading_sd_rad: float
    speed_m_s: float
    error_rad: float
    compass_rad: float = math.nan
    diffusion_rad2_s: float = 0.0
    trim_rad: float = 0.0


class Block(NamedTuple):
    """Block in progress: start time (NaN: no block), headings at the start, integral of the rudder up to `t_s`."""

    begun_s: float = math.nan
    heading_rad: float = 0.0
    t_s: float = 0.0
    rudder_rad_s: float = 0.0
    compass_rad: float = math.nan


class SteeringMonitorState(NamedTuple):
    """Block in progress, low-pass filtered rudder and speed (NaN: no value yet), and states of both tests.

    The slow rudder starts at 0, because the boat may be in a turn. The slow values are constant while the rudder
    commands a turn; otherwise a long turn would look like trim, and a missing turn like a loss of speed. `order_s`:
    time for which the rudder has commanded a turn, positive to starboard.
    """

    order_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_speed_m_s: float = math.nan
    block: Block = Block()
    reversal: ReversalState = ReversalState()
    loss: SteeringLossState = SteeringLossState()


NO_BLOCK: Final = Block()
START: Final = SteeringMonitorState()


def update(
    model: KtModel,
    servo_reversed: bool,  # noqa: FBT001 - compiled
    state: SteeringMonitorState,
    inputs: SteeringInput,
    now_s: float,
) -> SteeringMonitorState:
    """Return the state after a tick. At the end of a block, the tests use its turn and its mean rudder.

    `servo_reversed` is RUD_REVERSE; a change restarts the test for reversed steering.
    The estimated yaw rate is not used, because it is predicted from the rudder; the heading is measured.
    """
    block, reversal, loss = state.block, state.reversal, state.loss
    order_s, slow_rudder_rad, slow_speed_m_s = state.order_s, state.slow_rudder_rad, state.slow_speed_m_s
    if servo_reversed != reversal.servo_reversed:
        reversal = steering_reversal.begin(servo_reversed)
    step_s = now_s - block.begun_s
    rudder_rad_s = block.rudder_rad_s + inputs.rudder_rad * (now_s - block.t_s)
    if not math.isfinite(inputs.heading_rad) or not math.isfinite(inputs.rudder_rad):
        if not math.isnan(block.begun_s):
            loss = steering_loss.restart_after_gap(loss)
        block = NO_BLOCK
    elif step_s < BLOCK_S and now_s >= block.t_s:
        block = Block(block.begun_s, block.heading_rad, now_s, rudder_rad_s, block.compass_rad)
    else:
        if step_s >= BLOCK_S and now_s >= block.t_s:
            turn = turn_of(block, inputs, rudder_rad_s, step_s)
            speed_m_s = inputs.speed_m_s if math.isnan(slow_speed_m_s) else slow_speed_m_s
            loss = steering_loss.update(
                model, loss, turn.rudder_rad, turn.turned_rad, step_s, inputs.heading_sd_rad, inputs.speed_m_s,
                inputs.error_rad, inputs.diffusion_rad2_s,
            )  # fmt: skip
            reversal = steering_reversal.update(
                at_speed(model, speed_m_s), reversal, turn, slow_rudder_rad, inputs.error_rad, inputs.heading_sd_rad,
                inputs.diffusion_rad2_s, inputs.trim_rad,
            )  # fmt: skip
            deviation_rad = turn.rudder_rad - slow_rudder_rad
            order_s = commanded_turn_s(order_s, deviation_rad, inputs.error_rad, step_s)
            # Steered by hand, any rudder angle may be trim.
            if order_s == 0.0 or math.isnan(inputs.error_rad):
                gain = 1.0 - math.exp(-step_s / TRIM_TIME_CONSTANT_S)
                slow_rudder_rad += gain * deviation_rad
                slow_speed_m_s = speed_m_s + gain * (inputs.speed_m_s - speed_m_s)
        block = Block(now_s, inputs.heading_rad, now_s, 0.0, inputs.compass_rad)
    return SteeringMonitorState(order_s, slow_rudder_rad, slow_speed_m_s, block, reversal, loss)


def turn_of(block: Block, inputs: SteeringInput, rudder_rad_s: float, step_s: float) -> Turn:
    """Return the turn of a block at its end; without a compass heading, compass_turn_rad is 0."""
    turned_rad = wrap_pi(inputs.heading_rad - block.heading_rad)
    compass_turn_rad = wrap_pi(inputs.compass_rad - block.compass_rad)
    return Turn(rudder_rad_s / step_s, turned_rad, 0.0 if math.isnan(compass_turn_rad) else compass_turn_rad, step_s)


def at_speed(model: KtModel, speed_m_s: float) -> KtModel:
    """Return the model at a speed, which is limited to 0.1 to 10 times that of the model."""
    speed_m_s = clamp(speed_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s)
    ability_1_s, lag_s, norrbin_s2 = scaled(model, speed_m_s / model.speed_m_s)
    return KtModel(ability_1_s, lag_s, norrbin_s2, model.rudder_offset_rad, speed_m_s)
