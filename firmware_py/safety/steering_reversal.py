"""Detect reversed steering: the boat turns opposite to its rudder, because the servo is set up the wrong way round.

Numeric core: functions over floats and NamedTuples without I/O, which the laboratory compiles as they stand
(hil/lab/numeric_core.py); NaN is absence.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from firmware_py.common.angles import clamp, radians
from firmware_py.model.kt import KtModel, decay_over, exact_step
from firmware_py.safety.turn_order import FAR_RUDDER_RAD, LATE_S, LEAST_S, MEMORY_S, is_enough, ordered_s, wander_rad

REVERSED: Final = -0.5  # of the turn that the model expects: this or a lower share is an opposite turn
SURE_RAD: Final = radians(60.0)  # an opposite turn of this is enough at any estimated speed and uncertainty
# The estimate may explain an unexpected turn by waves; the compass does not, once the turn exceeds theirs.
SHOWN_REVERSED, SHOWN_TURN_RAD = -0.6, radians(150.0)


class Turn(NamedTuple):
    """A stretch of time: its mean rudder, the turn in it by the estimate and by the compass, its length."""

    rudder_rad: float
    turned_rad: float
    shown_rad: float
    step_s: float


class Evidence(NamedTuple):
    """For how long the rudder has commanded turns with the same response, and the expected and the actual turn."""

    telling_s: float = 0.0
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

    The response to a reversed rudder is slow at first and looks like trim. So no more is taken for trim than there can
    be, and none of the turn.
    """
    step_s, reversed_, most_trim_rad = turn.step_s, state.reversed, max(FAR_RUDDER_RAD, abs(trim_rad))
    over_rad = turn.rudder_rad - clamp(slow_rudder_rad, -most_trim_rad, most_trim_rad)
    decay = decay_over(step_s, model.turning_lag_s)
    steady_rad_s = model.turning_ability_1_s * over_rad
    expected_rad, rate_rad_s = exact_step(state.rate_rad_s, steady_rad_s, decay, step_s, model.turning_lag_s)
    order_s = ordered_s(state.order_s, over_rad, error_rad, step_s)
    by_estimate, by_compass = state.by_estimate, state.by_compass
    if order_s == 0.0:
        keep = math.exp(-step_s / MEMORY_S)
        by_estimate, by_compass = faded(by_estimate, keep), faded(by_compass, keep)
    elif abs(order_s) > LATE_S:
        # Evidence against the present verdict: opposite turns, or right ones again.
        sign = math.copysign(1.0, -expected_rad if reversed_ else expected_rad)
        by_estimate = added(by_estimate, step_s, abs(expected_rad), sign * turn.turned_rad, REVERSED)
        by_compass = added(by_compass, step_s, abs(expected_rad), sign * turn.shown_rad, SHOWN_REVERSED)
        # An estimate that does not know of a reversal explains it by lost speed, and expects next to no turn.
        most_rad = max(by_estimate.expected_rad, -by_estimate.turned_rad)
        least_rad = wander_rad(by_estimate.telling_s, diffusion_rad2_s)
        estimated = most_rad >= least_rad and (
            is_enough(by_estimate.telling_s, most_rad, heading_sd_rad, model.turning_lag_s)
            or (by_estimate.telling_s >= LEAST_S and -by_estimate.turned_rad >= max(SURE_RAD, least_rad))
        )
        # An estimate that a reversal has led astray needs the compass.
        shown = by_compass.expected_rad >= SHOWN_TURN_RAD
        if shown or (estimated and (not reversed_ or by_compass.telling_s >= LEAST_S)):
            by_estimate, by_compass, reversed_ = NO_EVIDENCE, NO_EVIDENCE, not reversed_
    return ReversalState(rate_rad_s, order_s, by_estimate, by_compass, reversed_, state.servo_reversed)


def faded(evidence: Evidence, keep: float) -> Evidence:
    """Return the part of the evidence that is kept."""
    return Evidence(keep * evidence.telling_s, keep * evidence.expected_rad, keep * evidence.turned_rad)


def added(evidence: Evidence, step_s: float, expected_rad: float, turned_rad: float, share: float) -> Evidence:
    """Return the evidence with a block more; none unless the turn is at most that share of the expected one."""
    expected_rad, turned_rad = evidence.expected_rad + expected_rad, evidence.turned_rad + turned_rad
    if turned_rad > share * expected_rad:
        return NO_EVIDENCE
    return Evidence(evidence.telling_s + step_s, expected_rad, turned_rad)
