"""Twin of firmware_py/estimate/kalman.py: how the states of the wave filter are carried on and corrected.

Every sum is made in the order of the original, so every number is its number.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import decay_over, settled_yaw_rate
from hil.lab.compiled import compiled

Floats = NDArray[np.float64]

HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG = range(11)
WAVE, WAVE_RATE, ORBIT_NORTH, ORBIT_NORTH_RATE, ORBIT_EAST, ORBIT_EAST_RATE = range(11, 17)
STATES = 17
COLUMNS = STATES + 2  # of the covariance and the slopes beside it
DAMPING, FLOAT_DAMPING = 0.1, 0.6

# Of a turn.
TURNED, TURNING, REACH, SHARE, BY_RATE, BY_BIAS, BY_SPEED, BY_FACTOR = range(8)


@compiled
def response(omega_rad_s: float, damping: float, step_s: float) -> tuple[float, float, float, float]:
    """Return the transition matrix of angle and rate of a second-order system."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping * damping)
    decay = math.exp(-damping * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = damping * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


@compiled
def wave_noise(wave: tuple[float, float, float, float], omega_rad_s: float, power: float) -> tuple[float, float, float]:
    """Return the noise that keeps a wave motion stationary: angle, covariance, rate."""
    w00, w01, w10, w11 = wave
    rate_square = power / (4.0 * DAMPING * omega_rad_s)
    angle_square = rate_square / (omega_rad_s * omega_rad_s)
    return (
        angle_square - w00 * w00 * angle_square - w01 * w01 * rate_square,
        -w00 * w10 * angle_square - w01 * w11 * rate_square,
        rate_square - w10 * w10 * angle_square - w11 * w11 * rate_square,
    )


@compiled
def turn(
    x: Floats, rudder_rad: float, step_s: float, model: tuple[float, float, float, float], bias_variance: float
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return how the boat turns in a step, by the model's K, T, alpha and speed."""
    ratio = x[SPEED] / model[3]
    ability_1_s, lag_s, norrbin = model[0] * ratio, model[1] / ratio, model[2] / (ratio * ratio)
    r, factor, push_rad = x[RATE], x[FACTOR], rudder_rad - x[BIAS]
    cubic = norrbin * r * r * r
    steady = factor * ability_1_s * push_rad - cubic
    decay = decay_over(step_s, lag_s)
    gone = 1.0 - decay
    reach_s = lag_s * gone
    felt = push_rad * push_rad / (push_rad * push_rad + 25.0 * bias_variance) if bias_variance > 0.0 else 1.0
    by_speed = (factor * ability_1_s * push_rad + 2.0 * cubic) * gone + (steady - r) * decay * step_s / lag_s
    return (
        x[HEADING] + steady * step_s + (r - steady) * reach_s,
        settled_yaw_rate(r, steady, decay),
        reach_s,
        (step_s - reach_s) / gone if gone > 1e-12 else 0.5 * step_s,
        decay - 3.0 * norrbin * r * r * gone,
        -factor * ability_1_s * gone,
        felt * by_speed / x[SPEED],
        felt * ability_1_s * push_rad * gone,
    )


@compiled
def advance(
    x: Floats,
    turned: tuple[float, float, float, float, float, float, float, float],
    follow: tuple[float, float, float, float],
    wave: tuple[float, float, float, float],
) -> None:
    """Carry the states on."""
    middle = 0.5 * (x[HEADING] + turned[TURNED])
    behind, float_rate = x[FLOAT] - middle, x[FLOAT_RATE]
    x[HEADING], x[RATE] = turned[TURNED], turned[TURNING]
    x[FLOAT] = middle + follow[0] * behind + follow[1] * float_rate
    x[FLOAT_RATE] = follow[2] * behind + follow[3] * float_rate
    for place in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        angle, rate = x[place], x[place + 1]
        x[place] = wave[0] * angle + wave[1] * rate
        x[place + 1] = wave[2] * angle + wave[3] * rate


@compiled
def carry(
    before: Floats,
    after: Floats,
    turned: tuple[float, float, float, float, float, float, float, float],
    follow: tuple[float, float, float, float],
    wave: tuple[float, float, float, float],
) -> None:
    """Fill `after` with F times `before`, row by row; terms that are 0 are left out, which changes no number."""
    reach, by_rate, half, share = turned[REACH], turned[BY_RATE], 0.5 * turned[REACH], turned[SHARE]
    bias, speed, factor = turned[BY_BIAS], turned[BY_SPEED], turned[BY_FACTOR]
    f00, f01, f10, f11 = follow
    w00, w01, w10, w11 = wave
    left, by_push = 1.0 - f00, 0.5 * share
    a2, a7, a8 = share * bias, share * speed, share * factor
    b1, b2, b7, b8 = left * half, left * by_push * bias, left * by_push * speed, left * by_push * factor
    c1, c2, c7, c8 = -f10 * half, -f10 * by_push * bias, -f10 * by_push * speed, -f10 * by_push * factor
    columns = before.shape[1]
    for k in range(columns):
        h, r, d = before[HEADING, k], before[RATE, k], before[BIAS, k]
        f, g, u, q = before[FLOAT, k], before[FLOAT_RATE, k], before[SPEED, k], before[FACTOR, k]
        after[HEADING, k] = h + reach * r + a2 * d + a7 * u + a8 * q
        after[RATE, k] = by_rate * r + bias * d + speed * u + factor * q
        after[BIAS, k] = d
        after[FLOAT, k] = left * h + b1 * r + b2 * d + f00 * f + f01 * g + b7 * u + b8 * q
        after[FLOAT_RATE, k] = -f10 * h + c1 * r + c2 * d + f10 * f + f11 * g + c7 * u + c8 * q
        after[SPEED, k] = u
        after[FACTOR, k] = q
    for i in (NORTH, EAST, LEEWAY, COURSE_LAG):
        for k in range(columns):
            after[i, k] = before[i, k]
    for i in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        for k in range(columns):
            angle, rate = before[i, k], before[i + 1, k]
            after[i, k] = w00 * angle + w01 * rate
            after[i + 1, k] = w10 * angle + w11 * rate


@compiled
def predict(
    p: Floats,
    once: Floats,
    turned_over: Floats,
    twice: Floats,
    turned: tuple[float, float, float, float, float, float, float, float],
    follow: tuple[float, float, float, float],
    wave: tuple[float, float, float, float],
) -> None:
    """Carry covariance and slopes, side by side in `p` (17 x 19), on; `once` is as large, the others 17 x 17."""
    carry(p, once, turned, follow, wave)
    for i in range(STATES):
        for k in range(STATES):
            turned_over[i, k] = once[k, i]
        p[i, STATES], p[i, STATES + 1] = once[i, STATES], once[i, STATES + 1]
    carry(turned_over, twice, turned, follow, wave)
    for i in range(STATES):
        for k in range(STATES):
            p[i, k] = 0.5 * (twice[i, k] + twice[k, i])


@compiled
def correct(x: Floats, p: Floats, shown: Floats, innovation: float, variance: float) -> None:
    """Take a scalar measurement in; `shown` is P H', and variance that of the innovation."""
    for i in range(STATES):
        part = shown[i]
        x[i] = x[i] + part / variance * innovation
        for k in range(STATES):
            p[i, k] = p[i, k] - part * shown[k] / variance
