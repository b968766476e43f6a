"""Detect reversed steering: the boat turns against its rudder, because the sign of the servo is wrong.

Numeric core: functions without I/O that the laboratory compiles unchanged (hil/lab/numeric_core.py); NaN: absent.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, exact_step

MIN_TURN_RUDDER_RAD: Final = radians(12.0)
MIN_TURN_ERROR_RAD: Final = radians(15.0)
MEMORY_S: Final = 120.0  # of the evidence, while no turn is commanded
# Conditions of a decision.
RESPONSE_TIME_S: Final = 16.0  # from the start of a commanded turn, before the evidence
MIN_TURN_TIME_S: Final = 20.0
MIN_TURN_LAGS: Final = 3.0
MIN_TURN_RAD: Final = radians(15.0)
MIN_HEADING_SDS: Final = 8.0  # of the turn
DIFFUSION_SDS: Final = 3.5  # minimum turn, in standard deviations of the heading by its diffusion
REVERSED_SHARE: Final = -0.5  # maximum share of the turn of the model that is an opposite turn
CERTAIN_TURN_RAD: Final = radians(60.0)  # opposite turn that is sufficient at any speed and uncertainty
# The estimate may explain an opposite turn by waves. A turn of the compass that is larger than wave yaw is certain.
COMPASS_REVERSED_SHARE, MIN_COMPASS_TURN_RAD = -0.6, radians(150.0)


class Turn(NamedTuple):
    """Block with its mean rudder, turn of the estimated heading, turn of the compass, and duration."""

    rudder_rad: float
    turned_rad: float
    compass_turn_rad: float
    step_s: float


class Evidence(NamedTuple):
    """Time in which the rudder has commanded turns with the same response, sums of the expected and the actual turn."""

    turn_time_s: float = 0.0
    expected_rad: float = 0.0
    turned_rad: float = 0.0


class ReversalState(NamedTuple):
    """Whether the steering is reversed with the RUD_REVERSE in `servo_reversed`, and the evidence for a change.

    `rate_rad_s`: yaw rate of the model for the rudder minus the trim. `order_s`: time for which the rudder has
    commanded a turn, positive to starboard.
    """

    rate_rad_s: float = 0.0
    order_s: float = 0.0
    by_estimate: Evidence = Evidence()
    by_compass: Evidence = Evidence()
    reversed: bool = False
    servo_reversed: bool = False


NO_EVIDENCE: Final = Evidence()


def begin(servo_reversed: bool) -> ReversalState:  # noqa: FBT001 - compiled
    """Return the initial state for a value of RUD_REVERSE."""
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
    """Return the state after a block; `error_rad` NaN: the boat is steered by hand.

    The first response to a reversed rudder is slow and looks like trim. So the trim is limited to the learned one.
    """
    step_s, is_reversed, max_trim_rad = turn.step_s, state.reversed, max(MIN_TURN_RUDDER_RAD, abs(trim_rad))
    turn_rudder_rad = turn.rudder_rad - clamp(slow_rudder_rad, -max_trim_rad, max_trim_rad)
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * turn_rudder_rad
    expected_rad, rate_rad_s = exact_step(state.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    order_s = commanded_turn_s(state.order_s, turn_rudder_rad, error_rad, step_s)
    by_estimate, by_compass = state.by_estimate, state.by_compass
    if order_s == 0.0:
        kept_share = math.exp(-step_s / MEMORY_S)
        by_estimate, by_compass = decay_evidence(by_estimate, kept_share), decay_evidence(by_compass, kept_share)
    elif abs(order_s) > RESPONSE_TIME_S:
        # Evidence against the present verdict: opposite turns, or turns in the right direction after a reversal.
        sign = math.copysign(1.0, -expected_rad if is_reversed else expected_rad)
        by_estimate = add_evidence(by_estimate, step_s, abs(expected_rad), sign * turn.turned_rad, REVERSED_SHARE)
        by_compass = add_evidence(
            by_compass, step_s, abs(expected_rad), sign * turn.compass_turn_rad, COMPASS_REVERSED_SHARE
        )
        # A filter without knowledge of the reversal explains it by a low speed, and expects almost no turn.
        max_turn_rad = max(by_estimate.expected_rad, -by_estimate.turned_rad)
        min_turn_rad = diffusion_limit_rad(by_estimate.turn_time_s, diffusion_rad2_s)
        is_certain = max_turn_rad >= min_turn_rad and (
            is_turn_sufficient(by_estimate.turn_time_s, max_turn_rad, heading_sd_rad, model.turning_lag_s)
            or (
                by_estimate.turn_time_s >= MIN_TURN_TIME_S
                and -by_estimate.turned_rad >= max(CERTAIN_TURN_RAD, min_turn_rad)
            )
        )
        # The estimate is wrong during a reversal, so the end of the reversal needs evidence by the compass.
        is_certain_by_compass = by_compass.expected_rad >= MIN_COMPASS_TURN_RAD
        if is_certain_by_compass or (is_certain and (not is_reversed or by_compass.turn_time_s >= MIN_TURN_TIME_S)):
            by_estimate, by_compass, is_reversed = NO_EVIDENCE, NO_EVIDENCE, not is_reversed
    return ReversalState(rate_rad_s, order_s, by_estimate, by_compass, is_reversed, state.servo_reversed)


def commanded_turn_s(previous_s: float, turn_rudder_rad: float, error_rad: float, step_s: float) -> float:
    """Return the time for which the rudder has commanded a turn to one side, positive to starboard; 0: no turn."""
    if not is_turn_commanded(turn_rudder_rad, error_rad):
        return 0.0
    return math.copysign(step_s, turn_rudder_rad) + (previous_s if previous_s * turn_rudder_rad > 0.0 else 0.0)


def is_turn_commanded(turn_rudder_rad: float, error_rad: float) -> bool:
    """Return whether the rudder commands a turn, rather than stops one; `error_rad` NaN: steered by hand."""
    is_ordered = math.isnan(error_rad) or (abs(error_rad) >= MIN_TURN_ERROR_RAD and error_rad * turn_rudder_rad > 0.0)
    return is_ordered and abs(turn_rudder_rad) >= MIN_TURN_RUDDER_RAD


def diffusion_limit_rad(turn_time_s: float, diffusion_rad2_s: float) -> float:
    """Return the smallest turn that diffusion of the heading does not explain."""
    return DIFFUSION_SDS * math.sqrt(diffusion_rad2_s * turn_time_s)


def is_turn_sufficient(turn_time_s: float, expected_rad: float, heading_sd_rad: float, lag_s: float) -> bool:
    """Return whether a turn was commanded for long enough, and is large compared with the heading uncertainty."""
    return turn_time_s >= max(MIN_TURN_TIME_S, MIN_TURN_LAGS * lag_s) and expected_rad >= max(
        MIN_TURN_RAD, MIN_HEADING_SDS * heading_sd_rad
    )


def decay_evidence(evidence: Evidence, share: float) -> Evidence:
    """Return the evidence after a decay to the share `share`."""
    return Evidence(share * evidence.turn_time_s, share * evidence.expected_rad, share * evidence.turned_rad)


def add_evidence(evidence: Evidence, step_s: float, expected_rad: float, turned_rad: float, share: float) -> Evidence:
    """Return the evidence with a block added; none if the turn exceeds this share of the expected turn."""
    expected_rad, turned_rad = evidence.expected_rad + expected_rad, evidence.turned_rad + turned_rad
    if turned_rad > share * expected_rad:
        return NO_EVIDENCE
    return Evidence(evidence.turn_time_s + step_s, expected_rad, turned_rad)
