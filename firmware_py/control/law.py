"""Heading control law: an S-surface with scheduled gains that follows a reference model.

Numeric core: functions without I/O; NaN: absent. Python runs this code on the boat, and the laboratory compiles it
unchanged (hil/lab/numeric_core.py). Both give the same result to the last bit.

S-surface (Wang et al. 2018, eq. 8):

    u = 2 / (1 + exp(-(k1 * e + k2 * edot))) - 1 + du          rudder = delta_max * clamp(u, -1, 1)

with the normalisation e = error / pi, edot = -r / r_max, where r_max is the steady yaw rate at delta_max. The paper
does not state its normalisation.

Gains: the rudder that minimises the integral of error^2 + (rudder / k)^2 on the K-T model has the proportional gain k
and the rate gain of `gains_of` (algebraic Riccati equation), at any speed.

Proportional gain and deadband: the updates of the filter change the estimated heading by a variance of
`correction_rad2_s` per second, the square of Kalman gain times innovation. By the Riccati equation it is twice the
covariance of heading and yaw rate, because the heading itself has no process noise. Let w be its root. With the
proportional gain k, the variance of the heading error is proportional to w^2 sqrt(T / (K k)), the inverse of the
frequency of the loop, and the demand is a random walk with the rate k w. A rudder that moves only at the edge of a
deadband of half-width b follows the demand with a travel of (k w)^2 / 2b per second (reflected random walk), and the
deadband adds a variance proportional to b^4. With a weight on rudder travel, the minimum of the sum has k proportional
to (T / K)^(3/7) and to a power of w, and b equal to k times a heading error that grows with w. The power of w is 4/7
with a varying rudder bias. Calm water, where the bias is constant, needs a lower gain: the law uses the power 1.

Stability: the rate gain compensates T, so the crossover frequency is about K k [rad/s] for any T, and the loop
tolerates a delay of (pi / 2) / (K k). `crossover_rad_s` limits K k, so that the delay margin is 5.9 s at any weight; a
float with a natural frequency of 0.3 rad/s uses 4 s of it.

Gain reduction, after a detected limit cycle, lowers the gains of the closed loop: the proportional gain, the deadband
in proportion to it (a wider one would cause oscillations of a boat that responds later than its model), and the rate at
which the rudder bias follows its estimate, which oscillates with the boat. The feedforward rudder is outside the loop:
a boat that responds late makes the same turn later. The reference is inside the loop if its lead is limited. So the
limit is raised, and the reference turns more slowly, because a reference far ahead keeps the boat turning while the
reference brakes.
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
EASING_RAD: Final = radians(5.6)  # below this remaining angle the rudder is proportional to it
BRAKING_SHARE: Final = 0.8  # share of the rudder limit in the calculation of the stopping angle
RATE_GAIN: Final = 0.55  # share of the rudder for a steady yaw rate; damps the end of the turn
MIN_FEEDFORWARD_RAD: Final = radians(5.0)  # so that the boat can turn even with a wrong rudder bias
LEAD_RAD: Final = radians(6.0)  # maximum lead of the reference over the boat
REDUCED_TURN_S: Final = 1.2  # minimum time in which the reference turns by LEAD_RAD, per 1 of gain reduction above 1

# Scheduled gains.
CORRECTIONS_RAD2_S: Final = (radians(0.01) ** 2, radians(1.5) ** 2)  # limits of w^2
# Lower limit for the proportional gain only: with a lower gain, the end of a turn or of a disturbance takes too long.
MIN_GAIN_CORRECTION_RAD2_S: Final = radians(0.08) ** 2
TURNING_RAD: Final = radians(3.0)  # with a larger remaining angle, the deadband is multiplied by TURNING_SHARE
TURNING_SHARE: Final = 0.1
REDUCED_BIAS_S: Final = 25.0  # time constant of the rudder bias per 1 of gain reduction above 1


class LawConstants(NamedTuple):
    """Constants of the law, as found by `rambler-hil tune --law` (docs/decisions/0014).

    `gain_factor` is the proportional gain for w = 1 rad/sqrt(s) and T / K = 1 s^2, `crossover_rad_s` the upper limit of
    K k. The deadband, as a heading error, is `rest_rad` + `band_sqrt_s` * w. Gain and deadband are for travel weight 1.
    """

    gain_factor: float = 136.0
    crossover_rad_s: float = 0.264
    rest_rad: float = 0.00469
    band_sqrt_s: float = 1.94


DEFAULT_CONSTANTS: Final = LawConstants()


class LawSettings(NamedTuple):
    """K-T model, rudder limit and trim, weight of rudder travel, minimum steering speed, constants."""

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
    """K-T model at the present speed, rudder limit and rudder bias."""

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
    """Reference of the turn, and the filtered rudder bias while the gain is reduced (NaN: it is not reduced)."""

    reference: Reference = Reference()
    bias_rad: float = math.nan


IDLE: Final = LawState()


class Gains(NamedTuple):
    """Gains k1 and k2, rudder limit, yaw rate r_max of the normalisation, and trim du as an angle."""

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

    The logistic function is written as a hyperbolic tangent, which does not overflow.
    """
    error = heading_error_rad / math.pi
    error_rate = -yaw_rate_rad_s / gains.yaw_rate_max_rad_s
    surface = math.tanh(0.5 * (gains.k1 * error + gains.k2 * error_rate))
    return clamp(gains.rudder_limit_rad * surface + gains.trim_rad, -gains.rudder_limit_rad, gains.rudder_limit_rad)


