"""Heading control law: an S-surface with scheduled gains that follows a reference model.

Numeric core: functions without I/O; NaN: absent. Python runs this code on the boat, and the laboratory compiles it
unchanged (hil/lab/numeric_core.py). Both give the same result to the last bit.

S-surface (Wang et al. 2018, eq. 8):

    u = 2 / (1 + exp(-(k1 * e + k2 * edot))) - 1 + du          rudder = delta_max * clamp(u, -1, 1)

with the normalisation e = error / pi, edot = -r / r_max, where r_max is the steady yaw rate at delta_max. The paper
does not print its own.

Gains: the rudder that minimises the integral of error^2 + (rudder / k)^2 on the K-T model has the proportional gain k
and the rate gain of `gains_of` (algebraic Riccati equation), at any speed.

Proportional gain and deadband: measurements move the estimated heading by a variance of `correction_rad2_s` per second,
the square of the Kalman gain times the innovations. In the Riccati equation it is twice the covariance of heading and
yaw rate, because the heading itself has no process noise. Let w be its root. A loop of proportional gain k keeps the
estimate at the goal within a variance proportional to w^2 sqrt(T / (K k)), the inverse of the loop's frequency. The
demand wanders with k w. A rudder that moves only at the edge of a deadband of half-width b follows it at a rate of
(k w)^2 / 2b (reflected random walk), and the deadband costs a variance proportional to b^4. With a price on rudder
travel, the minimum of the sum has k proportional to (T / K)^(3/7) and to a power of w, and b equal to k times an angle
of heading error that grows with w. The power of w is 4/7 where the rudder bias wanders; flat water, where nothing does,
needs a lower gain: the law uses 1.

Stability: the rate gain compensates T, so the loop crosses over near K k [rad/s] for any T and tolerates a delay of
(pi / 2) / (K k). `crossover_rad_s` bounds K k, so that the delay margin is 5.9 s at any price; a float with a natural
frequency of 0.3 rad/s uses 4 s of it.

Gain reduction, after a detected limit cycle, lowers what closes the loop: the proportional gain, with the deadband in
proportion to it (a wider one makes a boat oscillate that responds later than its model), and the speed at which the
rudder bias follows its estimate, which oscillates with the boat. The feedforward rudder does not close the loop: a boat
that responds late makes the same turn later. The reference does where its lead is limited, so it may lead further, and
turns more slowly, because a reference that is far ahead drives the boat on while it brakes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from firmware_py.common.angles import clamp, radians, wrap_pi, wrap_two_pi
from firmware_py.model.heading_estimate import HeadingEstimate
from firmware_py.model.kt import KtModel, decay_over, exact_step, held_cubic, scaled, steady_yaw_rate

if TYPE_CHECKING:
    from firmware_py.common.parameters import ParameterSet

# Reference model.
EASING_RAD: Final = radians(5.6)  # the remaining angle below which the rudder is proportional to it
BRAKING_SHARE: Final = 0.8  # of the rudder limit that the stopping angle counts on
RATE_GAIN: Final = 0.55  # of the rudder that holds a yaw rate: damps the end of the turn
MIN_FEEDFORWARD_RAD: Final = radians(5.0)  # so that no rudder bias, however wrong, leaves the boat unable to turn
LEAD_RAD: Final = radians(6.0)  # maximum lead of the reference over the boat
REDUCED_TURN_S: Final = 1.2  # per 1 of gain reduction above 1: in it, the reference turns by LEAD_RAD at most

# Scheduled gains.
CORRECTIONS_RAD2_S: Final = (radians(0.01) ** 2, radians(1.5) ** 2)
# Lower bound for the proportional gain alone: with less, the end of a turn or of a disturbance takes too long.
MIN_GAIN_CORRECTION_RAD2_S: Final = radians(0.08) ** 2
TURNING_RAD: Final = radians(3.0)  # further than this from the goal the boat turns, with a narrower deadband
TURNING_SHARE: Final = 0.1
REDUCED_BIAS_S: Final = 25.0  # time constant of the followed rudder bias per 1 of gain reduction above 1


class LawConstants(NamedTuple):
    """Constants of the law that `rambler-hil tune --law` searches (docs/decisions/0014 has the search).

    `gain_factor` is the proportional gain for a w of 1 rad/sqrt(s) where T / K is 1 s^2, `crossover_rad_s` the upper
    bound of K k. The deadband, as an angle of heading error, is `rest_rad` + `band_sqrt_s` * w.
    """

    gain_factor: float = 136.0
    crossover_rad_s: float = 0.264
    rest_rad: float = 0.00469
    band_sqrt_s: float = 1.94


DEFAULT_CONSTANTS: Final = LawConstants()


class LawSettings(NamedTuple):
    """Model of the vehicle file, rudder limit and trim, price of rudder travel, minimum steering speed, constants."""

    model: KtModel
    limit_rad: float
    trim_rad: float
    price: float
    min_speed_m_s: float
    constants: LawConstants = DEFAULT_CONSTANTS

    @classmethod
    def of(cls, parameters: ParameterSet) -> LawSettings:
        """Read the settings from the parameters."""
        return cls(
            model=KtModel.of(parameters),
            limit_rad=radians(parameters["RUD_LIMIT_DEG"]),
            trim_rad=radians(parameters["CTL_TRIM_DEG"]),
            price=parameters["CTL_PRICE"],
            min_speed_m_s=parameters["CTL_WAY_MIN"],
        )


class Ship(NamedTuple):
    """K-T model at the present speed, with the rudder limit and the rudder bias."""

    turning_ability_1_s: float
    turning_lag_s: float
    norrbin_s2: float
    limit_rad: float
    bias_rad: float


class Reference(NamedTuple):
    """Heading and yaw rate of the reference model, and its rudder angle without the bias."""

    heading_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan
    feedforward_rad: float = 0.0


class LawState(NamedTuple):
    """Reference of the turn, and the rudder bias that is followed while the gain is reduced; NaN: none."""

    reference: Reference = Reference()
    bias_rad: float = math.nan


IDLE: Final = LawState()


class Gains(NamedTuple):
    """k1, k2, the rudder limit, the yaw rate that normalises, and the trim du as an angle."""

    k1: float
    k2: float
    rudder_limit_rad: float
    yaw_rate_max_rad_s: float
    trim_rad: float

    @classmethod
    def of(cls, parameters: ParameterSet) -> Gains:
        """Read the fixed gains from the parameters."""
        limit_rad = radians(parameters["RUD_LIMIT_DEG"])
        return cls(
            k1=parameters["CTL_K1"],
            k2=parameters["CTL_K2"],
            rudder_limit_rad=limit_rad,
            yaw_rate_max_rad_s=steady_yaw_rate(limit_rad, parameters["MDL_K"], parameters["MDL_ALPHA_S2"]),
            trim_rad=radians(parameters["CTL_TRIM_DEG"]),
        )


def s_surface(gains: Gains, heading_error_rad: float, yaw_rate_rad_s: float) -> float:
    """Return the rudder angle [rad] for a heading error in [-pi, pi] and a yaw rate (Wang et al. 2018, eq. 8).

    The logistic form is written as the hyperbolic tangent that it equals, which does not overflow.
    """
    error = heading_error_rad / math.pi
    error_rate = -yaw_rate_rad_s / gains.yaw_rate_max_rad_s
    surface = math.tanh(0.5 * (gains.k1 * error + gains.k2 * error_rate))
    return clamp(gains.rudder_limit_rad * surface + gains.trim_rad, -gains.rudder_limit_rad, gains.rudder_limit_rad)


def stopping_angle(ship: Ship, yaw_rate_rad_s: float, brake_rad: float) -> float:
    """Return the angle [rad] that the boat turns on while a rudder of brake_rad (> 0) against the turn stops it.

    Solution of the linear K-T equation from the yaw rate to zero.
    """
    against_rad_s = ship.turning_ability_1_s * brake_rad
    rate_rad_s = abs(yaw_rate_rad_s)
    angle_rad = ship.turning_lag_s * (rate_rad_s - against_rad_s * math.log1p(rate_rad_s / against_rad_s))
    return math.copysign(angle_rad, yaw_rate_rad_s)


def advance_reference(
    ship: Ship, reference: Reference, error_rad: float, heading_rad: float, step_s: float, gain_reduction: float = 1.0
) -> Reference:
    """Advance the reference by a step towards a goal that lies error_rad from it, with a limited lead over heading_rad.

    The K-T model is steered nearly time-optimally: full rudder until the stopping angle is all that is left, then full
    rudder the other way. Feedback then only has to hold the boat to the reference.
    """
    high_rad = max(ship.limit_rad - ship.bias_rad, MIN_FEEDFORWARD_RAD)
    low_rad = min(-ship.limit_rad - ship.bias_rad, -MIN_FEEDFORWARD_RAD)
    r = reference.yaw_rate_rad_s
    slower_s = (gain_reduction - 1.0) * REDUCED_TURN_S
    share = 1.0 / max(slower_s * ship.turning_ability_1_s * ship.limit_rad / LEAD_RAD, 1.0)
    high_rad, low_rad = high_rad * share, low_rad * share
    brake_rad = BRAKING_SHARE * (high_rad if r < 0.0 else -low_rad)
    left_rad = error_rad - stopping_angle(ship, r, brake_rad)
    feedforward_rad = ship.limit_rad * share * left_rad / EASING_RAD - RATE_GAIN * r / ship.turning_ability_1_s
    feedforward_rad = clamp(feedforward_rad, low_rad, high_rad)
    divisor, cubic, _ = held_cubic(ship.turning_lag_s, ship.norrbin_s2, r, step_s)
    steady, lag_s = (ship.turning_ability_1_s * feedforward_rad - cubic * r) / divisor, ship.turning_lag_s / divisor
    turned_rad, rate_rad_s = exact_step(r, steady, decay_over(step_s, lag_s), step_s, lag_s)
    lead_limit_rad = LEAD_RAD * gain_reduction
    lead_rad = clamp(wrap_pi(reference.heading_rad - heading_rad) + turned_rad, -lead_limit_rad, lead_limit_rad)
    return Reference(wrap_two_pi(heading_rad + lead_rad), rate_rad_s, feedforward_rad)


def ship_at_speed(settings: LawSettings, estimate: HeadingEstimate, bias_rad: float) -> Ship:
    """Return the model at the estimated speed (similarity, paper eq. 7)."""
    ability_1_s, lag_s, norrbin_s2 = scaled(settings.model, estimate.speed_m_s / settings.model.speed_m_s)
    return Ship(
        ability_1_s,
        lag_s,
        norrbin_s2,
        settings.limit_rad,
        clamp(bias_rad + settings.trim_rad, -settings.limit_rad, settings.limit_rad),
    )


def proportional_gain(
    ship: Ship, correction_rad2_s: float, price: float, constants: LawConstants = DEFAULT_CONSTANTS
) -> float:
    """Return the rudder angle per angle of heading error."""
    walk_rad = math.sqrt(clamp(correction_rad2_s, MIN_GAIN_CORRECTION_RAD2_S, CORRECTIONS_RAD2_S[1]) / price)
    by_ship = math.exp(3.0 / 7.0 * math.log1p(ship.turning_lag_s / ship.turning_ability_1_s - 1.0))
    return min(constants.gain_factor * walk_rad * by_ship, constants.crossover_rad_s / ship.turning_ability_1_s)


def reduced_gain(
    gain: float,
    gain_reduction: float,
    estimated_1_s: float,
    nominal_1_s: float,
    constants: LawConstants = DEFAULT_CONSTANTS,
) -> float:
    """Return the proportional gain with its upper bound lowered by the gain reduction.

    The estimate of a boat that oscillates is off, and may have lost most of its speed: the larger of the estimated and
    the nominal turning ability sets the bound.
    """
    return min(gain, constants.crossover_rad_s / (gain_reduction * max(estimated_1_s, nominal_1_s)))


def deadband(correction_rad2_s: float, gain: float, price: float, constants: LawConstants = DEFAULT_CONSTANTS) -> float:
    """Return the half-width of the deadband [rad], in which the command does not follow the demand."""
    walk_rad = constants.band_sqrt_s * math.sqrt(clamp(correction_rad2_s, CORRECTIONS_RAD2_S[0], CORRECTIONS_RAD2_S[1]))
    return gain * math.sqrt(price) * (constants.rest_rad + walk_rad)


def gains_of(ship: Ship, gain: float) -> Gains:
    """Return the S-surface that is, for small errors, the optimal regulator of that proportional gain."""
    rate_gain_s = (math.sqrt(1.0 + 2.0 * ship.turning_ability_1_s * ship.turning_lag_s * gain) - 1.0) / (
        ship.turning_ability_1_s
    )
    rate_max_rad_s = steady_yaw_rate(ship.limit_rad, ship.turning_ability_1_s, ship.norrbin_s2)
    return Gains(
        2.0 * math.pi * gain / ship.limit_rad,
        2.0 * rate_gain_s * rate_max_rad_s / ship.limit_rad,
        ship.limit_rad,
        rate_max_rad_s,
        0.0,
    )


def followed_bias(bias_rad: float, estimate: HeadingEstimate, step_s: float, gain_reduction: float) -> float:
    """Return the rudder bias that is followed while the gain is reduced; NaN at full gain.

    It starts at the mean if that is nearer amidships. The estimate oscillates with the boat by as much as 14 deg, and a
    reduced gain that started there would keep the boat as far off its goal for ten minutes.
    """
    if gain_reduction <= 1.0:
        return math.nan
    if math.isnan(bias_rad):
        mean_is_nearer = abs(estimate.bias_mean_rad) < abs(estimate.bias_rad)
        return estimate.bias_mean_rad if mean_is_nearer else estimate.bias_rad
    part = -math.expm1(-step_s / (REDUCED_BIAS_S * (gain_reduction - 1.0)))
    return bias_rad + part * (estimate.bias_rad - bias_rad)


def without_way(settings: LawSettings, estimate: HeadingEstimate, error_rad: float) -> bool:
    """Return whether the rudder stays where it is, because the boat is at the goal and too slow for it to act.

    Off the goal there is a demand at any speed: even little way turns the boat, and a rudder that is released and used
    again as the estimated speed varies about the minimum travels more, and turns the boat later, than one kept at its
    limit.
    """
    slow = estimate.speed_m_s + estimate.speed_sd_m_s < settings.min_speed_m_s
    return slow and abs(error_rad) <= TURNING_RAD


def demand(
    settings: LawSettings,
    reference: Reference,
    estimate: HeadingEstimate,
    bias_rad: float,
    error_rad: float,
    step_s: float,
    gain_reduction: float = 1.0,
) -> tuple[Reference, float, float]:
    """Advance the reference; return it with the rudder demand [rad] and the deadband about it [rad].

    error_rad is the goal less the estimated heading.
    """
    ship = ship_at_speed(settings, estimate, bias_rad)
    # An error of half a turn is a turn that was commanded the long way: it must not wrap.
    left_rad = error_rad - wrap_pi(reference.heading_rad - estimate.heading_rad)
    if abs(error_rad) < math.pi:
        left_rad = wrap_pi(left_rad)
    reference = advance_reference(ship, reference, left_rad, estimate.heading_rad, step_s, gain_reduction)
    gain = proportional_gain(ship, estimate.correction_rad2_s, settings.price, settings.constants)
    if gain_reduction > 1.0:
        nominal_1_s = settings.model.turning_ability_1_s
        gain = reduced_gain(gain, gain_reduction, ship.turning_ability_1_s, nominal_1_s, settings.constants)
    off_rad = wrap_pi(reference.heading_rad - estimate.heading_rad)
    feedback_rad = s_surface(gains_of(ship, gain), off_rad, estimate.yaw_rate_rad_s - reference.yaw_rate_rad_s)
    demand_rad = ship.bias_rad + reference.feedforward_rad + feedback_rad
    band_rad = deadband(estimate.correction_rad2_s, gain, settings.price, settings.constants)
    if abs(left_rad) > TURNING_RAD:
        band_rad *= TURNING_SHARE
    return reference, clamp(demand_rad, -settings.limit_rad, settings.limit_rad), band_rad


def steer(
    settings: LawSettings,
    state: LawState,
    estimate: HeadingEstimate,
    error_rad: float,
    command_rad: float,
    step_s: float,
    gain_reduction: float,
) -> tuple[LawState, float]:
    """Return the state and the rudder demand [rad] of a tick: unmoved within the deadband, at its edge otherwise.

    error_rad is the goal less the estimated heading, command_rad the rudder command of the tick before. A deadband is
    the best rule for a rudder that follows a wandering demand where each degree of rudder travel has the same price.
    """
    kept_bias_rad = followed_bias(state.bias_rad, estimate, step_s, gain_reduction)
    reference = state.reference
    stopped = without_way(settings, estimate, error_rad)
    if stopped or math.isnan(reference.heading_rad):
        reference = Reference(estimate.heading_rad, estimate.yaw_rate_rad_s, 0.0)
    if stopped:
        return LawState(reference, kept_bias_rad), command_rad
    bias_rad = estimate.bias_rad if math.isnan(kept_bias_rad) else kept_bias_rad
    reference, demand_rad, band_rad = demand(settings, reference, estimate, bias_rad, error_rad, step_s, gain_reduction)
    return LawState(reference, kept_bias_rad), clamp(command_rad, demand_rad - band_rad, demand_rad + band_rad)
