"""Twin of firmware_py/control/scheduled.py, reference_model.py and rudder_limit.py, for helms side by side.

`stiffness_of` and `band_of` are the law; what it is made of stands in LAW, in the order of the names beside it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from firmware_py.common.angles import radians
from firmware_py.model.kt import decay_over, exact_step
from hil.lab.compiled import compiled
from hil.lab.lane_math import fails, least, most, within, wrap_pi, wrap_two_pi
from hil.lab.lanes import any_of, where

# The helm's constants, and parameters: what a run is given.
LAW_NAMES = (
    "STIFFNESS", "CROSSOVER_RAD_S", "REST_RAD", "BAND_SQRT_S", "TURNING_RAD", "TURNING_SHARE", "SLOWER_BIAS_S",
    "EASING_RAD", "BRAKING_SHARE", "RATE_GAIN", "LEAST_FEEDFORWARD_RAD", "LEAD_RAD",
    "SLOWER_TURN_S", "CTL_PRICE", "CTL_WAY_MIN",
)  # fmt: skip
(STIFFNESS, CROSSOVER_RAD_S, REST_RAD, BAND_SQRT_S, TURNING_RAD, TURNING_SHARE, SLOWER_BIAS_S,
 EASING_RAD, BRAKING_SHARE, RATE_GAIN, LEAST_FEEDFORWARD_RAD, LEAD_RAD, SLOWER_TURN_S, PRICE,
 WAY_MIN) = range(15)  # fmt: skip
# As delivered, the parameters apart, which come last.
DELIVERED = (
    136.0,
    0.264,
    0.00469,
    1.94,
    radians(3.0),
    0.1,
    25.0,
    radians(5.6),
    0.8,
    0.55,
    radians(5.0),
    radians(6.0),
    1.2,
)
CORRECTIONS_RAD2_S = (radians(0.01) ** 2, radians(1.5) ** 2)
SOFTEST_RAD2_S = radians(0.08) ** 2

# What the helm knows in a tick.
(E_HEADING, E_CORRECTION, E_RATE, E_BIAS, E_SPEED, E_SPEED_SD, E_FACTOR,
 M_K, M_T, M_ALPHA, M_SPEED, LIMIT, TRIM, E_HEADING_SD, E_BIAS_MEAN) = range(15)  # fmt: skip
KNOWN = 15
# What it remembers; NaN stands for None.
REF_HEADING, REF_RATE, FEEDFORWARD, FOLLOWED_BIAS = range(4)
HELM_STATES = 4
Lanes = Any  # or a number
Rows = Any  # side by side, or the numbers of one
NEWTON_STEPS = 100


@compiled
def walk_of(correction_rad2_s: Lanes) -> Lanes:
    """Return the variance [rad^2/s] by which the estimate is corrected, within bounds."""
    return within(correction_rad2_s, CORRECTIONS_RAD2_S[0], CORRECTIONS_RAD2_S[1])


@compiled
def stiffness_of(law: Rows, ability_1_s: Lanes, lag_s: Lanes, correction_rad2_s: Lanes) -> Lanes:
    """Return the rudder angle per angle of heading error (stiffness.py)."""
    walk_rad = math.sqrt(within(correction_rad2_s, SOFTEST_RAD2_S, CORRECTIONS_RAD2_S[1]) / law[PRICE])
    by_ship = math.exp(3.0 / 7.0 * math.log1p(lag_s / ability_1_s - 1.0))
    return least(law[STIFFNESS] * walk_rad * by_ship, law[CROSSOVER_RAD_S] / ability_1_s)


@compiled
def softened(law: Rows, stiffness: Lanes, softness: Lanes, found_1_s: Lanes, told_1_s: Lanes) -> Lanes:
    """Return the stiffness of helms whose crossover is bounded lower where they are softened (stiffness.py)."""
    if not any_of(softness > 1.0):
        return stiffness
    soft = least(stiffness, law[CROSSOVER_RAD_S] / (softness * most(found_1_s, told_1_s)))
    return where(softness > 1.0, soft, stiffness)


@compiled
def band_of(law: Rows, correction_rad2_s: Lanes, stiffness: Lanes) -> Lanes:
    """Return how far the demand may leave the command."""
    walk_rad = law[BAND_SQRT_S] * math.sqrt(walk_of(correction_rad2_s))
    return stiffness * math.sqrt(law[PRICE]) * (law[REST_RAD] + walk_rad)


@compiled
def steady_yaw_rate(rudder_rad: Lanes, ability_1_s: Lanes, norrbin_s2: Lanes) -> Lanes:
    """Solve r + alpha r^3 = K delta for r [rad/s] (firmware_py.model.kt.steady_yaw_rate)."""
    drive_rad_s = ability_1_s * rudder_rad
    rate_rad_s, going, number = drive_rad_s, norrbin_s2 > 0.0, 0
    while number < NEWTON_STEPS and any_of(going):
        residual = rate_rad_s + norrbin_s2 * rate_rad_s * rate_rad_s * rate_rad_s - drive_rad_s
        step = residual / (1.0 + 3.0 * norrbin_s2 * rate_rad_s * rate_rad_s)
        rate_rad_s = where(going, rate_rad_s - step, rate_rad_s)
        going = going & fails(abs(step) <= 1e-15 * (abs(rate_rad_s) + 1e-12))
        number += 1
    return rate_rad_s


@compiled
def rudder_demand(
    error_rad: Lanes, yaw_rate_rad_s: Lanes, k1: Lanes, k2: Lanes, limit_rad: Lanes, rate_max_rad_s: Lanes
) -> Lanes:
    """Return the S-surface's rudder angle (firmware_py.control.s_surface.rudder_demand) without a trim."""
    error, error_rate = error_rad / math.pi, -yaw_rate_rad_s / rate_max_rad_s
    surface = math.tanh(0.5 * (k1 * error + k2 * error_rate))
    return within(limit_rad * surface + 0.0, -limit_rad, limit_rad)