def stopping_angle(ship: Ship, yaw_rate_rad_s: float, brake_rad: float) -> float:
    """Return the angle [rad] that the boat turns until a rudder of brake_rad (> 0) against the turn has stopped it.

    It is the solution of the linear K-T equation from this yaw rate to zero.
    """
    brake_rate_rad_s = ship.turning_ability_1_s * brake_rad
    rate_rad_s = abs(yaw_rate_rad_s)
    angle_rad = ship.turning_lag_s * (rate_rad_s - brake_rate_rad_s * math.log1p(rate_rad_s / brake_rate_rad_s))
    return math.copysign(angle_rad, yaw_rate_rad_s)


def advance_reference(
    ship: Ship, reference: Reference, error_rad: float, heading_rad: float, step_s: float, gain_reduction: float
) -> Reference:
    """Advance the reference by a step towards a goal that is error_rad from it, with a limited lead over heading_rad.

    The reference turns in nearly the shortest time: full rudder until the remaining angle is the stopping angle, then
    full rudder in the opposite direction.
    """
    max_rad = max(ship.limit_rad - ship.bias_rad, MIN_FEEDFORWARD_RAD)
    min_rad = min(-ship.limit_rad - ship.bias_rad, -MIN_FEEDFORWARD_RAD)
    r = reference.yaw_rate_rad_s
    turn_time_s = (gain_reduction - 1.0) * REDUCED_TURN_S
    share = 1.0 / max(turn_time_s * ship.turning_ability_1_s * ship.limit_rad / LEAD_RAD, 1.0)
    max_rad, min_rad = max_rad * share, min_rad * share
    brake_rad = BRAKING_SHARE * (max_rad if r < 0.0 else -min_rad)
    remaining_rad = error_rad - stopping_angle(ship, r, brake_rad)
    feedforward_rad = ship.limit_rad * share * remaining_rad / EASING_RAD - RATE_GAIN * r / ship.turning_ability_1_s
    feedforward_rad = clamp(feedforward_rad, min_rad, max_rad)
    divisor, cubic, _ = held_cubic(ship.turning_lag_s, ship.norrbin_s2, r, step_s)
    steady_rad_s, lag_s = (
        (ship.turning_ability_1_s * feedforward_rad - cubic * r) / divisor,
        ship.turning_lag_s / divisor,
    )
    turned_rad, rate_rad_s = exact_step(r, steady_rad_s, decay_over(step_s, lag_s), step_s, lag_s)
    max_lead_rad = LEAD_RAD * gain_reduction
    lead_rad = clamp(wrap_pi(reference.heading_rad - heading_rad) + turned_rad, -max_lead_rad, max_lead_rad)
    return Reference(wrap_two_pi(heading_rad + lead_rad), rate_rad_s, feedforward_rad)


def ship_at_speed(settings: LawSettings, estimate: HeadingEstimate, bias_rad: float) -> Ship:
    """Return the K-T model at the estimated speed (similarity, paper eq. 7)."""
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
    """Return the proportional gain: rudder angle per heading error."""
    walk_rad_sqrt_s = math.sqrt(clamp(correction_rad2_s, MIN_GAIN_CORRECTION_RAD2_S, CORRECTIONS_RAD2_S[1]) / price)
    model_factor = math.exp(3.0 / 7.0 * math.log1p(ship.turning_lag_s / ship.turning_ability_1_s - 1.0))
    return min(
        constants.gain_factor * walk_rad_sqrt_s * model_factor, constants.crossover_rad_s / ship.turning_ability_1_s
    )


def reduced_gain(
    gain: float,
    gain_reduction: float,
    estimated_1_s: float,
    nominal_1_s: float,
    constants: LawConstants = DEFAULT_CONSTANTS,
) -> float:
    """Return the proportional gain with its upper limit lowered by the gain reduction.

    The limit is that of the larger of the estimated and the nominal turning ability, because the estimated speed may be
    far too low while the boat oscillates.
    """
    return min(gain, constants.crossover_rad_s / (gain_reduction * max(estimated_1_s, nominal_1_s)))


def deadband(correction_rad2_s: float, gain: float, price: float, constants: LawConstants = DEFAULT_CONSTANTS) -> float:
    """Return the half-width of the deadband [rad], in which the command does not follow the demand."""
    walk_rad = constants.band_sqrt_s * math.sqrt(clamp(correction_rad2_s, CORRECTIONS_RAD2_S[0], CORRECTIONS_RAD2_S[1]))
    return gain * math.sqrt(price) * (constants.rest_rad + walk_rad)


