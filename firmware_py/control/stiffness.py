"""How stiff the helm is, and the band in which the rudder waits: from the model and from how the estimate is corrected.

What is shown of the heading moves its estimate to and fro, by a variance of `correction_rad2_s` in a second: the
square of the Kalman filter's gain times its innovations, which is twice the covariance of heading and yaw rate, as the
heading itself has no noise (Riccati equation). Let w be its root. A helm of stiffness k holds such an estimate to the
goal within a variance that goes with w^2 sqrt(T / (K k)), the inverse of the loop's frequency. Its demand wanders with
k w, and a rudder that waits in a band of b to either side follows it at a rate of (k w)^2 / 2b (a reflected random
walk), while what it waits for costs a variance that goes with b^4. Where travel has a price, the least of the sum
has a k that goes with (T / K)^(3/7) and with a power of w, and a b of k times an angle of heading error that grows with
w. That power is 4/7 where the rudder's bias wanders; flat water, where nothing does, asks for less stiffness than that:
here it is 1.

The loop crosses over near K k [rad/s], whatever T is, because the yaw rate gain makes up for it; so it bears a delay of
(pi / 2) / (K k). That is bounded, whatever travel costs, at 5.9 s: a float of 0.3 rad/s takes 4 of them.
"""

from __future__ import annotations

import math
from typing import Final

from firmware_py.common.angles import clamp, radians
from firmware_py.common.record_class import dataclass
from firmware_py.control.reference_model import Ship

CORRECTIONS_RAD2_S: Final = (radians(0.01) ** 2, radians(1.5) ** 2)
# A helm that is sure of her heading is no softer than this: the end of a turn, and of a disturbance, would be slow.
SOFTEST_RAD2_S: Final = radians(0.08) ** 2


@dataclass(frozen=True, slots=True)
class HelmConstants:
    """Numbers of the law: four, found by `rambler-hil tune --law` (docs/explanation/seamanship.md tells of the run).

    `stiffness` is that of 1 rad/sqrt(s) where T / K is 1 s^2, `crossover_rad_s` the most that K k may be; the band, as
    an angle of heading error, is `rest_rad` and `band_sqrt_s` times w.
    """

    stiffness: float = 136.0
    crossover_rad_s: float = 0.264
    rest_rad: float = 0.00469
    band_sqrt_s: float = 1.94


DELIVERED: Final = HelmConstants()


def stiffness_of(ship: Ship, correction_rad2_s: float, price: float, constants: HelmConstants = DELIVERED) -> float:
    """Return the rudder angle per angle of heading error."""
    walk_rad = math.sqrt(clamp(correction_rad2_s, SOFTEST_RAD2_S, CORRECTIONS_RAD2_S[1]) / price)
    by_ship = math.exp(3.0 / 7.0 * math.log1p(ship.turning_lag_s / ship.turning_ability_1_s - 1.0))
    return min(constants.stiffness * walk_rad * by_ship, constants.crossover_rad_s / ship.turning_ability_1_s)


def softened(
    stiffness: float, softness: float, found_1_s: float, told_1_s: float, constants: HelmConstants = DELIVERED
) -> float:
    """Return the stiffness of a helm whose crossover is bounded lower by the softness, and no softer than that takes.

    A boat that swings is not as the estimate has it, which may have lost most of her speed meanwhile: of the turning
    ability that was found and the one that was told the larger bounds it.
    """
    return min(stiffness, constants.crossover_rad_s / (softness * max(found_1_s, told_1_s)))


def band_of(correction_rad2_s: float, stiffness: float, price: float, constants: HelmConstants = DELIVERED) -> float:
    """Return how far the demand may leave the command [rad]."""
    walk_rad = constants.band_sqrt_s * math.sqrt(clamp(correction_rad2_s, *CORRECTIONS_RAD2_S))
    return stiffness * math.sqrt(price) * (constants.rest_rad + walk_rad)
