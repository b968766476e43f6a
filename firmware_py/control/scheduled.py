"""Holds a heading as a good helmsman does: with the trim carried, a plan for each turn, and a quiet rudder.

The S-surface acts on what the estimate says that the boat is off the reference. Its gains follow from
one stiffness (stiffness.py): the rudder that minimises the integral of error^2 + (rudder / stiffness)^2 on the K-T
model has a proportional gain `stiffness` and the yaw rate gain below, at any speed. The demand
moves the command only when it leaves a band around it, and then no farther than the band's edge:
where every degree of rudder travel has the same price, that is the best rule for a rudder that
follows a wandering demand.

A helm that is to be softer has less of all that closes the loop: stiffness, and a bias that follows the estimated one
more slowly, which swings with a boat that swings. The rudder that is fed forward does not close it: a boat that is late
makes the same turn later. But the reference does where it waits for her, so it runs farther ahead, and turns more
slowly, for what she lags behind drives her on while it brakes. Its band is that of its stiffness: a wider one makes a
boat swing that is later than her model.
"""

from __future__ import annotations

import math
from typing import Final

from msgspec.structs import replace

from firmware_py.common.angles import clamp, radians, wrap_pi
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.record_class import dataclass, maker
from firmware_py.common.reports import HeadingEstimate
from firmware_py.control import reference_model
from firmware_py.control.controller import HeadingControllerInput, HeadingControllerState
from firmware_py.control.reference_model import Reference, Ship
from firmware_py.control.s_surface import Gains, rudder_demand
from firmware_py.control.stiffness import band_of, softened, stiffness_of
from firmware_py.model.kt import KtModel, steady_yaw_rate

_new_ship = maker(Ship)
_new_gains = maker(Gains)
_new_heading_controller_state = maker(HeadingControllerState)
_new_reference = maker(Reference)

TURNING_RAD: Final = radians(3.0)  # farther than this from the goal a turn is made, in a narrower band
TURNING_SHARE: Final = 0.1
SLOWER_BIAS_S: Final = 25.0  # the time in which the bias is followed, for each 1 that the softness is above 1


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
            model=KtModel.of(parameters),
            limit_rad=radians(parameters["RUD_LIMIT_DEG"]),
            trim_rad=radians(parameters["CTL_TRIM_DEG"]),
            price=parameters["CTL_PRICE"],
            least_speed_m_s=parameters["CTL_WAY_MIN"],
        )


@dataclass(frozen=True, slots=True)
class RudderDemand:
    """The rudder asked for, and how far the command may be from it before it follows."""

    demand_rad: float
    band_rad: float


_new_rudder_demand = maker(RudderDemand)


def update(
    settings: ScheduledSettings, state: HeadingControllerState, given: HeadingControllerInput
) -> tuple[HeadingControllerState, float | None]:
    """Return the rudder demand [rad] with the reference of the turn; None without an estimate to steer by."""
    if given.estimate is None:
        return _new_heading_controller_state(), None
    bias_rad = followed_bias(state.bias_rad, given)
    estimate = given.estimate if bias_rad is None else replace(given.estimate, bias_rad=bias_rad)
    reference, demand = scheduled_demand(
        settings, state.reference, estimate, given.error_rad, given.step_s, given.softness
    )
    command_rad = given.command_rad if demand is None else apply_deadband(given.command_rad, demand)
    return _new_heading_controller_state(reference, bias_rad), command_rad


def followed_bias(bias_rad: float | None, given: HeadingControllerInput) -> float | None:
    """Return the rudder bias that a softened helm steers by, which follows the estimate; None: the estimate itself.

    It begins with the mean, if that is nearer amidships: while she swings the estimate swings with her, by as much as
    14 deg, and a soft helm that began there would lie as far beside the goal, for ten minutes.
    """
    if given.estimate is None or given.softness <= 1.0:
        return None
    if bias_rad is None:
        return min(given.estimate.bias_rad, given.estimate.bias_mean_rad, key=abs)
    part = -math.expm1(-given.step_s / (SLOWER_BIAS_S * (given.softness - 1.0)))
    return bias_rad + part * (given.estimate.bias_rad - bias_rad)


