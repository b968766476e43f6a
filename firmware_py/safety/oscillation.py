"""Detect a limit cycle of heading and rudder, and set the gain reduction that ends it.

The detection uses rudder and heading alone. The heading error is cut into half cycles where it changes sides. A half
cycle counts if the error exceeds the uncertainty of the heading, the rudder followed it to the same side, the goal did
not turn meanwhile, and its length is that of a limit cycle of this boat: waves are faster, wind and trim slower. Its
weight is the square of its size, up to a bound that two half cycles reach. The size is the least of three: the error by
its uncertainty, the rudder by what wind and waves take, and the estimated rudder bias by what wind takes, because a
rudder that does not turn the boat yet looks like a bias. Half cycles in a row of similar length, none much smaller than
the one before, are a limit cycle; a turn that overshoots dies away. The last of them need not be complete.

The evidence for a delayed yaw response from commanded turns (turn_delay.py) adds to the weights: with it, one plain
half cycle is enough.

Each detection, and each further half cycle, reduces the gain by a step. Once the limit cycle has ended, the reduction
is held for a while and then decays over tens of minutes. If the limit cycle returns soon, it is held twice as long.

Numeric core: functions over floats and NamedTuples without I/O, which the laboratory compiles as they stand
(hil/lab/numeric_core.py); NaN is absence.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.model.kt import KtModel
from firmware_py.safety import turn_delay
from firmware_py.safety.turn_delay import TurnDelayState

MIN_ERROR_RAD: Final = radians(1.5)
MIN_ERROR_SD: Final = 2.0  # of the heading's standard deviation
MIN_RUDDER_RAD: Final = radians(2.0)  # well beyond the deadband
RETURN_SHARE: Final = 0.2  # of the minimum error, by which the error has to be on the other side
MIN_LAGS, MAX_LAGS = 1.5, 16.0  # length of a half cycle, by the turning lag of the model
MIN_LONGEST_S: Final = 64.0  # lower bound of the maximum length: a delay is as long at any speed
MIN_WAVE_PERIODS: Final = 0.75
SIMILAR_LENGTH: Final = 1.5  # ratio of the lengths of two half cycles in a row
GROWTH, DECAY = 2.0, 0.7  # ratio of their peaks
# Sizes with a weight of 1. No limit cycle was detected in 96 hours of turns in gusts, which look most like one.
PLAIN_ERROR_SD: Final = 2.5
PLAIN_RUDDER_RAD: Final = radians(10.0)
PLAIN_BIAS_RAD: Final = radians(3.0)
DIFFUSION_SHARE: Final = 0.5  # of a half cycle, in which the random walk leads away
MAX_WEIGHT, ENOUGH = 4.0, 7.0
REDUCTION_STEP: Final = 8.0
MAX_REDUCTION: Final = 16.0  # where 8 was not enough; with more, a turn takes too long
QUIET_HALVES: Final = SIMILAR_LENGTH  # half cycles without one that counts, which end the limit cycle
PATIENT_HALVES: Final = 2.0  # half cycles after a step before the next
HOLD_S, MAX_HOLD_S = 600.0, 86_400.0
AGAIN_HOLDS: Final = 8.0  # after the first hold: half an hour at full gain
RELAX_S: Final = 1200.0  # by a factor of e


class OscillationInput(NamedTuple):
    """Heading error and goal of a tick, NaN while the boat does not steer for a heading, and the rudder command.

    `trim_rad` is the mean rudder bias, `bias_rad` by how much the present one differs from it, `diffusion_rad2_s` the
    diffusion of the heading by disturbances.
    """

    error_rad: float
    goal_rad: float
    heading_sd_rad: float
    rudder_rad: float
    trim_rad: float
    bias_rad: float
    speed_m_s: float
    wave_period_s: float
    diffusion_rad2_s: float


class HalfCycle(NamedTuple):
    """A stretch of the error on one side (1: starboard, -1: port, 0: none under way).

    `peak_rad`, `rudder_rad` and `bias_rad` are the largest to that side. `is_turn`: the goal has turned.
    """

    begun_s: float = 0.0
    side: float = 0.0
    goal_rad: float = 0.0
    peak_rad: float = 0.0
    rudder_rad: float = -math.pi
    bias_rad: float = -math.pi
    is_turn: bool = False


NO_HALF: Final = HalfCycle()


class OscillationState(NamedTuple):
    """Half cycle under way, the last that counted, the sum of the weights in a row, and the gain reduction.

    `gain_reduction` is held for `hold_s` after `last_cycle_s`, when the last half cycle of a limit cycle ended.
    `reduced_s`: time of the last step. `goal_rad` and `updated_s`: of the last tick.
    """

    half: HalfCycle = NO_HALF
    goal_rad: float = 0.0
    length_s: float = 0.0
    peak_rad: float = 0.0
    weight: float = 0.0
    oscillating: bool = False
    gain_reduction: float = 1.0
    hold_s: float = 0.0
    last_cycle_s: float = 0.0
    reduced_s: float = -math.inf
    updated_s: float = math.nan
    turn_delay: TurnDelayState = TurnDelayState()


START: Final = OscillationState()


def update(model: KtModel, state: OscillationState, given: OscillationInput, now_s: float) -> OscillationState:
    """Return the state after a tick."""
    state = relaxed(state, now_s)
    error_rad, goal_rad, half = given.error_rad, given.goal_rad, state.half
    if not math.isfinite(error_rad + goal_rad + given.rudder_rad):
        return OscillationState(
            NO_HALF, state.goal_rad, state.length_s, state.peak_rad, 0.0, False, state.gain_reduction, state.hold_s,
            state.last_cycle_s, state.reduced_s, now_s, turn_delay.with_evidence(state.turn_delay.evidence),
        )  # fmt: skip
    rudder_rad, heading_rad = given.rudder_rad - given.trim_rad, goal_rad - error_rad
    turning = half.is_turn and abs(error_rad) >= turn_delay.MIN_TURN_RAD
    delay = turn_delay.update(model, state.turn_delay, heading_rad, rudder_rad, given.speed_m_s, now_s, turning)
    if half.side == 0.0:
        return with_half(state, begin_half(now_s, 1.0 if error_rad >= 0.0 else -1.0, goal_rad, True), goal_rad, delay)
    if error_rad * half.side > -RETURN_SHARE * max(MIN_ERROR_RAD, MIN_ERROR_SD * given.heading_sd_rad):
        half = HalfCycle(
            half.begun_s,
            half.side,
            half.goal_rad,
            max(half.peak_rad, error_rad * half.side),
            max(half.rudder_rad, rudder_rad * half.side),
            max(half.bias_rad, given.bias_rad * half.side),
            half.is_turn or abs(wrap_pi(goal_rad - half.goal_rad)) > 0.5 * MIN_ERROR_RAD,
        )
        state = with_half(state, half, goal_rad, delay)
        if state.weight == 0.0 or half.is_turn:
            return state
        return counted(model, state, half, given, now_s, False)
    jumped = abs(wrap_pi(goal_rad - state.goal_rad)) > MIN_ERROR_RAD
    state = counted(model, with_half(state, half, goal_rad, delay), half, given, now_s, True)
    delay = turn_delay.end_turn(model, state.turn_delay, given.heading_sd_rad)
    return with_half(state, begin_half(now_s, -half.side, goal_rad, jumped), goal_rad, delay)


def begin_half(now_s: float, side: float, goal_rad: float, is_turn: bool) -> HalfCycle:  # noqa: FBT001 - compiled
    """Return a half cycle that begins."""
    return HalfCycle(now_s, side, goal_rad, 0.0, -math.pi, -math.pi, is_turn)


def with_half(state: OscillationState, half: HalfCycle, goal_rad: float, delay: TurnDelayState) -> OscillationState:
    """Return the state with the half cycle, goal and turn delay of this tick."""
    return OscillationState(
        half, goal_rad, state.length_s, state.peak_rad, state.weight, state.oscillating, state.gain_reduction,
        state.hold_s, state.last_cycle_s, state.reduced_s, state.updated_s, delay,
    )  # fmt: skip


def with_weight(state: OscillationState, length_s: float, peak_rad: float, weight: float) -> OscillationState:
    """Return the state with the half cycle that counted last, and the sum of the weights."""
    return OscillationState(
        state.half, state.goal_rad, length_s, peak_rad, weight, state.oscillating, state.gain_reduction, state.hold_s,
        state.last_cycle_s, state.reduced_s, state.updated_s, state.turn_delay,
    )  # fmt: skip


def counted(
    model: KtModel,
    state: OscillationState,
    half: HalfCycle,
    given: OscillationInput,
    now_s: float,
    complete: bool,  # noqa: FBT001 - compiled
) -> OscillationState:
    """Count a half cycle, complete or under way, and reduce the gain by a step if that makes a limit cycle."""
    length_s = now_s - half.begun_s
    weight = weight_of(model, half, given, length_s)
    similar = (
        state.weight > 0.0
        and length_s <= SIMILAR_LENGTH * state.length_s
        and (not complete or state.length_s <= SIMILAR_LENGTH * length_s)
        and DECAY * state.peak_rad <= half.peak_rad <= GROWTH * state.peak_rad
    )
    if not complete and (weight == 0.0 or not similar):
        return state
    if weight == 0.0:
        return with_weight(state, state.length_s, state.peak_rad, 0.0)
    total = state.weight + weight if similar else weight
    if total + state.turn_delay.evidence >= ENOUGH:
        state = reduced(state, half, now_s)
    return with_weight(state, length_s, half.peak_rad, total) if complete else state


def weight_of(model: KtModel, half: HalfCycle, given: OscillationInput, length_s: float) -> float:
    """Return the weight of a half cycle of such a length, 0 if it does not count."""
    if half.is_turn or half.peak_rad < max(MIN_ERROR_RAD, MIN_ERROR_SD * given.heading_sd_rad):
        return 0.0
    if half.rudder_rad < MIN_RUDDER_RAD or half.bias_rad <= 0.0:
        return 0.0
    lag_s = model.turning_lag_s / (max(given.speed_m_s, 0.1 * model.speed_m_s) / model.speed_m_s)
    shortest_s = max(MIN_LAGS * lag_s, MIN_WAVE_PERIODS * given.wave_period_s)
    if not shortest_s <= length_s <= max(MAX_LAGS * lag_s, MIN_LONGEST_S):
        return 0.0
    # Disturbances alone carry the heading away as a random walk, and the controller brings it back.
    walk_rad2 = DIFFUSION_SHARE * given.diffusion_rad2_s * length_s
    plain_rad = max(PLAIN_ERROR_SD * math.sqrt(given.heading_sd_rad * given.heading_sd_rad + walk_rad2), MIN_ERROR_RAD)
    size = min(half.peak_rad / plain_rad, half.rudder_rad / PLAIN_RUDDER_RAD, half.bias_rad / PLAIN_BIAS_RAD)
    return min(size * size, MAX_WEIGHT)


def reduced(state: OscillationState, half: HalfCycle, now_s: float) -> OscillationState:
    """Return the state in a limit cycle, with the gain reduced by a step if the last step had time to act.

    The evidence of the turns has had its effect and is cleared.
    """
    gain_reduction, hold_s, reduced_s = state.gain_reduction, state.hold_s, state.reduced_s
    if gain_reduction < MAX_REDUCTION and half.begun_s - reduced_s > PATIENT_HALVES * state.length_s:
        gain_reduction, reduced_s = min(gain_reduction * REDUCTION_STEP, MAX_REDUCTION), now_s
        if not state.oscillating:
            again = now_s - state.last_cycle_s < AGAIN_HOLDS * hold_s
            hold_s = min(2.0 * hold_s, MAX_HOLD_S) if again else HOLD_S
    before = state.turn_delay
    delay = TurnDelayState(
        before.t_s, before.heading_rad, before.rudder_rad, before.speed_m_s, before.first_rad, before.second_rad,
        before.third_rad, before.nominal_rad, before.delayed_rad, before.nominal_product, before.nominal_square,
        before.delayed_product, before.delayed_square, 0.0,
    )  # fmt: skip
    return OscillationState(
        state.half, state.goal_rad, state.length_s, state.peak_rad, state.weight, True, gain_reduction, hold_s, now_s,
        reduced_s, state.updated_s, delay,
    )  # fmt: skip


def relaxed(state: OscillationState, now_s: float) -> OscillationState:
    """Return the state with a limit cycle that has not been seen for a while ended, and the gain rising after it."""
    gain_reduction, oscillating = state.gain_reduction, state.oscillating
    if gain_reduction != 1.0 or oscillating:
        step_s = 0.0 if math.isnan(state.updated_s) else clamp(now_s - state.updated_s, 0.0, 1.0)
        quiet_s = now_s - state.last_cycle_s
        oscillating = oscillating and quiet_s < QUIET_HALVES * state.length_s
        if quiet_s > state.hold_s:
            gain_reduction = max(gain_reduction * math.exp(-step_s / RELAX_S), 1.0)
    return OscillationState(
        state.half, state.goal_rad, state.length_s, state.peak_rad, state.weight, oscillating, gain_reduction,
        state.hold_s, state.last_cycle_s, state.reduced_s, now_s, state.turn_delay,
    )  # fmt: skip
