"""The arithmetic of the 18-state wave filter (firmware_py/estimate/kalman.py) for compiled code.

Every sum is made in the order of the original, so every number is the same to the last bit. The covariance is kept
whole and is symmetric to the last bit; beside it stand the two sensitivities.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import decay_over, settled_yaw_rate
from hil.lab.compiled import compiled

Floats = NDArray[np.float64]
Covariance = Any  # a record of COVARIANCE
Response = tuple[float, float, float, float]
Turn = tuple[float, float, float, float, float, float, float, float]

HEADING, RATE, BIAS, FLOAT, FLOAT_RATE, NORTH, EAST, SPEED, FACTOR, LEEWAY, COURSE_LAG, BIAS_MEAN = range(12)
WAVE, WAVE_RATE, ORBIT_NORTH, ORBIT_NORTH_RATE, ORBIT_EAST, ORBIT_EAST_RATE = range(12, 18)
STATES = 18
COLUMNS = STATES + 2  # of the covariance and the sensitivities beside it
DAMPING, FLOAT_DAMPING, BIAS_MEMORY_S = 0.1, 0.6, 100.0
TURNING = FLOAT_RATE + 1  # number of states that the turn changes; those from here to the waves stay as they are

# The covariance with the sensitivities (`p`), room to transpose it (`across`), what is added to both in a step, and a
# measurement: its cross covariance (`shown`), the same by the innovation's standard deviation (`root`), the innovation,
# the variance that is expected of it and that which it is given.
COVARIANCE = np.dtype(
    [
        (name, np.float64, tuple(shape))
        for name, *shape in (
            ("p", STATES, COLUMNS), ("across", STATES, STATES), ("noise", STATES), ("both", 3), ("force", 8),
            ("shown", COLUMNS), ("root", COLUMNS), ("parts", 10), ("noted", 7),
            ("innovation",), ("expected",), ("variance",),
        )
    ]
)  # fmt: skip

# Of a turn.
TURNED, TURN_RATE, REACH, SHARE, BY_RATE, BY_BIAS, BY_SPEED, BY_FACTOR = range(8)


@compiled
def response(omega_rad_s: float, damping: float, step_s: float) -> Response:
    """Return the transition matrix of angle and rate of a second-order system."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - damping * damping)
    decay = math.exp(-damping * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = damping * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


@compiled
def wave_noise(wave: Response, omega_rad_s: float, power: float) -> tuple[float, float, float]:
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
def turn(x: Floats, rudder_rad: float, step_s: float, model: Floats, bias_variance: float) -> Turn:
    """Return how the boat turns in a step, by its model's K, T, alpha and speed."""
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
def advance(x: Floats, turned: Turn, follow: Response, wave: Response, keep: float) -> None:
    """Propagate the states; the float follows the middle of the glider's way."""
    middle = 0.5 * (x[HEADING] + turned[TURNED])
    behind, float_rate = x[FLOAT] - middle, x[FLOAT_RATE]
    x[HEADING], x[RATE] = turned[TURNED], turned[TURN_RATE]
    x[BIAS] = x[BIAS_MEAN] + keep * (x[BIAS] - x[BIAS_MEAN])
    x[FLOAT] = middle + follow[0] * behind + follow[1] * float_rate
    x[FLOAT_RATE] = follow[2] * behind + follow[3] * float_rate
    for place in (WAVE, ORBIT_NORTH, ORBIT_EAST):
        angle, rate = x[place], x[place + 1]
        x[place] = wave[0] * angle + wave[1] * rate
        x[place + 1] = wave[2] * angle + wave[3] * rate


@compiled
def carry(m: Floats, turned: Turn, follow: Response, wave: Response, keep: float) -> None:
    """Multiply the columns of a matrix by the derivative of `advance`; terms that are 0 are left out."""
    _, _, reach, share, by_rate, bias, speed, factor = turned
    half, half_share = 0.5 * reach, 0.5 * share
    h_bias, h_speed, h_factor = share * bias, share * speed, share * factor
    m_bias, m_speed, m_factor = half_share * bias, half_share * speed, half_share * factor
    f00, f01, f10, f11 = follow
    w00, w01, w10, w11 = wave
    lost = 1.0 - keep
    columns = m.shape[1]
    for k in range(columns):
        h, r, d, u, q = m[HEADING, k], m[RATE, k], m[BIAS, k], m[SPEED, k], m[FACTOR, k]
        middle = h + half * r + m_bias * d + m_speed * u + m_factor * q
        behind, float_rate = m[FLOAT, k] - middle, m[FLOAT_RATE, k]
        m[HEADING, k] = h + reach * r + h_bias * d + h_speed * u + h_factor * q
        m[RATE, k] = by_rate * r + bias * d + speed * u + factor * q
        m[BIAS, k] = keep * d + lost * m[BIAS_MEAN, k]
        m[FLOAT, k] = f00 * behind + f01 * float_rate + middle
        m[FLOAT_RATE, k] = f10 * behind + f11 * float_rate
    for i in range(WAVE, STATES, 2):
        for k in range(columns):
            angle, rate = m[i, k], m[i + 1, k]
            m[i, k] = w00 * angle + w01 * rate
            m[i + 1, k] = w10 * angle + w11 * rate


@compiled
def predict(c: Covariance, turned: Turn, follow: Response, wave: Response, keep: float) -> None:
    """Propagate the covariance, F P F' + Q, and the sensitivities."""
    p, across = c.p, c.across
    carry(p, turned, follow, wave, keep)
    for i in range(STATES):
        for k in range(STATES):
            across[i, k] = p[k, i]
    carry(across, turned, follow, wave, keep)
    for i in range(STATES):
        across[i, i] += c.noise[i]
    for number in range(3):
        angle, rate = WAVE + 2 * number, WAVE + 2 * number + 1
        across[rate, angle] += c.both[number]
        p[angle, STATES] += c.force[2 * number]
        p[rate, STATES] += c.force[2 * number + 1]
    p[FLOAT, STATES + 1] += c.force[6]
    p[FLOAT_RATE, STATES + 1] += c.force[7]
    # The lower triangle counts: the two differ in the last bit.
    for i in range(STATES):
        for k in range(i + 1):
            p[i, k] = p[k, i] = across[i, k]


@compiled
def show_heading(c: Covariance) -> None:
    """Fill the cross covariance of a heading."""
    for k in range(COLUMNS):
        c.shown[k] = c.p[FLOAT, k] + c.p[WAVE, k]


@compiled
def correct(x: Floats, c: Covariance) -> None:
    """Update states and covariance by a scalar measurement.

    By the innovation's standard deviation and not its variance: so the covariance stays symmetric to the last bit.
    """
    p, root = c.p, c.root
    share = 1.0 / math.sqrt(c.variance)
    moved = share * c.innovation
    for k in range(COLUMNS):
        root[k] = share * c.shown[k]
    for i in range(STATES):
        part = root[i]
        x[i] += part * moved
        for k in range(COLUMNS):
            p[i, k] -= part * root[k]


@compiled
def add_covariance(p: Floats, row: int, column: int, more: float) -> None:
    """Add to the covariance of two states."""
    p[row, column] += more
    if row != column:
        p[column, row] += more


@compiled
def is_sound(x: Floats, p: Floats) -> bool:
    """Whether states and covariance are finite, and all variances above 0."""
    wrong = 0
    for i in range(STATES):
        wrong += 0 if abs(x[i]) < math.inf and p[i, i] > 0.0 else 1
        for k in range(STATES):
            wrong += 0 if abs(p[i, k]) < math.inf else 1
    return wrong == 0