@compiled
def limited_command(
    command_rad: Lanes, demand_rad: Lanes, step_s: Lanes, limit_rad: Lanes, slew_rad_s: Lanes, deadband_rad: Lanes
) -> Lanes:
    """Return the next rudder command (firmware_py.control.rudder_limit.limited_command)."""
    change_rad = within(demand_rad, -limit_rad, limit_rad) - command_rad
    reach_rad = slew_rad_s * step_s
    moved_rad = command_rad + within(change_rad, -reach_rad, reach_rad)
    return where(abs(change_rad) < deadband_rad, within(command_rad, -limit_rad, limit_rad), moved_rad)


@compiled
def turning_share(law: Rows, ability: Lanes, limit_rad: Lanes, softness: Lanes) -> Lanes:
    """Return to what part a softened helm slows its turns down; 1, which is its softness, for one that is not."""
    if not any_of(softness > 1.0):
        return softness
    return 1.0 / most((softness - 1.0) * law[SLOWER_TURN_S] * ability * limit_rad / law[LEAD_RAD], 1.0)


@compiled
def advance_reference(
    law: Rows, state: Rows, ability: Lanes, lag_s: Lanes, norrbin: Lanes, limit_rad: Lanes, bias_rad: Lanes,
    error_rad: Lanes, heading_rad: Lanes, step_s: Lanes, softness: Lanes,
) -> tuple[Lanes, Lanes, Lanes]:  # fmt: skip
    """Return the reference carried over a step toward a goal that lies error_rad from it (reference_model.update)."""
    least_rad, lead_most_rad = law[LEAST_FEEDFORWARD_RAD], law[LEAD_RAD] * softness
    share = turning_share(law, ability, limit_rad, softness)
    high_rad = most(limit_rad - bias_rad, least_rad) * share
    low_rad = least(-limit_rad - bias_rad, -least_rad) * share
    r = state[REF_RATE]
    brake_rad = law[BRAKING_SHARE] * where(r < 0.0, high_rad, -low_rad)
    against_rad_s = ability * brake_rad
    rate_rad_s = abs(r)
    stopping_rad = math.copysign(lag_s * (rate_rad_s - against_rad_s * math.log1p(rate_rad_s / against_rad_s)), r)
    left_rad = error_rad - stopping_rad
    feedforward_rad = limit_rad * share * left_rad / law[EASING_RAD] - law[RATE_GAIN] * r / ability
    feedforward_rad = within(feedforward_rad, low_rad, high_rad)
    steady = ability * feedforward_rad - norrbin * r * r * r
    decay = decay_over(step_s, lag_s)
    turned_rad, new_rate_rad_s = exact_step(r, steady, decay, step_s, lag_s)
    lead_rad = within(wrap_pi(state[REF_HEADING] - heading_rad) + turned_rad, -lead_most_rad, lead_most_rad)
    return wrap_two_pi(heading_rad + lead_rad), new_rate_rad_s, feedforward_rad


