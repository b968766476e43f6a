"""The reference: how a boat that obeys its model would come to the goal, fast and without overshoot.

The K-T model is steered by a rule that is nearly time-optimal: full rudder until the angle that
it still runs on while braking is all that is left, then full rudder the other way. Feedback then only
has to hold the real boat to it, and the rudder that the reference uses is fed forward.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.common.record_class import dataclass, maker
from firmware_py.model.kt import decay_over, exact_step

EASING_RAD: Final = radians(5.6)  # the last of the way is made in proportion
BRAKING_SHARE: Final = 0.8  # of the full rudder that braking counts on
RATE_GAIN: Final = 0.55  # of the rudder that holds a yaw rate: damps the last of the way
LEAST_FEEDFORWARD_RAD: Final = radians(5.0)  # so that no trim, however wrong, leaves the boat without a turn
LEAD_RAD: Final = radians(6.0)  # the reference waits for the boat beyond this
SLOWER_TURN_S: Final = 1.2  # for each 1 that the softness is above 1: in it, the reference turns by LEAD_RAD at most


@dataclass(frozen=True, slots=True)
class Ship:
    """The K-T model at the present speed, and the rudder: its limit and where the boat runs straight."""

    turning_ability_1_s: float
    turning_lag_s: float
    norrbin_s2: float
    limit_rad: float
    bias_rad: float


@dataclass(frozen=True, slots=True)
class Reference:
    """Heading and yaw rate that the boat should have now, and the rudder beyond the bias that it takes."""

    heading_rad: float
    yaw_rate_rad_s: float
    feedforward_rad: float = 0.0


_new_reference = maker(Reference)


def stopping_angle_rad(ship: Ship, yaw_rate_rad_s: float, brake_rad: float) -> float:
    """Return the angle that the boat turns on while a rudder of brake_rad (> 0) against the turn stops it."""
    against_rad_s = ship.turning_ability_1_s * brake_rad
    rate_rad_s = abs(yaw_rate_rad_s)
    angle_rad = ship.turning_lag_s * (rate_rad_s - against_rad_s * math.log1p(rate_rad_s / against_rad_s))
    return math.copysign(angle_rad, yaw_rate_rad_s)


def update(
    ship: Ship, reference: Reference, error_rad: float, heading_rad: float, step_s: float, softness: float = 1.0
) -> Reference:
    """Carry the reference over a step toward a goal that lies error_rad from it; it keeps near heading_rad.

    Where it waits for the boat it closes the loop, so that of a softer helm runs as many times farther ahead, and
    turns more slowly: a boat that is later than her model must not fall far behind.
    """
    high_rad = max(ship.limit_rad - ship.bias_rad, LEAST_FEEDFORWARD_RAD)
    low_rad = min(-ship.limit_rad - ship.bias_rad, -LEAST_FEEDFORWARD_RAD)
    r = reference.yaw_rate_rad_s
    share = 1.0 / max((softness - 1.0) * SLOWER_TURN_S * ship.turning_ability_1_s * ship.limit_rad / LEAD_RAD, 1.0)
    high_rad, low_rad = high_rad * share, low_rad * share
    brake_rad = BRAKING_SHARE * (high_rad if r < 0.0 else -low_rad)
    left_rad = error_rad - stopping_angle_rad(ship, r, brake_rad)
    feedforward_rad = ship.limit_rad * share * left_rad / EASING_RAD - RATE_GAIN * r / ship.turning_ability_1_s
    feedforward_rad = clamp(feedforward_rad, low_rad, high_rad)
    steady = ship.turning_ability_1_s * feedforward_rad - ship.norrbin_s2 * r * r * r
    decay = decay_over(step_s, ship.turning_lag_s)
    turned_rad, rate_rad_s = exact_step(r, steady, decay, step_s, ship.turning_lag_s)
    most_rad = LEAD_RAD * softness
    lead_rad = clamp(wrap_pi(reference.heading_rad - heading_rad) + turned_rad, -most_rad, most_rad)
    return _new_reference(wrap_two_pi(heading_rad + lead_rad), rate_rad_s, feedforward_rad)
