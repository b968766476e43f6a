"""Detect a delayed yaw response during commanded turns.

In a limit cycle, rudder and heading show the control law alone: whatever the cause, the rudder follows the turning as
the law says. A commanded turn shows more. While the boat turns to its goal, its yaw is compared with two models: the
nominal one, and one with a delay of DELAY_S in addition (three first-order lags of a third of it each). Each turns by a
factor that fits best. The logarithm of the likelihood ratio of the two, by what gusts and the uncertainty of the
heading contribute, is the evidence of a turn. It adds up within bounds, so that a few turns outweigh earlier ones.

Numeric core: functions over floats and NamedTuples without I/O, which the laboratory compiles as they stand
(hil/lab/numeric_core.py); NaN is absence.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.model.kt import KtModel, decay_over

SAMPLE_S: Final = 1.0
DELAY_S: Final = 12.0
SPEED_MEMORY_S: Final = 300.0  # at first the estimate takes a turn that does not come for lost speed
MIN_TURN_RAD: Final = radians(8.0)  # from the goal: nearer, the rudder responds to the sea
MIN_FACTOR, MAX_FACTOR = 0.25, 4.0  # of the turn that a model predicts
DISTURBANCE_RAD: Final = radians(6.0)  # rudder angle that waves and gusts amount to
HEADING_ERROR_S: Final = 4.0  # in which the heading errs by half its standard deviation
CORRELATION_S: Final = 4.0  # for so long the disturbance has one sign
# Of the log-likelihood ratio. A nominal response weighs less than it could: a limit cycle has other causes, too.
MIN_EVIDENCE, MAX_EVIDENCE = -4.0, 4.0


class TurnDelayState(NamedTuple):
    """Last sample (`t_s` NaN: none), rudder of the two models, sums over the turn under way, and the evidence.

    `nominal_product` and `delayed_product` are sums of the turn, as a rudder angle, times the model's rudder;
    `nominal_square` and `delayed_square` are sums of the square of the model's rudder.
    """

    t_s: float = math.nan
    heading_rad: float = 0.0
    rudder_rad: float = 0.0
    speed_m_s: float = 0.0
    first_rad: float = 0.0
    second_rad: float = 0.0
    third_rad: float = 0.0
    nominal_rad: float = 0.0
    delayed_rad: float = 0.0
    nominal_product: float = 0.0
    nominal_square: float = 0.0
    delayed_product: float = 0.0
    delayed_square: float = 0.0
    evidence: float = 0.0


def with_evidence(evidence: float) -> TurnDelayState:
    """Return a state that has nothing but this evidence."""
    return TurnDelayState(math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, evidence)


def update(
    model: KtModel,
    state: TurnDelayState,
    heading_rad: float,
    rudder_rad: float,
    speed_m_s: float,
    now_s: float,
    turning: bool,  # noqa: FBT001 - compiled
) -> TurnDelayState:
    """Take a sample once a second: heading, rudder from its bias, speed, and whether the boat turns to its goal."""
    if math.isnan(state.t_s):
        return TurnDelayState(
            now_s, heading_rad, rudder_rad, speed_m_s, state.first_rad, state.second_rad, state.third_rad,
            state.nominal_rad, state.delayed_rad, state.nominal_product, state.nominal_square, state.delayed_product,
            state.delayed_square, state.evidence,
        )  # fmt: skip
    step_s = now_s - state.t_s
    if step_s < SAMPLE_S:
        return state
    slow_m_s = state.speed_m_s + (1.0 - math.exp(-step_s / SPEED_MEMORY_S)) * (speed_m_s - state.speed_m_s)
    ratio = max(slow_m_s / model.speed_m_s, 0.1)
    gone = 1.0 - decay_over(step_s, model.turning_lag_s / ratio)
    part = 1.0 - math.exp(-step_s / (DELAY_S / 3.0))
    nominal_rad = state.nominal_rad + gone * (state.rudder_rad - state.nominal_rad)
    third_rad = state.third_rad + part * (state.second_rad - state.third_rad)
    delayed_rad = state.delayed_rad + gone * (state.third_rad - state.delayed_rad)
    nominal_product, nominal_square = state.nominal_product, state.nominal_square
    delayed_product, delayed_square = state.delayed_product, state.delayed_square
    if turning:
        turn_rad = wrap_pi(heading_rad - state.heading_rad) / (model.turning_ability_1_s * ratio * step_s)
        nominal_product += turn_rad * nominal_rad
        nominal_square += nominal_rad * nominal_rad
        delayed_product += turn_rad * delayed_rad
        delayed_square += delayed_rad * delayed_rad
    return TurnDelayState(
        now_s,
        heading_rad,
        rudder_rad,
        slow_m_s,
        state.first_rad + part * (state.rudder_rad - state.first_rad),
        state.second_rad + part * (state.first_rad - state.second_rad),
        third_rad,
        nominal_rad,
        delayed_rad,
        nominal_product,
        nominal_square,
        delayed_product,
        delayed_square,
        state.evidence,
    )


def end_turn(model: KtModel, state: TurnDelayState, heading_sd_rad: float) -> TurnDelayState:
    """End a stretch on one side of the goal: add the evidence of the turn in it, and clear the sums."""
    if state.nominal_square == 0.0:
        return state
    ratio = max(state.speed_m_s / model.speed_m_s, 0.1)
    heading_error_rad = 0.5 * heading_sd_rad / (HEADING_ERROR_S * model.turning_ability_1_s * ratio)
    variance = DISTURBANCE_RAD * DISTURBANCE_RAD + heading_error_rad * heading_error_rad
    weight = SAMPLE_S / (2.0 * CORRELATION_S * variance)
    delayed = explained_square(state.delayed_product, state.delayed_square)
    nominal = explained_square(state.nominal_product, state.nominal_square)
    evidence = clamp(state.evidence + weight * (delayed - nominal), MIN_EVIDENCE, MAX_EVIDENCE)
    return TurnDelayState(
        state.t_s, state.heading_rad, state.rudder_rad, state.speed_m_s, state.first_rad, state.second_rad,
        state.third_rad, state.nominal_rad, state.delayed_rad, 0.0, 0.0, 0.0, 0.0, evidence,
    )  # fmt: skip


def explained_square(product: float, square: float) -> float:
    """Return by how much the best factor of a model lowers the sum of the squares of the turn."""
    factor = clamp(product / max(square, 1e-9), MIN_FACTOR, MAX_FACTOR)
    return factor * (2.0 * product - factor * square)