def ship_at_speed(settings: ScheduledSettings, estimate: HeadingEstimate) -> Ship:
    """Return the model at the estimated speed (similarity, paper eq. 7), turning as well as the boat is found to."""
    ability_1_s, lag_s, norrbin_s2 = settings.model.scaled(estimate.speed_m_s / settings.model.speed_m_s)
    return _new_ship(
        ability_1_s * estimate.turning_factor,
        lag_s,
        norrbin_s2,
        settings.limit_rad,
        clamp(estimate.bias_rad + settings.trim_rad, -settings.limit_rad, settings.limit_rad),
    )


def gains_of(ship: Ship, stiffness: float) -> Gains:
    """Return the S-surface that is, for small errors, the optimal regulator of that stiffness."""
    rate_gain_s = (math.sqrt(1.0 + 2.0 * ship.turning_ability_1_s * ship.turning_lag_s * stiffness) - 1.0) / (
        ship.turning_ability_1_s
    )
    rate_max_rad_s = steady_yaw_rate(ship.limit_rad, ship.turning_ability_1_s, ship.norrbin_s2)
    return _new_gains(
        2.0 * math.pi * stiffness / ship.limit_rad,
        2.0 * rate_gain_s * rate_max_rad_s / ship.limit_rad,
        ship.limit_rad,
        rate_max_rad_s,
        0.0,
    )


def scheduled_demand(
    settings: ScheduledSettings,
    reference: Reference | None,
    estimate: HeadingEstimate,
    error_rad: float,
    step_s: float,
    softness: float = 1.0,
) -> tuple[Reference, RudderDemand | None]:
    """Advance the reference and return it with the demand; error_rad is the goal less the estimated heading.

    Without steerage way there is no demand at the goal: a rudder that turns nothing is left where it is. Off it there
    is one: the little way that she may have turns her, too, and a rudder that is let go and taken up again as the
    estimate of her speed swings about the least one travels more, and turns her later, than one kept hard over.
    """
    if reference is None:
        reference = _new_reference(estimate.heading_rad, estimate.yaw_rate_rad_s)
    without_way = estimate.speed_m_s + estimate.speed_sd_m_s < settings.least_speed_m_s
    if without_way and abs(error_rad) <= TURNING_RAD:
        return _new_reference(estimate.heading_rad, estimate.yaw_rate_rad_s), None
    ship = ship_at_speed(settings, estimate)
    # An error of half a turn either way is a turn ordered the long way: it must not wrap.
    left_rad = error_rad - wrap_pi(reference.heading_rad - estimate.heading_rad)
    if abs(error_rad) < math.pi:
        left_rad = wrap_pi(left_rad)
    reference = reference_model.update(ship, reference, left_rad, estimate.heading_rad, step_s, softness)
    correction_rad2_s = estimate.correction_rad2_s
    stiffness = stiffness_of(ship, correction_rad2_s, settings.price)
    if softness > 1.0:
        stiffness = softened(stiffness, softness, ship.turning_ability_1_s, settings.model.turning_ability_1_s)
    off_rad = wrap_pi(reference.heading_rad - estimate.heading_rad)
    feedback_rad = rudder_demand(gains_of(ship, stiffness), off_rad, estimate.yaw_rate_rad_s - reference.yaw_rate_rad_s)
    demand_rad = ship.bias_rad + reference.feedforward_rad + feedback_rad
    band_rad = band_of(correction_rad2_s, stiffness, settings.price)
    if abs(left_rad) > TURNING_RAD:
        band_rad *= TURNING_SHARE
    return reference, _new_rudder_demand(clamp(demand_rad, -settings.limit_rad, settings.limit_rad), band_rad)


def apply_deadband(command_rad: float, demand: RudderDemand) -> float:
    """Return the command drawn along by the demand: unmoved within the band, on its edge otherwise."""
    return clamp(command_rad, demand.demand_rad - demand.band_rad, demand.demand_rad + demand.band_rad)
