"""The heading controller (firmware_py/control/scheduled.py, reference_model.py, rudder_limit.py) for compiled code.

`stiffness_of` and `band_of` are the law; its numbers stand in an array, in the order of LAW_NAMES.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, wrap_pi, wrap_two_pi
from firmware_py.model.kt import decay_over, exact_step, steady_yaw_rate
from hil.lab.compiled import compiled
from hil.lab.numeric_core import law
from hil.lab.twin.kalman import Floats

# The controller's constants, and parameters: what a run is given.
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
    *law.DELIVERED,
    law.TURNING_RAD,
    law.TURNING_SHARE,
    law.REDUCED_BIAS_S,
    law.EASING_RAD,
    law.BRAKING_SHARE,
    law.RATE_GAIN,
    law.MIN_FEEDFORWARD_RAD,
    law.LEAD_RAD,
    law.REDUCED_TURN_S,
)
CORRECTIONS_RAD2_S = law.CORRECTIONS_RAD2_S
SOFTEST_RAD2_S = law.MIN_GAIN_CORRECTION_RAD2_S

# What is known in a tick.
(E_HEADING, E_CORRECTION, E_RATE, E_BIAS, E_SPEED, E_SPEED_SD, E_FACTOR,
 M_K, M_T, M_ALPHA, M_SPEED, LIMIT, TRIM, E_HEADING_SD, E_BIAS_MEAN) = range(15)  # fmt: skip
KNOWN = 15
# Its state; NaN stands for None.
REF_HEADING, REF_RATE, FEEDFORWARD, FOLLOWED_BIAS = range(4)
HELM_STATES = 4


@compiled
def walk_of(correction_rad2_s: float) -> float:
    """Return the variance [rad^2/s] by which the estimate is corrected, within bounds."""
    return clamp(correction_rad2_s, CORRECTIONS_RAD2_S[0], CORRECTIONS_RAD2_S[1])


@compiled
def stiffness_of(law: Floats, ability_1_s: float, lag_s: float, correction_rad2_s: float) -> float:
    """Return the rudder angle per angle of heading error (stiffness.py)."""
    walk_rad = math.sqrt(clamp(correction_rad2_s, SOFTEST_RAD2_S, CORRECTIONS_RAD2_S[1]) / law[PRICE])
    by_ship = math.exp(3.0 / 7.0 * math.log1p(lag_s / ability_1_s - 1.0))
    return float(min(law[STIFFNESS] * walk_rad * by_ship, law[CROSSOVER_RAD_S] / ability_1_s))


@compiled
def softened(law: Floats, stiffness: float, softness: float, found_1_s: float, told_1_s: float) -> float:
    """Return the stiffness bounded by a lower crossover where the gain is reduced (stiffness.py)."""
    if softness > 1.0:
        return float(min(stiffness, law[CROSSOVER_RAD_S] / (softness * max(found_1_s, told_1_s))))
    return stiffness


@compiled
def band_of(law: Floats, correction_rad2_s: float, stiffness: float) -> float:
    """Return how far the demand may leave the command."""
    walk_rad = law[BAND_SQRT_S] * math.sqrt(walk_of(correction_rad2_s))
    return float(stiffness * math.sqrt(law[PRICE]) * (law[REST_RAD] + walk_rad))


@compiled
def rudder_demand(
    error_rad: float, yaw_rate_rad_s: float, k1: float, k2: float, limit_rad: float, rate_max_rad_s: float
) -> float:
    """Return the S-surface's rudder angle (firmware_py.control.s_surface.rudder_demand) without a trim."""
    error, error_rate = error_rad / math.pi, -yaw_rate_rad_s / rate_max_rad_s
    surface = math.tanh(0.5 * (k1 * error + k2 * error_rate))
    return clamp(limit_rad * surface + 0.0, -limit_rad, limit_rad)


@compiled
def limited_command(
    command_rad: float, demand_rad: float, step_s: float, limit_rad: float, slew_rad_s: float, deadband_rad: float
) -> float:
    """Return the next rudder command (firmware_py.control.rudder_limit.limited_command)."""
    change_rad = clamp(demand_rad, -limit_rad, limit_rad) - command_rad
    reach_rad = slew_rad_s * step_s
    moved_rad = command_rad + clamp(change_rad, -reach_rad, reach_rad)
    return clamp(command_rad, -limit_rad, limit_rad) if abs(change_rad) < deadband_rad else moved_rad


@compiled
def turning_share(law: Floats, ability: float, limit_rad: float, softness: float) -> float:
    """Return to what part a reduced gain slows the turns down."""
    if not softness > 1.0:
        return 1.0
    return float(1.0 / max((softness - 1.0) * law[SLOWER_TURN_S] * ability * limit_rad / law[LEAD_RAD], 1.0))


