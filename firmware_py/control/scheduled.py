"""Holds a heading as a good helmsman does: with the trim carried, a plan for each turn, and a quiet rudder.

The S-surface acts on what the estimate says that she is off the reference. Its gains follow from
one price: the rudder that minimises the integral of error^2 + (rudder / stiffness)^2 on the K-T
model has a proportional gain `stiffness` and the yaw rate gain below, at any speed. The demand
moves the command only when it leaves a band around it, and then no farther than the band's edge:
where every degree of rudder travel has the same price, that is the best rule for a rudder that
follows a wandering demand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_py.common.angles import clamp, degrees, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.control.reference_model import Reference, Ship, update
from firmware_py.control.s_surface import Gains, rudder_demand
from firmware_py.model.kt import KtModel, steady_yaw_rate

# Found by search over tank, sea, swell, weak, storm and seas between them, with and without a satellite
# receiver, with K and T up to 30 % off; the optimum is flat. At MDL_SPEED and 1 deg of spread:
STIFFNESS: Final = 3.1
STIFFNESS_BY_SPREAD: Final = 0.55
STIFFNESS_BY_SPEED: Final = -0.6
SPREADS_DEG: Final = (0.02, 4.0)
BAND_DEG: Final = 0.25
BAND_BY_SPREAD: Final = 0.65
BAND_BY_SPEED: Final = 0.3
TURNING_RAD: Final = radians(3.0)  # farther than this from the goal a turn is made, in a narrower band
TURNING_SHARE: Final = 0.3


@dataclass(frozen=True, slots=True)
class ScheduledSettings:
    """The model of the vehicle file, the rudder limit, the price of rudder travel, and the least speed to steer at."""

    model: KtModel
    limit_rad: float
    trim_rad: float
    price: float
    least_speed_m_s: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> ScheduledSettings:
        """Read the settings from the parameters."""
        return cls(
            KtModel.of(parameters),
            radians(parameters["RUD_LIMIT_DEG"]),
            radians(parameters["CTL_TRIM_DEG"]),
            parameters["CTL_PRICE"],
            parameters["CTL_WAY_MIN"],
        )


@dataclass(frozen=True, slots=True)
class HeadingEstimate:
    """What the estimate says: low-frequency heading and yaw rate, rudder bias, speed, and how well she turns."""

    heading_rad: float
    heading_spread_rad: float
    yaw_rate_rad_s: float
    bias_rad: float
    speed_m_s: float
    speed_spread_m_s: float
    turning_factor: float


@dataclass(frozen=True, slots=True)
class RudderDemand:
    """The rudder asked for, and how far the command may be from it before it follows."""

    demand_rad: float
    band_rad: float


def ship_now(settings: ScheduledSettings, known: HeadingEstimate) -> Ship:
    """Return the model at the estimated speed (similarity, paper eq. 7), turning as well as she is found to."""
    ability_1_s, lag_s, norrbin_s2 = settings.model.scaled(known.speed_m_s / settings.model.speed_m_s)
    return Ship(
        ability_1_s * known.turning_factor,
        lag_s,
        norrbin_s2,
        settings.limit_rad,
        clamp(known.bias_rad + settings.trim_rad, -settings.limit_rad, settings.limit_rad),
    )


def stiffness_of(settings: ScheduledSettings, known: HeadingEstimate) -> float:
    """Return the rudder angle per angle of heading error."""
    ratio = known.speed_m_s / settings.model.speed_m_s
    by_spread = math.pow(_spread_deg(known), STIFFNESS_BY_SPREAD)
    return STIFFNESS / settings.price * by_spread * math.pow(ratio, STIFFNESS_BY_SPEED)


def band_of(settings: ScheduledSettings, known: HeadingEstimate, stiffness: float) -> float:
    """Return how far the demand may leave the command: by what the estimate's noise does to the demand, and a rest."""
    ratio = known.speed_m_s / settings.model.speed_m_s
    band_deg = BAND_DEG + BAND_BY_SPREAD * stiffness * _spread_deg(known)
    return radians(settings.price * band_deg * math.pow(ratio, BAND_BY_SPEED))


def _spread_deg(known: HeadingEstimate) -> float:
    return clamp(degrees(known.heading_spread_rad), *SPREADS_DEG)


def gains_of(ship: Ship, stiffness: float) -> Gains:
    """Return the S-surface that is, for small errors, the optimal regulator of that stiffness."""
    rate_gain_s = (math.sqrt(1.0 + 2.0 * ship.turning_ability_1_s * ship.turning_lag_s * stiffness) - 1.0) / (
        ship.turning_ability_1_s
    )
    rate_max_rad_s = steady_yaw_rate(ship.limit_rad, ship.turning_ability_1_s, ship.norrbin_s2)
    return Gains(
        2.0 * math.pi * stiffness / ship.limit_rad,
        2.0 * rate_gain_s * rate_max_rad_s / ship.limit_rad,
        ship.limit_rad,
        rate_max_rad_s,
        0.0,
    )


def scheduled_demand(
    settings: ScheduledSettings, reference: Reference | None, known: HeadingEstimate, error_rad: float, step_s: float
) -> tuple[Reference, RudderDemand | None]:
    """Advance the reference and return it with the order; error_rad is the goal less the estimated heading.

    Without steerage way there is no order: a rudder that turns nothing is left where it is.
    """
    if reference is None:
        reference = Reference(known.heading_rad, known.yaw_rate_rad_s)
    if known.speed_m_s + known.speed_spread_m_s < settings.least_speed_m_s:
        return Reference(known.heading_rad, known.yaw_rate_rad_s), None
    ship = ship_now(settings, known)
    # An error of half a turn either way is a turn ordered the long way: it must not wrap.
    left_rad = error_rad - wrap_pi(reference.heading_rad - known.heading_rad)
    if abs(error_rad) < math.pi:
        left_rad = wrap_pi(left_rad)
    reference = update(ship, reference, left_rad, known.heading_rad, step_s)
    stiffness = stiffness_of(settings, known)
    off_rad = wrap_pi(reference.heading_rad - known.heading_rad)
    feedback_rad = rudder_demand(gains_of(ship, stiffness), off_rad, known.yaw_rate_rad_s - reference.yaw_rate_rad_s)
    demand_rad = ship.bias_rad + reference.push_rad + feedback_rad
    band_rad = band_of(settings, known, stiffness)
    if abs(left_rad) > TURNING_RAD:
        band_rad *= TURNING_SHARE
    return reference, RudderDemand(clamp(demand_rad, -settings.limit_rad, settings.limit_rad), band_rad)


def apply_deadband(command_rad: float, order: RudderDemand) -> float:
    """Return the command drawn along by the demand: unmoved within the band, on its edge otherwise."""
    return clamp(command_rad, order.demand_rad - order.band_rad, order.demand_rad + order.band_rad)
