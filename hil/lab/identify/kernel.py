"""The compiled inner loops: the K-T equation driven by a recorded rudder.

The equation is firmware_py/model/kt.py's. It is advanced by an exponential Rosenbrock step
(Hochbruck & Ostermann, Acta Numerica 19, 2010, section 2.5) with the rudder a ramp between two
samples: exact for the linear model at any step, of second order in the cubic term, and stable
however stiff that is, so that a search may try any K, T and alpha and the work stays the same.

Loops run over samples outside and over candidates inside, which the compiler makes SIMD of:
the step has no branches and calls no exponential.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import yaw_acceleration
from hil.lab.compiled import compiled

Floats = NDArray[np.float64]

# The exponential of a decay, exp(-x), is taken as 1 / P(x) with P the Taylor polynomial of exp(x).
# Unlike the polynomial of exp(-x) this lies in (0, 1) for every x >= 0, which is what keeps a stiff
# step stable. S comes with it: phi3(-x) = S(x) / P(x), from phi3 = (1/2 - phi2) / x,
# phi2 = (1 - phi1) / x, phi1 = (1 - 1/P) / x, whose cancelling leading terms are gone in S.
P2, P3, P4, P5, P6, P7, P8 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040, 1 / 40320
S0, S1, S2 = 1 / 2 - P2 + P3, P2 / 2 - P3 + P4, P3 / 2 - P4 + P5
S3, S4, S5 = P4 / 2 - P5 + P6, P5 / 2 - P6 + P7, P6 / 2 - P7 + P8
S6, S7 = P7 / 2 - P8, P8 / 2

LEAST_DAMPING = 0.05  # of 1/T; reached only by a negative alpha, which is held off it
TINY = 1e-200
LARGEST_RATE_RAD_S = 1e6  # nothing turns so fast; keeps a nonsensical candidate finite


@compiled
def exponential_step(
    heading_rad: float,
    yaw_rate_rad_s: float,
    rudder_rad: float,
    next_rudder_rad: float,
    step_s: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    norrbin_s2: float,
    rudder_offset_rad: float,
    quadratic_s: float,
) -> tuple[float, float]:
    """Advance (heading, yaw rate) by one step in which the rudder goes evenly to its next angle.

    quadratic_s: of a damping by r |r| beside Norrbin's by r^3.
    """
    r = yaw_rate_rad_s
    start = yaw_acceleration(r, rudder_rad, turning_ability_1_s, turning_lag_s, norrbin_s2, rudder_offset_rad)
    end = yaw_acceleration(r, next_rudder_rad, turning_ability_1_s, turning_lag_s, norrbin_s2, rudder_offset_rad)
    ramp = end - start
    start -= quadratic_s * r * abs(r) / turning_lag_s
    # The derivative of the acceleration by the yaw rate, times the step, with its sign turned.
    x = step_s / turning_lag_s * max(1.0 + 3.0 * norrbin_s2 * r * r + 2.0 * quadratic_s * abs(r), LEAST_DAMPING)
    growth = 1.0 + x * (1.0 + x * (P2 + x * (P3 + x * (P4 + x * (P5 + x * (P6 + x * (P7 + x * P8)))))))
    phi3 = (S0 + x * (S1 + x * (S2 + x * (S3 + x * (S4 + x * (S5 + x * (S6 + x * S7))))))) / growth
    phi2 = 0.5 - x * phi3
    phi1 = 1.0 - x * phi2
    heading_rad += step_s * (r + step_s * (phi2 * start + phi3 * ramp))
    r += step_s * (phi1 * start + phi2 * ramp)
    return heading_rad, min(max(r, -LARGEST_RATE_RAD_S), LARGEST_RATE_RAD_S)


@compiled
def _through(
    psi: Floats,
    r: Floats,
    candidates: Floats,
    rudder_rad: Floats,
    rudder_end_rad: Floats,
    speed_ratio: Floats,
    n: int,
    step_s: float,
    inner_steps: int,
) -> None:
    """Move all candidates on from sample n to the next."""
    inner_s = step_s / inner_steps
    slope_rad = (rudder_end_rad[n] - rudder_rad[n]) / inner_steps
    u = 0.5 * (speed_ratio[n] + speed_ratio[n + 1])
    lag_scale, cubic_scale = 1.0 / u, 1.0 / (u * u)
    for inner in range(inner_steps):
        rudder = rudder_rad[n] + slope_rad * inner
        for f in range(psi.size):
            psi[f], r[f] = exponential_step(
                psi[f],
                r[f],
                rudder,
                rudder + slope_rad,
                inner_s,
                candidates[0, f] * u,
                candidates[1, f] * lag_scale,
                candidates[2, f] * cubic_scale,
                candidates[3, f],
                candidates[4, f] * lag_scale,
            )


@compiled
def simulate(
    step_s: Floats,
    rudder_rad: Floats,
    rudder_end_rad: Floats,
    speed_ratio: Floats,
    inner_steps: int,
    candidates: Floats,
    heading_rad: Floats,
    yaw_rate_rad_s: Floats,
) -> None:
    """Fill heading and yaw rate, (samples, candidates), from their first rows on.

    step_s[n] leads from sample n to n + 1, in which the rudder goes evenly from rudder_rad[n] to
    rudder_end_rad[n]; candidates has rows K, T, alpha, delta0 and
    the coefficient of r |r|, and a column for each candidate; speed_ratio scales them by similarity
    (paper eq. 7), 1 for not at all.
    """
    psi, r = heading_rad[0].copy(), yaw_rate_rad_s[0].copy()
    for n in range(step_s.size):
        _through(psi, r, candidates, rudder_rad, rudder_end_rad, speed_ratio, n, step_s[n], inner_steps)
        for f in range(psi.size):
            heading_rad[n + 1, f] = psi[f]
            yaw_rate_rad_s[n + 1, f] = r[f]


@compiled
def differentiate(values: Floats, step: float, result: Floats) -> None:
    """Fill result (rows, n) with the one-sided differences of values (rows, 1 + n): base, up, up."""
    factor = 1.0 / step
    for row in range(values.shape[0]):
        for column in range(result.shape[1]):
            result[row, column] = factor * (values[row, column + 1] - values[row, 0])


@compiled
def normal_equations(
    step_s: Floats,
    rudder_rad: Floats,
    rudder_end_rad: Floats,
    speed_ratio: Floats,
    inner_steps: int,
    candidates: Floats,
    first: Floats,
    measured: Floats,
    weights: Floats,
    taps: Floats,
    difference: float,
    matrix: Floats,
    vector: Floats,
) -> float:
    """Fill J'WJ and J'We of one stretch in one pass and return e'We, with the derivatives by one-sided differences.

    step_s to inner_steps are as simulate takes them. candidates (5, columns): the base, then each
    parameter up, by `difference`, then the initial yaw rate up; further columns are passed over.
    first (2, columns) and measured (2, samples): heading and yaw rate, at the start and at each
    sample. weights: of heading and of yaw rate; 0 leaves a channel out. taps (past + 1, past + 1):
    the filters that make the heading's noise white, noise.whitening_taps. matrix (n, n) and
    vector (n,): n parameters, those of the candidates, the initial heading, the initial yaw rate.
    """
    size, past = vector.size, taps.shape[0] - 1
    psi, r = first[0].copy(), first[1].copy()
    factor = 1.0 / difference
    # The last past + 1 rows, each written twice so that they lie together, the latest first.
    ring, at = np.zeros((2 * past + 2, size + 1)), 0
    slopes, rates = np.zeros(size + 1), np.zeros(size + 1)
    matrix[:] = 0.0
    vector[:] = 0.0
    cost = 0.0
    for n in range(step_s.size + 1):
        if n > 0:
            _through(psi, r, candidates, rudder_rad, rudder_end_rad, speed_ratio, n - 1, step_s[n - 1], inner_steps)
        for j in range(size - 1):
            to = j if j < size - 2 else size - 1
            slopes[to] = factor * (psi[j + 1] - psi[0])
            rates[to] = factor * (r[j + 1] - r[0])
        slopes[size - 2] = 1.0
        slopes[size], rates[size] = measured[0, n] - psi[0], measured[1, n] - r[0]
        if weights[1] > 0.0:
            cost += weights[1] * rates[size] * rates[size]
            _add_products(matrix, vector, rates, weights[1])
        if past > 0:
            at = at - 1 if at > 0 else past
            ring[at] = slopes
            ring[at + past + 1] = slopes
            _filter(ring, at, taps, min(n, past), slopes)
        if weights[0] > 0.0:
            cost += weights[0] * slopes[size] * slopes[size]
            _add_products(matrix, vector, slopes, weights[0])
    for j in range(size):
        for k in range(j):
            matrix[j, k] = matrix[k, j]
    return cost


@compiled
def _filter(ring: Floats, at: int, taps: Floats, order: int, result: Floats) -> None:
    """Fill result with the filter of an order over the rows of ring from at on."""
    result[:] = 0.0
    for k in range(order + 1):
        tap = taps[order, k]
        for column in range(result.size):
            result[column] += tap * ring[at + k, column]


@compiled
def _add_products(matrix: Floats, vector: Floats, row: Floats, weight: float) -> None:
    """Add a row of J, with its error last, to the upper triangle of J'WJ and to J'We."""
    size = vector.size
    for j in range(size):
        weighted = weight * row[j]
        vector[j] += weighted * row[size]
        for k in range(j, size):
            matrix[j, k] += weighted * row[k]


@compiled
def filter_columns(values: Floats, taps: Floats, result: Floats) -> None:
    """Fill result (rows, n), zeros to begin with, with each row's filter over it and the rows before it."""
    past = taps.shape[0] - 1
    for row in range(values.shape[0]):
        order = min(row, past)
        for k in range(order + 1):
            for column in range(values.shape[1]):
                result[row, column] += taps[order, k] * values[row - k, column]
