"""The arithmetic of the heading filter: nine states, scalar measurements, plain numbers.

States: low-frequency heading, yaw rate and rudder bias (K-T equation, driven by the measured
rudder and scaled to the speed by similarity), angle and rate of the wave-frequency yaw (a
second-order process of damping 0.1), current north and east, speed through the water, and by
what factor she turns better than her model says.

Everything works in place on flat sequences (`x` of 9, `p` of 81 numbers, row by row), so that the
same functions run as they are in the tick and compiled in the box.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Final

HEADING, RATE, BIAS, WAVE, WAVE_RATE, NORTH, EAST, SPEED, FACTOR = range(9)
STATES: Final = 9
DAMPING: Final = 0.1  # of the wave process; physics.md section 6

Numbers = MutableSequence[float]
Transition = tuple[float, float, float, float]  # of the wave process over a step, row by row


def wave_transition(omega_rad_s: float, step_s: float) -> Transition:
    """Return the transition matrix of the wave process over a step, row by row."""
    damped_rad_s = omega_rad_s * math.sqrt(1.0 - DAMPING * DAMPING)
    decay = math.exp(-DAMPING * omega_rad_s * step_s)
    cosine, sine = decay * math.cos(damped_rad_s * step_s), decay * math.sin(damped_rad_s * step_s) / damped_rad_s
    lead = DAMPING * omega_rad_s * sine
    return cosine + lead, sine, -omega_rad_s * omega_rad_s * sine, cosine - lead


def carry(
    x: Numbers,
    p: Numbers,
    f: Numbers,
    step_s: float,
    rudder_rad: float,
    turning_ability_1_s: float,
    turning_lag_s: float,
    norrbin_s2: float,
    model_speed_m_s: float,
    transition: Transition,
    omega_rad_s: float,
    wave_power: float,
    noises: tuple[float, float, float, float, float],
) -> None:
    """Carry state and covariance over a step at constant rudder.

    `f` is scratch of 81 numbers. wave_power [rad^2/s^3] is the white noise that drives the waves;
    noises are the variances that yaw rate, bias, current, speed and factor gain in the step.
    """
    ratio = x[SPEED] / model_speed_m_s
    lag_s = turning_lag_s / ratio
    ability_1_s = turning_ability_1_s * ratio
    norrbin = norrbin_s2 / (ratio * ratio)
    r = x[RATE]
    push_rad = rudder_rad - x[BIAS]
    steady = x[FACTOR] * ability_1_s * push_rad - norrbin * r * r * r
    decay = math.exp(-step_s / lag_s)
    gone = 1.0 - decay
    reach = lag_s * gone
    x[HEADING] += steady * step_s + (r - steady) * reach
    x[RATE] = steady + (r - steady) * decay
    # The derivatives of the new yaw rate and heading.
    rate_rate = decay - 3.0 * norrbin * r * r * gone
    rate_bias = -x[FACTOR] * ability_1_s * gone
    rate_factor = ability_1_s * push_rad * gone
    slope = 2.0 * x[FACTOR] * ability_1_s * push_rad - r + norrbin * r * r * r
    rate_speed = slope / (lag_s * x[SPEED]) * step_s
    part = (step_s - reach) / gone if gone > 1e-12 else 0.5 * step_s
    w00, w01, w10, w11 = transition
    wave, wave_rate = x[WAVE], x[WAVE_RATE]
    x[WAVE] = w00 * wave + w01 * wave_rate
    x[WAVE_RATE] = w10 * wave + w11 * wave_rate
    # F P, of which only four rows differ from P, then (F P) F'.
    for j in range(9):
        p0, p1, p2, p3, p4, p7, p8 = p[j], p[9 + j], p[18 + j], p[27 + j], p[36 + j], p[63 + j], p[72 + j]
        steered = rate_bias * p2 + rate_speed * p7 + rate_factor * p8
        f[j] = p0 + reach * p1 + part * steered
        f[9 + j] = rate_rate * p1 + steered
        f[27 + j] = w00 * p3 + w01 * p4
        f[36 + j] = w10 * p3 + w11 * p4
    for row in (18, 45, 54, 63, 72):
        for j in range(row, row + 9):
            f[j] = p[j]
    for row in (0, 9, 18, 27, 36, 45, 54, 63, 72):
        f0, f1, f3, f4 = f[row], f[row + 1], f[row + 3], f[row + 4]
        steered = rate_bias * f[row + 2] + rate_speed * f[row + 7] + rate_factor * f[row + 8]
        p[row] = f0 + reach * f1 + part * steered
        p[row + 1] = rate_rate * f1 + steered
        p[row + 2] = f[row + 2]
        p[row + 3] = w00 * f3 + w01 * f4
        p[row + 4] = w10 * f3 + w11 * f4
        p[row + 5] = f[row + 5]
        p[row + 6] = f[row + 6]
        p[row + 7] = f[row + 7]
        p[row + 8] = f[row + 8]
    # The wave noise that keeps the process stationary over any step: P - A P A'.
    s1 = wave_power / (4.0 * DAMPING * omega_rad_s)
    s0 = s1 / (omega_rad_s * omega_rad_s)
    p[30] += s0 - w00 * w00 * s0 - w01 * w01 * s1
    q01 = -w00 * w10 * s0 - w01 * w11 * s1
    p[31] += q01
    p[39] += q01
    p[40] += s1 - w10 * w10 * s0 - w11 * w11 * s1
    p[10] += noises[0]
    p[20] += noises[1]
    p[50] += noises[2]
    p[60] += noises[2]
    p[70] += noises[3]
    p[80] += noises[4]


def absorb(x: Numbers, p: Numbers, gain: Numbers, innovation: float, variance: float) -> None:
    """Take a scalar measurement in; `gain` holds P H' at entry and the Kalman gain after."""
    for i in range(9):
        gain[i] /= variance
        x[i] += gain[i] * innovation
    # P - K (P H')' of the symmetric P, both halves alike.
    for i in range(9):
        scaled = gain[i] * variance
        for j in range(i, 9):
            value = p[9 * i + j] - scaled * gain[j]
            p[9 * i + j] = value
            p[9 * j + i] = value