@compiled
def follow_bias(law: Rows, state: Rows, bias_rad: Lanes, mean_rad: Lanes, step_s: Lanes, softness: Lanes) -> Lanes:
    """Return the bias that the helm counts with, which a soft one follows slowly, from the mean on if that is less."""
    if not any_of(softness > 1.0):
        state[FOLLOWED_BIAS] = np.nan
        return bias_rad
    part = -math.expm1(-step_s / (law[SLOWER_BIAS_S] * (softness - 1.0)))
    before_rad = state[FOLLOWED_BIAS]
    first_rad = where(abs(mean_rad) < abs(bias_rad), mean_rad, bias_rad)
    followed_rad = where(math.isnan(before_rad), first_rad, before_rad + part * (bias_rad - before_rad))
    state[FOLLOWED_BIAS] = where(softness <= 1.0, np.nan, followed_rad)
    return where(softness <= 1.0, bias_rad, followed_rad)


@compiled
def steer(
    law: Rows, state: Rows, e: Rows, error_rad: Lanes, command_rad: Lanes, step_s: Lanes, softness: Lanes
) -> Lanes:
    """Return the rudder asked for (scheduled.update)."""
    e[E_BIAS] = follow_bias(law, state, e[E_BIAS], e[E_BIAS_MEAN], step_s, softness)
    stopped = (e[E_SPEED] + e[E_SPEED_SD] < law[WAY_MIN]) & (abs(error_rad) <= law[TURNING_RAD])
    anew = stopped | math.isnan(state[REF_HEADING])
    state[REF_HEADING] = where(anew, e[E_HEADING], state[REF_HEADING])
    state[REF_RATE] = where(anew, e[E_RATE], state[REF_RATE])
    state[FEEDFORWARD] = where(anew, 0.0, state[FEEDFORWARD])
    ratio = e[E_SPEED] / e[M_SPEED]
    ability, lag_s, norrbin = e[M_K] * ratio * e[E_FACTOR], e[M_T] / ratio, e[M_ALPHA] / (ratio * ratio)
    limit_rad = e[LIMIT]
    bias_rad = within(e[E_BIAS] + e[TRIM], -limit_rad, limit_rad)
    left_rad = error_rad - wrap_pi(state[REF_HEADING] - e[E_HEADING])
    left_rad = where(abs(error_rad) < math.pi, wrap_pi(left_rad), left_rad)
    reference = advance_reference(
        law, state, ability, lag_s, norrbin, limit_rad, bias_rad, left_rad, e[E_HEADING], step_s, softness
    )
    state[REF_HEADING] = where(stopped, state[REF_HEADING], reference[0])
    state[REF_RATE] = where(stopped, state[REF_RATE], reference[1])
    state[FEEDFORWARD] = where(stopped, state[FEEDFORWARD], reference[2])
    stiffness = softened(law, stiffness_of(law, ability, lag_s, e[E_CORRECTION]), softness, ability, e[M_K])
    off_rad = wrap_pi(state[REF_HEADING] - e[E_HEADING])
    rate_gain_s = (math.sqrt(1.0 + 2.0 * ability * lag_s * stiffness) - 1.0) / ability
    rate_max_rad_s = steady_yaw_rate(limit_rad, ability, norrbin)
    k1, k2 = 2.0 * math.pi * stiffness / limit_rad, 2.0 * rate_gain_s * rate_max_rad_s / limit_rad
    feedback_rad = rudder_demand(off_rad, e[E_RATE] - state[REF_RATE], k1, k2, limit_rad, rate_max_rad_s)
    demand_rad = bias_rad + state[FEEDFORWARD] + feedback_rad
    band_rad = band_of(law, e[E_CORRECTION], stiffness)
    band_rad = where(abs(left_rad) > law[TURNING_RAD], band_rad * law[TURNING_SHARE], band_rad)
    demand_rad = within(demand_rad, -limit_rad, limit_rad)
    return where(stopped, command_rad, within(command_rad, demand_rad - band_rad, demand_rad + band_rad))
