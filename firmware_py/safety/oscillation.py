"""Detect a limit cycle of heading and rudder, and set the gain reduction that ends it.

Two conditions together are a limit cycle:

* The boat responds late to its rudder: the evidence of the delay test (estimate/delay_test.py) has reached
  DETECTION_EVIDENCE. It is needed because in a limit cycle the rudder follows the heading error by the control law,
  whatever the cause.
* The heading error changes its sign, and the half cycle counts: the error exceeds the uncertainty of the heading, the
  rudder is to the same side, the goal did not turn, and the half cycle is longer than those of the waves. It is
  evaluated up to its peak.

A detection reduces the gain by a step and clears the evidence. If the gain is already reduced, a detection needs two
successive half cycles, because a turn may overshoot once. After the end of the limit cycle the reduction is constant
for a time (`hold_s`), and then decays over tens of minutes. If the limit cycle returns soon, that time is doubled.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.model.kt import KtModel

# Limits of the evidence, a log-likelihood ratio. In 32 minutes of turns its maximum was 28 without a delay, in slow
# boats whose speed is not well known, and 31 to 448 with a delay of 12 s (docs/explanation/monitors.md).
DETECTION_EVIDENCE, MAX_EVIDENCE = 25.0, 50.0
MIN_ERROR_RAD: Final = radians(1.5)
MIN_ERROR_SD: Final = 2.0  # in standard deviations of the heading
MIN_RUDDER_RAD: Final = radians(2.0)  # larger than the deadband
RETURN_SHARE: Final = 0.2  # share of the minimum error that the error must have on the other side
# Minimum time from the start of a half cycle to its peak.
MIN_LAGS: Final = 1.5  # in turning lags of the model
MIN_WAVE_PERIODS: Final = 0.75
REDUCTION_STEP: Final = 8.0
MAX_REDUCTION: Final = 16.0  # second step; with a larger reduction a turn takes too long
HALF_CYCLES_PER_PEAK: Final = 2.0  # length of a half cycle divided by the time to its peak
QUIET_HALF_CYCLES: Final = 1.5  # time without a half cycle that counts, which ends the limit cycle
WAIT_HALF_CYCLES: Final = 2.0  # time from one step of the gain reduction to the next
HOLD_S, MAX_HOLD_S = 600.0, 86_400.0
REPEAT_HOLDS: Final = 8.0  # a limit cycle within this number of hold times has returned soon
RELAX_S: Final = 1200.0  # time constant of the decay


class OscillationInput(NamedTuple):
    """Heading error and goal of a tick (NaN while the boat does not steer to a heading), and the rudder command.

    `trim_rad` is the mean rudder bias, `delay_log_ratio` the log-likelihood ratio of the delay test in this tick.
    """

    error_rad: float
    goal_rad: float
    heading_sd_rad: float
    rudder_rad: float
    trim_rad: float
    speed_m_s: float
    wave_period_s: float
    delay_log_ratio: float


class HalfCycle(NamedTuple):
    """Half cycle in progress: the error has one sign (`side` 1: starboard, -1: port, 0: no half cycle).

    `peak_rad` and `rudder_rad`: largest error and rudder angle to that side. `is_turn`: the goal has turned. `counts`:
    the half cycle counts for a limit cycle. `follows`: the previous one counted.
    """

    begun_s: float = 0.0
    side: float = 0.0
    goal_rad: float = 0.0
    peak_rad: float = 0.0
    rudder_rad: float = -math.pi
    is_turn: bool = False
    counts: bool = False
    follows: bool = False


NO_HALF: Final = HalfCycle()


class OscillationState(NamedTuple):
    """Half cycle in progress, length of the last one that counted, evidence of a delay, and gain reduction.

    `gain_reduction` is constant for `hold_s` after `last_cycle_s`, the time of the last half cycle of a limit cycle.
    `reduced_s`: time of the last step. `goal_rad`, `updated_s`: goal and time of the last tick.
    """

    half: HalfCycle = NO_HALF
    goal_rad: float = 0.0
    length_s: float = 0.0
    evidence: float = 0.0
    oscillating: bool = False
    gain_reduction: float = 1.0
    hold_s: float = 0.0
    last_cycle_s: float = 0.0
    reduced_s: float = -math.inf
    updated_s: float = math.nan


START: Final = OscillationState()


def update(model: KtModel, state: OscillationState, inputs: OscillationInput, now_s: float) -> OscillationState:
    """Return the state after a tick."""
    state = with_relaxation(state, clamp(state.evidence + inputs.delay_log_ratio, 0.0, MAX_EVIDENCE), now_s)
    error_rad, goal_rad, half = inputs.error_rad, inputs.goal_rad, state.half
    if not math.isfinite(error_rad + goal_rad + inputs.rudder_rad):
        return OscillationState(
            NO_HALF, state.goal_rad, state.length_s, state.evidence, False, state.gain_reduction, state.hold_s,
            state.last_cycle_s, state.reduced_s, now_s,
        )  # fmt: skip
    if half.side == 0.0:
        half = HalfCycle(now_s, 1.0 if error_rad >= 0.0 else -1.0, goal_rad, 0.0, -math.pi, True, False, False)
        return with_half(state, half, goal_rad)
    peak_rad = error_rad * half.side
    if peak_rad <= -RETURN_SHARE * max(MIN_ERROR_RAD, MIN_ERROR_SD * inputs.heading_sd_rad):
        has_goal_changed = abs(wrap_pi(goal_rad - state.goal_rad)) > MIN_ERROR_RAD
        next_half = HalfCycle(now_s, -half.side, goal_rad, 0.0, -math.pi, has_goal_changed, False, half.counts)
        return with_half(state, next_half, goal_rad)
    rudder_rad = max(half.rudder_rad, (inputs.rudder_rad - inputs.trim_rad) * half.side)
    is_turn = half.is_turn or abs(wrap_pi(goal_rad - half.goal_rad)) > 0.5 * MIN_ERROR_RAD
    is_new_peak = peak_rad > half.peak_rad and is_large(model, inputs, peak_rad, now_s - half.begun_s)
    is_counted = is_new_peak and rudder_rad >= MIN_RUDDER_RAD and not is_turn
    half = HalfCycle(
        half.begun_s, half.side, half.goal_rad, max(half.peak_rad, peak_rad), rudder_rad, is_turn,
        half.counts or is_counted, half.follows,
    )  # fmt: skip
    state = with_half(state, half, goal_rad)
    if not is_counted:
        return state
    if state.evidence >= DETECTION_EVIDENCE and (half.follows or state.gain_reduction < REDUCTION_STEP):
        return with_reduced_gain(state, half, now_s)
    if state.oscillating:
        return with_cycle(state, state.evidence, state.gain_reduction, state.hold_s, state.reduced_s, now_s)
    return state


def is_large(model: KtModel, inputs: OscillationInput, error_rad: float, time_s: float) -> bool:
    """Return whether an error, and the time to it from the start of its half cycle, suffice for a limit cycle."""
    if error_rad < max(MIN_ERROR_RAD, MIN_ERROR_SD * inputs.heading_sd_rad):
        return False
    lag_s = model.turning_lag_s / (max(inputs.speed_m_s, 0.1 * model.speed_m_s) / model.speed_m_s)
    return time_s >= max(MIN_LAGS * lag_s, MIN_WAVE_PERIODS * inputs.wave_period_s)


def with_half(state: OscillationState, half: HalfCycle, goal_rad: float) -> OscillationState:
    """Return the state with the half cycle and the goal of this tick."""
    return OscillationState(
        half, goal_rad, state.length_s, state.evidence, state.oscillating, state.gain_reduction, state.hold_s,
        state.last_cycle_s, state.reduced_s, state.updated_s,
    )  # fmt: skip


def with_reduced_gain(state: OscillationState, half: HalfCycle, now_s: float) -> OscillationState:
    """Return the state in a limit cycle, with the gain reduced by a step if the last step has had time to act."""
    hold_s = state.hold_s
    if state.gain_reduction == MAX_REDUCTION or half.begun_s - state.reduced_s <= WAIT_HALF_CYCLES * state.length_s:
        return with_cycle(state, state.evidence, state.gain_reduction, hold_s, state.reduced_s, now_s)
    if not state.oscillating:
        has_returned = now_s - state.last_cycle_s < REPEAT_HOLDS * hold_s
        hold_s = min(2.0 * hold_s, MAX_HOLD_S) if has_returned else HOLD_S
    gain_reduction = REDUCTION_STEP if state.gain_reduction < REDUCTION_STEP else MAX_REDUCTION
    return with_cycle(state, 0.0, gain_reduction, hold_s, now_s, now_s)


def with_cycle(
    state: OscillationState, evidence: float, gain_reduction: float, hold_s: float, reduced_s: float, now_s: float
) -> OscillationState:
    """Return the state with the half cycle in progress as the last one of a limit cycle."""
    length_s = HALF_CYCLES_PER_PEAK * (now_s - state.half.begun_s)
    return OscillationState(
        state.half, state.goal_rad, length_s, evidence, True, gain_reduction, hold_s, now_s, reduced_s, state.updated_s,
    )  # fmt: skip


def with_relaxation(state: OscillationState, evidence: float, now_s: float) -> OscillationState:
    """Return the state in which a limit cycle ends if no half cycle counts, and the gain reduction decays after it."""
    gain_reduction, oscillating = state.gain_reduction, state.oscillating
    if gain_reduction != 1.0 or oscillating:
        step_s = 0.0 if math.isnan(state.updated_s) else clamp(now_s - state.updated_s, 0.0, 1.0)
        quiet_s = now_s - state.last_cycle_s
        oscillating = oscillating and quiet_s < QUIET_HALF_CYCLES * state.length_s
        if quiet_s > state.hold_s:
            gain_reduction = max(gain_reduction * math.exp(-step_s / RELAX_S), 1.0)
    return OscillationState(
        state.half, state.goal_rad, state.length_s, evidence, oscillating, gain_reduction, state.hold_s,
        state.last_cycle_s, state.reduced_s, now_s,
    )  # fmt: skip
