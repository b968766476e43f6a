"""Steering authority: whether the boat turns when the rudder moves.

What the model expects her to turn of the rudder is compared, block by block, with what her heading shows, both
without their slow parts (trim, wind, current). The two are summed up since she last answered. She does not
answer once that has gone on for several of her turning lags, and for a turn that the estimate of the heading
could not have missed; a rudder that has only just been put over tells nothing, for a boat may answer late.

A rudder that holds a heading against wind and current moves as well, and the boat does not turn: that it should
not is what the rudder moves for. So only a rudder far from where it was, while the boat is far from where it
should be and the rudder is to bring her there, speaks against it. Where wind and trim come to as much, the rudder's
changes tell it, in a test beside this one (rudder_answer.py).

A boat that turns the other way, again and again, has a servo that is set up the wrong way round (wrong_way.py).
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.common.record_copy import replace
from firmware_py.model.kt import KtModel, decay_over, exact_step
from firmware_py.safety import rudder_answer, wrong_way
from firmware_py.safety.rudder_answer import RudderAnswerState
from firmware_py.safety.turn_order import LATE_S, MEMORY_S, is_enough, ordered_s
from firmware_py.safety.wrong_way import Turn, WrongWay

SLOW_S: Final = 60.0  # what changes slower than this is trim
LOST, REGAINED = 0.125, 0.5  # of the turn that the model expects
OWN_SHARE: Final = 0.5  # of what turns her without a rudder, that is taken for sure
BLOCK_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class SteeringMonitorSettings:
    """The boat's model, and which way round the servo is set up."""

    model: KtModel
    servo_reversed: bool = False

    @classmethod
    def of(cls, parameters: ParameterSet) -> SteeringMonitorSettings:
        """Read the settings from the parameters."""
        return cls(model=KtModel.of(parameters), servo_reversed=bool(parameters["RUD_REVERSE"]))


@dataclass(frozen=True, slots=True)
class SteeringInput:
    """What a tick shows: the measured rudder, the estimated heading and its standard deviation, the speed, the error.

    `heading_rad` is None while nothing is to be learned. `shown_rad` is what the compass shows, None without one.
    `error_rad` is how far the boat is off the heading to steer, None while nobody steers for one.
    """

    rudder_rad: float
    heading_rad: float | None
    heading_sd_rad: float
    speed_m_s: float
    error_rad: float | None
    shown_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of time: when and with what headings it began, and the integral of the rudder [rad s] up to `t_s`."""

    begun_s: float
    heading_rad: float
    t_s: float
    rudder_rad_s: float = 0.0
    shown_rad: float | None = None


@dataclass(frozen=True, slots=True)
class SteeringMonitorState:
    """The yaw rate that the model has, the slow parts of rudder, turn and speed, the sums, and the verdict.

    The slow parts begin amidships and without a turn: at the start the boat may be in the middle of one. They wait
    while the rudder tells, or a long turn would become the trim, and a turn that does not come a loss of way: a filter
    that expects a turn of the rudder believes that sooner than a lost blade. `telling_s`, `expected_rad` and
    `turned_rad`: for how long the rudder has told since she last bore the verdict out, what she should have turned in
    it, and what she has. `order_s`: for how long the rudder has ordered a turn to starboard, negative to port.
    """

    rate_rad_s: float = 0.0
    order_s: float = 0.0
    slow_rudder_rad: float = 0.0
    slow_rate_rad_s: float = 0.0
    slow_speed_m_s: float | None = None
    telling_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0
    unresponsive: bool = False
    block: Block | None = None
    wrong_way: WrongWay = WrongWay()
    answer: RudderAnswerState = RudderAnswerState()


def update(
    settings: SteeringMonitorSettings, state: SteeringMonitorState, given: SteeringInput, now_s: float
) -> SteeringMonitorState:
    """Take a tick in. The turn is that of the heading over a block, and the rudder its mean.

    The estimated yaw rate would not do: it expects a turn of the rudder, and the heading is drawn back to what the
    compass says.
    """
    if settings.servo_reversed is not state.wrong_way.servo_reversed:
        state = replace(state, wrong_way=WrongWay(servo_reversed=settings.servo_reversed))
    if given.heading_rad is None or not math.isfinite(given.rudder_rad):
        return state if state.block is None else replace(state, block=None, answer=RudderAnswerState())
    block = state.block
    if block is None or now_s < block.t_s:
        return replace(state, block=Block(now_s, given.heading_rad, now_s, shown_rad=given.shown_rad))
    rudder_rad_s = block.rudder_rad_s + given.rudder_rad * (now_s - block.t_s)
    step_s = now_s - block.begun_s
    if step_s < BLOCK_S:
        return replace(state, block=Block(block.begun_s, block.heading_rad, now_s, rudder_rad_s, block.shown_rad))
    turned_rad = wrap_pi(given.heading_rad - block.heading_rad)
    state = compare(settings.model, state, given, rudder_rad_s / step_s, turned_rad, step_s)
    return replace(state, block=Block(now_s, given.heading_rad, now_s, shown_rad=given.shown_rad))


def compare(
    model: KtModel,
    state: SteeringMonitorState,
    given: SteeringInput,
    rudder_rad: float,
    turned_rad: float,
    step_s: float,
) -> SteeringMonitorState:
    """Compare what the boat turned in a block with what the model expects of its mean rudder."""
    block, seen = (rudder_rad, turned_rad, step_s), (given.heading_sd_rad, given.speed_m_s, given.error_rad)
    answer = rudder_answer.update(model, state.answer, block, *seen, told=state.unresponsive)
    slow_speed_m_s = given.speed_m_s if state.slow_speed_m_s is None else state.slow_speed_m_s
    model = model.at_speed(clamp(slow_speed_m_s, 0.1 * model.speed_m_s, 10.0 * model.speed_m_s))
    over_rad = rudder_rad - state.slow_rudder_rad
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(state.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    error_rad = given.error_rad
    begun_rad = None if state.block is None else state.block.shown_rad
    shown_rad = 0.0 if begun_rad is None or given.shown_rad is None else wrap_pi(given.shown_rad - begun_rad)
    turn = Turn(rudder_rad, turned_rad, shown_rad, step_s)
    way = wrong_way.update(model, state.wrong_way, turn, state.slow_rudder_rad, error_rad, given.heading_sd_rad)
    order_s = ordered_s(state.order_s, over_rad, error_rad, step_s)
    state = replace(state, wrong_way=way, order_s=order_s, answer=answer)
    if abs(order_s) > LATE_S:
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
    elif order_s == 0.0:
        keep = math.exp(-step_s / MEMORY_S)
        state = replace(
            state,
            telling_s=keep * state.telling_s,
            expected_rad=keep * state.expected_rad,
            turned_rad=keep * state.turned_rad,
        )
    if answer.missing and not state.unresponsive:
        state = replace(state, unresponsive=True, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
    # By hand she may be kept straight with any trim.
    if order_s == 0.0 or error_rad is None:
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
    if answers != state.unresponsive:
        return replace(state, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
    if not is_enough(state.telling_s, state.expected_rad, heading_sd_rad, lag_s):
        return state
    return replace(state, unresponsive=not state.unresponsive, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