def gains_of(ship: Ship, gain: float) -> Gains:
    """Return the gains of the S-surface that is the optimal regulator with this proportional gain for small errors."""
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


def update_reduced_bias(bias_rad: float, estimate: HeadingEstimate, step_s: float, gain_reduction: float) -> float:
    """Return the low-pass filtered rudder bias for a reduced gain; NaN without gain reduction.

    It starts at the mean bias if that is smaller than the estimate. The estimate oscillates with the boat by up to
    14 deg; from such a start, the reduced gain would cause a heading error of that size for ten minutes.
    """
    if gain_reduction <= 1.0:
        return math.nan
    if math.isnan(bias_rad):
        is_mean_smaller = abs(estimate.bias_mean_rad) < abs(estimate.bias_rad)
        return estimate.bias_mean_rad if is_mean_smaller else estimate.bias_rad
    gain = -math.expm1(-step_s / (REDUCED_BIAS_S * (gain_reduction - 1.0)))
    return bias_rad + gain * (estimate.bias_rad - bias_rad)


def is_too_slow(settings: LawSettings, estimate: HeadingEstimate, error_rad: float) -> bool:
    """Return whether the rudder command stays the same, because the boat is at the goal and too slow to respond.

    Away from the goal there is a demand at any speed, because even a slow boat turns. A rudder that started and stopped
    while the estimated speed varies about the minimum would travel more, and turn the boat later.
    """
    has_low_speed = estimate.speed_m_s + estimate.speed_sd_m_s < settings.min_speed_m_s
    return has_low_speed and abs(error_rad) <= TURNING_RAD


def demand(
    settings: LawSettings,
    reference: Reference,
    estimate: HeadingEstimate,
    bias_rad: float,
    error_rad: float,
    step_s: float,
    gain_reduction: float,
) -> tuple[Reference, float, float]:
    """Advance the reference; return it, the rudder demand [rad] and the half-width of the deadband about it [rad].

    `error_rad` is the goal minus the estimated heading.
    """
    ship = ship_at_speed(settings, estimate, bias_rad)
    # A commanded turn of more than half a circle has an error of pi, and must not be wrapped.
    remaining_rad = error_rad - wrap_pi(reference.heading_rad - estimate.heading_rad)
    if abs(error_rad) < math.pi:
        remaining_rad = wrap_pi(remaining_rad)
    reference = advance_reference(ship, reference, remaining_rad, estimate.heading_rad, step_s, gain_reduction)
    gain = proportional_gain(ship, estimate.correction_rad2_s, settings.price, settings.constants)
    if gain_reduction > 1.0:
        nominal_1_s = settings.model.turning_ability_1_s
        gain = reduced_gain(gain, gain_reduction, ship.turning_ability_1_s, nominal_1_s, settings.constants)
    reference_error_rad = wrap_pi(reference.heading_rad - estimate.heading_rad)
    feedback_rad = s_surface(
        gains_of(ship, gain), reference_error_rad, estimate.yaw_rate_rad_s - reference.yaw_rate_rad_s
    )
    demand_rad = ship.bias_rad + reference.feedforward_rad + feedback_rad
    deadband_rad = deadband(estimate.correction_rad2_s, gain, settings.price, settings.constants)
    if abs(remaining_rad) > TURNING_RAD:
        deadband_rad *= TURNING_SHARE
    return reference, clamp(demand_rad, -settings.limit_rad, settings.limit_rad), deadband_rad


def steer(
    settings: LawSettings,
    state: LawState,
    estimate: HeadingEstimate,
    error_rad: float,
    command_rad: float,
    step_s: float,
    gain_reduction: float,
) -> tuple[LawState, float]:
    """Return the state and the rudder demand [rad] of a tick, after the deadband about the command.

    `error_rad` is the goal minus the estimated heading, `command_rad` the rudder command of the previous tick. For a
    demand that is a random walk, a deadband is optimal if each degree of rudder travel has the same cost.
    """
    reduced_bias_rad = update_reduced_bias(state.bias_rad, estimate, step_s, gain_reduction)
    reference = state.reference
    is_stopped = is_too_slow(settings, estimate, error_rad)
    if is_stopped or math.isnan(reference.heading_rad):
        reference = Reference(estimate.heading_rad, estimate.yaw_rate_rad_s, 0.0)
    if is_stopped:
        return LawState(reference, reduced_bias_rad), command_rad
    bias_rad = estimate.bias_rad if math.isnan(reduced_bias_rad) else reduced_bias_rad
    reference, demand_rad, deadband_rad = demand(
        settings, reference, estimate, bias_rad, error_rad, step_s, gain_reduction
    )
    return LawState(reference, reduced_bias_rad), clamp(
        command_rad, demand_rad - deadband_rad, demand_rad + deadband_rad
    )
