"""Detect reversed steering: the boat turns opposite to its rudder, because the servo is set up the wrong way round.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, exact_step

MIN_TURN_RUDDER_RAD: Final = radians(12.0)
MIN_TURN_ERROR_RAD: Final = radians(15.0)
MEMORY_S: Final = 120.0  # of the evidence, while nothing can be decided
# What a decision takes: time after the rudder went to one side, then time, the expected turn, and that by the
# uncertainty of the heading.
RESPONSE_TIME_S: Final = 16.0
MIN_TURN_TIME_S: Final = 20.0
MIN_TURN_LAGS: Final = 3.0
MIN_TURN_RAD: Final = radians(15.0)
MIN_HEADING_SDS: Final = 8.0
DIFFUSION_SDS: Final = 3.5  # of the standard deviation of the heading by its diffusion in that time
REVERSED_SHARE: Final = -0.5  # of the turn that the model expects: this or a lower share is an opposite turn
CERTAIN_TURN_RAD: Final = radians(60.0)  # an opposite turn of this is enough at any estimated speed and uncertainty
# The estimate may explain an unexpected turn by waves; the compass does not, once the turn exceeds theirs.
COMPASS_REVERSED_SHARE, MIN_COMPASS_TURN_RAD = -0.6, radians(150.0)


class Turn(NamedTuple):
    """Block: mean rudder, turn by the estimate and by the compass, duration."""

    rudder_rad: float
    turned_rad: float
    compass_turn_rad: float
    step_s: float


class Evidence(NamedTuple):
    """For how long the rudder has commanded turns with the same response, and the expected and the actual turn."""

    turn_time_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0


class ReversalState(NamedTuple):
    """Whether the steering is reversed with RUD_REVERSE as `servo_reversed` says, and the evidence for a change.

    `rate_rad_s` is the yaw rate of the model with the largest possible trim. `order_s`: for how long the rudder has
    commanded a turn to starboard, negative to port.
    """

    rate_rad_s: float = 0.0
    order_s: float = 0.0
    by_estimate: Evidence = Evidence()
    by_compass: Evidence = Evidence()
    reversed: bool = False
    servo_reversed: bool = False


NO_EVIDENCE: Final = Evidence()


def begin(servo_reversed: bool) -> ReversalState:  # noqa: FBT001 - compiled
    """Return the state for a value of RUD_REVERSE."""
    return ReversalState(0.0, 0.0, NO_EVIDENCE, NO_EVIDENCE, False, servo_reversed)


def update(
    model: KtModel,
    state: ReversalState,
    turn: Turn,
    slow_rudder_rad: float,
    error_rad: float,
    heading_sd_rad: float,
    diffusion_rad2_s: float,
    trim_rad: float,
) -> ReversalState:
    """Return the state after a block; an error of NaN: the boat is steered by hand.

    The response to a reversed rudder is slow at first and looks like trim. So the trim is limited to the possible one.
    """
    step_s, reversed_, max_trim_rad = turn.step_s, state.reversed, max(MIN_TURN_RUDDER_RAD, abs(trim_rad))
    over_rad = turn.rudder_rad - clamp(slow_rudder_rad, -max_trim_rad, max_trim_rad)
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(state.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    order_s = commanded_turn_s(state.order_s, over_rad, error_rad, step_s)
    by_estimate, by_compass = state.by_estimate, state.by_compass
    if order_s == 0.0:
        keep = math.exp(-step_s / MEMORY_S)
        by_estimate, by_compass = decay_evidence(by_estimate, keep), decay_evidence(by_compass, keep)
    elif abs(order_s) > RESPONSE_TIME_S:
        # Evidence against the present verdict: opposite turns, or right ones again.
        sign = math.copysign(1.0, -expected_rad if reversed_ else expected_rad)
        by_estimate = add_evidence(by_estimate, step_s, abs(expected_rad), sign * turn.turned_rad, REVERSED_SHARE)
        by_compass = add_evidence(
            by_compass, step_s, abs(expected_rad), sign * turn.compass_turn_rad, COMPASS_REVERSED_SHARE
        )
        # An estimate that does not know of a reversal explains it by lost speed, and expects next to no turn.
        largest_turn_rad = max(by_estimate.expected_rad, -by_estimate.turned_rad)
        min_turn_rad = diffusion_limit_rad(by_estimate.turn_time_s, diffusion_rad2_s)
        estimated = largest_turn_rad >= min_turn_rad and (
            is_turn_sufficient(by_estimate.turn_time_s, largest_turn_rad, heading_sd_rad, model.turning_lag_s)
            or (
                by_estimate.turn_time_s >= MIN_TURN_TIME_S
                and -by_estimate.turned_rad >= max(CERTAIN_TURN_RAD, min_turn_rad)
            )
        )
        # A reversal makes the estimate wrong, so its end has to be seen by the compass.
        by_compass_alone = by_compass.expected_rad >= MIN_COMPASS_TURN_RAD
        if by_compass_alone or (estimated and (not reversed_ or by_compass.turn_time_s >= MIN_TURN_TIME_S)):
            by_estimate, by_compass, reversed_ = NO_EVIDENCE, NO_EVIDENCE, not reversed_
    return ReversalState(rate_rad_s, order_s, by_estimate, by_compass, reversed_, state.servo_reversed)


def commanded_turn_s(before_s: float, over_rad: float, error_rad: float, step_s: float) -> float:
    """Return for how long the rudder has commanded a turn to one side, negative to port; 0 where it commands none."""
    if not is_turn_commanded(over_rad, error_rad):
        return 0.0
    return math.copysign(step_s, over_rad) + (before_s if before_s * over_rad > 0.0 else 0.0)


def is_turn_commanded(over_rad: float, error_rad: float) -> bool:
    """Return whether the rudder commands a turn, and does not stop one; an error of NaN: steered by hand."""
    ordered = math.isnan(error_rad) or (abs(error_rad) >= MIN_TURN_ERROR_RAD and error_rad * over_rad > 0.0)
    return ordered and abs(over_rad) >= MIN_TURN_RUDDER_RAD


def diffusion_limit_rad(turn_time_s: float, diffusion_rad2_s: float) -> float:
    """Return the turn that the diffusion of the heading does not explain."""
    return DIFFUSION_SDS * math.sqrt(diffusion_rad2_s * turn_time_s)


def is_turn_sufficient(turn_time_s: float, expected_rad: float, heading_sd_rad: float, lag_s: float) -> bool:
    """Return whether the rudder has commanded a turn for long, and one that the heading would have shown."""
    return turn_time_s >= max(MIN_TURN_TIME_S, MIN_TURN_LAGS * lag_s) and expected_rad >= max(
        MIN_TURN_RAD, MIN_HEADING_SDS * heading_sd_rad
    )


def decay_evidence(evidence: Evidence, keep: float) -> Evidence:
    """Return the part of the evidence that is kept."""
    return Evidence(keep * evidence.turn_time_s, keep * evidence.expected_rad, keep * evidence.turned_rad)


def add_evidence(evidence: Evidence, step_s: float, expected_rad: float, turned_rad: float, share: float) -> Evidence:
    """Return the evidence with a block more; none unless the turn is at most that share of the expected one."""
    expected_rad, turned_rad = evidence.expected_rad + expected_rad, evidence.turned_rad + turned_rad
    if turned_rad > share * expected_rad:
        return NO_EVIDENCE
    return Evidence(evidence.turn_time_s + step_s, expected_rad, turned_rad)