@compiled
def advance_reference(
    law: Floats, state: Floats, ability: float, lag_s: float, norrbin: float, limit_rad: float, bias_rad: float,
    error_rad: float, heading_rad: float, step_s: float, softness: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the reference carried over a step toward a goal that lies error_rad from it (reference_model.update)."""
    least_rad, lead_most_rad = law[LEAST_FEEDFORWARD_RAD], law[LEAD_RAD] * softness
    share = turning_share(law, ability, limit_rad, softness)
    high_rad = max(limit_rad - bias_rad, least_rad) * share
    low_rad = min(-limit_rad - bias_rad, -least_rad) * share
    r = state[REF_RATE]
    brake_rad = law[BRAKING_SHARE] * (high_rad if r < 0.0 else -low_rad)
    against_rad_s = ability * brake_rad
    rate_rad_s = abs(r)
    stopping_rad = math.copysign(lag_s * (rate_rad_s - against_rad_s * math.log1p(rate_rad_s / against_rad_s)), r)
    left_rad = error_rad - stopping_rad
    feedforward_rad = limit_rad * share * left_rad / law[EASING_RAD] - law[RATE_GAIN] * r / ability
    feedforward_rad = clamp(feedforward_rad, low_rad, high_rad)
    steady = ability * feedforward_rad - norrbin * r * r * r
    decay = decay_over(step_s, lag_s)
    turned_rad, new_rate_rad_s = exact_step(r, steady, decay, step_s, lag_s)
    lead_rad = clamp(wrap_pi(state[REF_HEADING] - heading_rad) + turned_rad, -lead_most_rad, lead_most_rad)
    return wrap_two_pi(heading_rad + lead_rad), new_rate_rad_s, feedforward_rad


@compiled
def follow_bias(law: Floats, state: Floats, bias_rad: float, mean_rad: float, step_s: float, softness: float) -> float:
    """Return the bias that is counted with; with a reduced gain it is followed slowly, from the mean if less."""
    if softness <= 1.0:
        state[FOLLOWED_BIAS] = np.nan
        return bias_rad
    before_rad = state[FOLLOWED_BIAS]
    if math.isnan(before_rad):
        followed_rad = mean_rad if abs(mean_rad) < abs(bias_rad) else bias_rad
    else:
        part = -math.expm1(-step_s / (law[SLOWER_BIAS_S] * (softness - 1.0)))
        followed_rad = before_rad + part * (bias_rad - before_rad)
    state[FOLLOWED_BIAS] = followed_rad
    return followed_rad


@compiled
def steer(
    law: Floats, state: Floats, e: Floats, error_rad: float, command_rad: float, step_s: float, softness: float
) -> float:
    """Return the rudder asked for (scheduled.update)."""
    e[E_BIAS] = follow_bias(law, state, e[E_BIAS], e[E_BIAS_MEAN], step_s, softness)
    stopped = e[E_SPEED] + e[E_SPEED_SD] < law[WAY_MIN] and abs(error_rad) <= law[TURNING_RAD]
    if stopped or math.isnan(state[REF_HEADING]):
        state[REF_HEADING], state[REF_RATE], state[FEEDFORWARD] = e[E_HEADING], e[E_RATE], 0.0
    if stopped:
        return command_rad
    ratio = e[E_SPEED] / e[M_SPEED]
    ability, lag_s, norrbin = e[M_K] * ratio * e[E_FACTOR], e[M_T] / ratio, e[M_ALPHA] / (ratio * ratio)
    limit_rad = e[LIMIT]
    bias_rad = clamp(e[E_BIAS] + e[TRIM], -limit_rad, limit_rad)
    left_rad = error_rad - wrap_pi(state[REF_HEADING] - e[E_HEADING])
    if abs(error_rad) < math.pi:
        left_rad = wrap_pi(left_rad)
    state[REF_HEADING], state[REF_RATE], state[FEEDFORWARD] = advance_reference(
        law, state, ability, lag_s, norrbin, limit_rad, bias_rad, left_rad, e[E_HEADING], step_s, softness
    )
    stiffness = softened(law, stiffness_of(law, ability, lag_s, e[E_CORRECTION]), softness, ability, e[M_K])
    off_rad = wrap_pi(state[REF_HEADING] - e[E_HEADING])
    rate_gain_s = (math.sqrt(1.0 + 2.0 * ability * lag_s * stiffness) - 1.0) / ability
    rate_max_rad_s = steady_yaw_rate(limit_rad, ability, norrbin)
    k1, k2 = 2.0 * math.pi * stiffness / limit_rad, 2.0 * rate_gain_s * rate_max_rad_s / limit_rad
    feedback_rad = rudder_demand(off_rad, e[E_RATE] - state[REF_RATE], k1, k2, limit_rad, rate_max_rad_s)
    demand_rad = bias_rad + state[FEEDFORWARD] + feedback_rad
    band_rad = band_of(law, e[E_CORRECTION], stiffness)
    if abs(left_rad) > law[TURNING_RAD]:
        band_rad *= law[TURNING_SHARE]
    demand_rad = clamp(demand_rad, -limit_rad, limit_rad)
    return clamp(command_rad, demand_rad - band_rad, demand_rad + band_rad)
