"""Steering authority: whether the boat turns when the rudder moves.

What the model expects her to turn of the rudder is compared, block by block, with what her heading shows, both
without their slow parts (trim, wind, current). The two are summed up since she last answered. She does not
answer once that has gone on for several of her turning lags, and for a turn that the estimate of the heading
could not have missed; a rudder that has only just been put over tells nothing, for a boat may answer late.

A rudder that holds a heading against wind and current moves as well, and the boat does not turn: that it should
not is what the rudder moves for. So only a rudder far from where it was, while the boat is far from where it
should be and the rudder is to bring her there, speaks against it. Where wind and trim come to as much, the rudder's
changes tell it, in a test beside this one (rudder_answer.py).

A boat that turns the other way, again and again, has a servo that is set up the wrong way round.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass
from firmware_py.common.record_copy import replace
from firmware_py.model.kt import KtModel, decay_over, exact_step
from firmware_py.safety import rudder_answer
from firmware_py.safety.rudder_answer import RudderAnswerState

SLOW_S: Final = 60.0  # what changes slower than this is trim
MEMORY_S: Final = 120.0  # for what was seen, while nothing can be told
LOST, REGAINED = 0.125, 0.5  # of the turn that the model expects
REVERSED: Final = -0.5  # of it, and the more the worse, is a turn the wrong way
SURE_RAD: Final = radians(60.0)  # so much of it is one, however slow she is taken for, and uncertain the heading
# The estimate may take a turn that it does not expect for waves; the compass does not, once it is larger than theirs.
SHOWN_REVERSED, SHOWN_TURN_RAD = -0.6, radians(150.0)
OWN_SHARE: Final = 0.5  # of what turns her without a rudder, that is taken for sure
FAR_RUDDER_RAD: Final = radians(12.0)
FAR_OFF_RAD: Final = radians(15.0)
BLOCK_S: Final = 2.0
# What it takes to tell: a rudder that has been over to one side for so long, then time, the turn expected in it, and
# that by the uncertainty of the heading.
LATE_S: Final = 16.0
LEAST_S: Final = 20.0
LEAST_LAGS: Final = 3.0
LEAST_TURN_RAD: Final = radians(15.0)
LEAST_SPREADS: Final = 8.0


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
class Evidence:
    """For how long the rudder has told of one and the same, what she should have turned in it, and what she has."""

    telling_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class WrongWay:
    """Whether she turns the wrong way with RUD_REVERSE as `servo_reversed` says, and what speaks for a change of that.

    `rate_rad_s` is the yaw rate that the model has with no more trim than there can be; `order_s` as in the whole.
    """

    rate_rad_s: float = 0.0
    order_s: float = 0.0
    by_estimate: Evidence = Evidence()
    by_compass: Evidence = Evidence()
    reversed: bool = False
    servo_reversed: bool = False


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
    wrong_way = judge_way(model, state, given, rudder_rad, turned_rad, step_s)
    order_s = ordered_s(state.order_s, over_rad, error_rad, step_s)
    state = replace(state, wrong_way=wrong_way, order_s=order_s, answer=answer)
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


def ordered_s(before_s: float, over_rad: float, error_rad: float | None, step_s: float) -> float:
    """Return for how long the rudder has ordered a turn to one side, negative to port; 0 where it orders none."""
    if not is_order(over_rad, error_rad):
        return 0.0
    return math.copysign(step_s, over_rad) + (before_s if before_s * over_rad > 0.0 else 0.0)


def is_order(over_rad: float, error_rad: float | None) -> bool:
    """Whether a rudder so far over is an order to turn; one that stops a turn is none."""
    ordered = error_rad is None or (abs(error_rad) >= FAR_OFF_RAD and error_rad * over_rad > 0.0)
    return ordered and abs(over_rad) >= FAR_RUDDER_RAD


def judge_way(
    model: KtModel,
    state: SteeringMonitorState,
    given: SteeringInput,
    rudder_rad: float,
    turned_rad: float,
    step_s: float,
) -> WrongWay:
    """Judge whether the boat turns the other way than its rudder is to turn it.

    What a rudder that is set up the wrong way round makes her do is slow at first, and looks like trim; so no more of
    it is taken for trim than there can be, and none of the turn.
    """
    way = state.wrong_way
    over_rad = rudder_rad - clamp(state.slow_rudder_rad, -FAR_RUDDER_RAD, FAR_RUDDER_RAD)
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(way.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    order_s = ordered_s(way.order_s, over_rad, given.error_rad, step_s)
    way = replace(way, rate_rad_s=rate_rad_s, order_s=order_s)
    if abs(order_s) <= LATE_S:
        if order_s != 0.0:
            return way
        keep = math.exp(-step_s / MEMORY_S)
        return replace(way, by_estimate=_faded(way.by_estimate, keep), by_compass=_faded(way.by_compass, keep))
    begun_rad = None if state.block is None else state.block.shown_rad
    shown_rad = 0.0 if begun_rad is None or given.shown_rad is None else wrap_pi(given.shown_rad - begun_rad)
    # What speaks against what has been found: that she turns the wrong way, or the right one again.
    sign = math.copysign(1.0, -expected_rad if way.reversed else expected_rad)
    block = Evidence(step_s, abs(expected_rad), sign * turned_rad)
    by_estimate = _taken(way.by_estimate, block, REVERSED)
    by_compass = _taken(way.by_compass, replace(block, turned_rad=sign * shown_rad), SHOWN_REVERSED)
    # An estimate that does not know of it takes a turn the wrong way for lost way, and expects next to none.
    most_rad = max(by_estimate.expected_rad, -by_estimate.turned_rad)
    estimated = is_enough(by_estimate.telling_s, most_rad, given.heading_sd_rad, model.turning_lag_s)
    estimated |= by_estimate.telling_s >= LEAST_S and -by_estimate.turned_rad >= SURE_RAD
    # An estimate that has been led astray is not believed alone.
    shown = by_compass.expected_rad >= SHOWN_TURN_RAD
    if shown or (estimated and (not way.reversed or by_compass.telling_s >= LEAST_S)):
        return WrongWay(rate_rad_s, order_s, reversed=not way.reversed, servo_reversed=way.servo_reversed)
    return replace(way, by_estimate=by_estimate, by_compass=by_compass)


def _faded(evidence: Evidence, keep: float) -> Evidence:
    return Evidence(keep * evidence.telling_s, keep * evidence.expected_rad, keep * evidence.turned_rad)


def _taken(evidence: Evidence, block: Evidence, share: float) -> Evidence:
    """Return the evidence with a block more, none as long as she does not turn against what was found by a share."""
    expected_rad, turned_rad = evidence.expected_rad + block.expected_rad, evidence.turned_rad + block.turned_rad
    if turned_rad > share * expected_rad:
        return Evidence()
    return Evidence(evidence.telling_s + block.telling_s, expected_rad, turned_rad)


def is_enough(telling_s: float, expected_rad: float, heading_sd_rad: float, lag_s: float) -> bool:
    """Whether the rudder has told for long, and of a turn that could not have been missed."""
    return telling_s >= max(LEAST_S, LEAST_LAGS * lag_s) and expected_rad >= max(
        LEAST_TURN_RAD, LEAST_SPREADS * heading_sd_rad
    )


def judge(state: SteeringMonitorState, heading_sd_rad: float, lag_s: float) -> SteeringMonitorState:
    """Change the verdict once there is enough to tell; begin the sums anew where they bear out the one there is."""
    share = REGAINED if state.unresponsive else LOST
    answers = state.turned_rad >= share * state.expected_rad
    if answers != state.unresponsive:
        return replace(state, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
    if not is_enough(state.telling_s, state.expected_rad, heading_sd_rad, lag_s):
        return state
    return replace(state, unresponsive=not state.unresponsive, telling_s=0.0, expected_rad=0.0, turned_rad=0.0)
