"""Noise and wave parameters learned from innovations (firmware_py/estimate/learning.py) for compiled code.

`n` is the noise model, by the indices below.
"""

from __future__ import annotations

import math

import numpy as np

from firmware_py.common.angles import clamp, radians
from hil.lab.compiled import compiled
from hil.lab.twin.kalman import DAMPING, Floats

# Of a noise model.
(LOG_OMEGA, INFORMATION, LOG_POWER, LOG_NOISE, LOG_BIAS, LOG_VELOCITY, LOG_ORBIT, LOG_FOLLOW, FOLLOW_INFORMATION, LAST,
 SLOW, COUNT, AVERAGE, NORTH_1, EAST_1, NORTH_2, EAST_2, SLOW_NORTH, SLOW_EAST, LOG_SHARE) = range(20)  # fmt: skip
SHARES, YAW, PRODUCTS, SQUARES, WEIGHT = 20, 24, 27, 31, 33
NOISES = 34

LARGEST_NORMALISED = 4.0
PERIOD_MEMORY_S, FOLLOW_MEMORY_S = 300.0, 3600.0
PRIOR, FOLLOW_PRIOR = 5.0, 4.0
LARGEST_STEP = 0.05
STRENGTH_TIME_S = 20.0
FIRST_SAMPLES = 20.0
SWING_TIME_S = 120.0
FIRST_SWINGS = 600.0
SMOOTH_SHARE, SMALL_PART = 4.0, 4.0
SLOW_TIME_S = 10.0
BIAS_GAIN, BIAS_PULL = 0.1, 0.2
FIX_GAIN = 0.02
SHARE_GAIN, SHARE_PULL = 0.6, 0.3
COUPLING_MEMORY_S, LONGEST_FADE_S = 240.0, 10.0
COUPLING_PRIOR, COUPLING_DOUBT = 5.0, 2.0
LARGEST_FIX = 3.0
LONGEST_GAP_S = 1.0
AVERAGE_S = 60.0
FIRST_PERIOD_S = 5.0
FIRST_SPREAD_RAD = radians(5.0)
FIRST_NOISE_RAD = radians(0.3)
FIRST_VELOCITY_NOISE_M_S, FIRST_ORBIT_M_S = 0.1, 0.1
FIRST_SLOW_SHARE = 0.25
FIRST_FOLLOW_RAD_S, FOLLOW_BY_ABILITY = 0.8, 16.0
BIAS_NOISE = 0.08 * radians(1.0) ** 2
LOG_BIAS_NOISE, LOG_FIRST_SHARE = math.log(BIAS_NOISE), math.log(FIRST_SLOW_SHARE)

LOW_OMEGA, HIGH_OMEGA = math.log(2.0 * math.pi / 14.0), math.log(2.0 * math.pi / 1.6)
LOW_NOISE, HIGH_NOISE = math.log(radians(0.01) ** 2), math.log(radians(5.0) ** 2)
LOW_POWER, HIGH_POWER = math.log(1e-4 * radians(1.0) ** 2), math.log(1e4 * radians(1.0) ** 2)
LOW_BIAS, HIGH_BIAS = math.log(2e-4 * radians(1.0) ** 2), math.log(0.36 * radians(1.0) ** 2)
LOW_VELOCITY, HIGH_VELOCITY = math.log(0.02**2), math.log(2.0**2)
LOW_ORBIT, HIGH_ORBIT = math.log(0.003**2), math.log(2.0**2)
LOW_SHARE, HIGH_SHARE = math.log(0.02), math.log(0.99)
LOW_FOLLOW, HIGH_FOLLOW = math.log(0.15), math.log(6.0)


@compiled
def power_of(spread_rad: float, omega_rad_s: float) -> float:
    """Return the white noise that drives waves of this spread and frequency."""
    return 4.0 * DAMPING * omega_rad_s * omega_rad_s * omega_rad_s * spread_rad * spread_rad


FIRST_RAD_S = 2.0 * math.pi / FIRST_PERIOD_S
FIRST_POWER = 4.0 * DAMPING * FIRST_RAD_S * FIRST_RAD_S * FIRST_RAD_S * FIRST_SPREAD_RAD * FIRST_SPREAD_RAD
FIRST = np.zeros(NOISES)
FIRST[[LOG_OMEGA, LOG_POWER, LOG_NOISE]] = (
    math.log(FIRST_RAD_S), math.log(FIRST_POWER), math.log(FIRST_NOISE_RAD**2))  # fmt: skip
FIRST[[LOG_BIAS, LOG_VELOCITY, LOG_ORBIT]] = (
    LOG_BIAS_NOISE, math.log(FIRST_VELOCITY_NOISE_M_S**2), math.log(FIRST_ORBIT_M_S**2))  # fmt: skip
FIRST[[LOG_FOLLOW, AVERAGE, LOG_SHARE]] = math.log(FIRST_FOLLOW_RAD_S), 1.0, LOG_FIRST_SHARE


@compiled
def wave_spread_rad(n: Floats) -> float:
    """Return the standard deviation of the wave yaw."""
    return math.sqrt(math.exp(n[LOG_POWER] - 3.0 * n[LOG_OMEGA]) / (4.0 * DAMPING))


@compiled
def learn_coupling(n: Floats, angle: float, rate: float, north_m_s: float, east_m_s: float, step_s: float) -> None:
    """Learn how the receiver's velocity goes with the yaw."""
    fade = math.exp(-min(step_s, LONGEST_FADE_S) / COUPLING_MEMORY_S)
    count = fade * n[WEIGHT] + 1.0
    n[WEIGHT] = count
    n[YAW] = fade * n[YAW] + angle * angle
    n[YAW + 1] = fade * n[YAW + 1] + angle * rate
    n[YAW + 2] = fade * n[YAW + 2] + rate * rate
    n[PRODUCTS] = fade * n[PRODUCTS] + angle * north_m_s
    n[PRODUCTS + 1] = fade * n[PRODUCTS + 1] + rate * north_m_s
    n[PRODUCTS + 2] = fade * n[PRODUCTS + 2] + angle * east_m_s
    n[PRODUCTS + 3] = fade * n[PRODUCTS + 3] + rate * east_m_s
    n[SQUARES] = fade * n[SQUARES] + north_m_s * north_m_s
    n[SQUARES + 1] = fade * n[SQUARES + 1] + east_m_s * east_m_s
    a, b, d = n[YAW], n[YAW + 1], n[YAW + 2]
    ridge = 0.5 * COUPLING_PRIOR * (a + d) / count
    a, d = a + ridge, d + ridge
    determinant = a * d - b * b
    if determinant <= 0.0:
        return
    for axis in range(2):
        by_angle, by_rate, square = n[PRODUCTS + 2 * axis], n[PRODUCTS + 2 * axis + 1], n[SQUARES + axis]
        of_angle, of_rate = (d * by_angle - b * by_rate) / determinant, (a * by_rate - b * by_angle) / determinant
        explained = of_angle * by_angle + of_rate * by_rate
        chance = COUPLING_DOUBT * 2.0 * max(square - explained, 0.0) / max(count - 2.0, 1.0)
        kept = max(0.0, 1.0 - chance / explained) if explained > 0.0 else 0.0
        n[SHARES + 2 * axis], n[SHARES + 2 * axis + 1] = kept * of_angle, kept * of_rate


@compiled
def expect_float(n: Floats, turning_ability_1_s: float) -> None:
    """Expect a float that suits the boat, where none has shown how it follows."""
    if not n[FOLLOW_INFORMATION] > 0.0:
        n[LOG_FOLLOW] = min(math.log(max(FIRST_FOLLOW_RAD_S, FOLLOW_BY_ABILITY * turning_ability_1_s)), HIGH_FOLLOW)


@compiled
def learn_frequencies(
    n: Floats, innovation: float, variance: float, by_omega: float, by_follow: float, step_s: float
) -> None:
    """Learn the frequencies of waves and float."""
    information = n[INFORMATION] * math.exp(-step_s / PERIOD_MEMORY_S) + by_omega * by_omega / variance
    follow = n[FOLLOW_INFORMATION] * math.exp(-step_s / FOLLOW_MEMORY_S) + by_follow * by_follow / variance
    score = innovation / variance
    shift = clamp(score * by_omega / (information + PRIOR), -LARGEST_STEP, LARGEST_STEP)
    n[LOG_OMEGA] = clamp(n[LOG_OMEGA] + shift, LOW_OMEGA, HIGH_OMEGA)
    n[INFORMATION] = information
    shift = clamp(score * by_follow / (follow + FOLLOW_PRIOR), -LARGEST_STEP, LARGEST_STEP)
    n[LOG_FOLLOW] = clamp(n[LOG_FOLLOW] + shift, LOW_FOLLOW, HIGH_FOLLOW)
    n[FOLLOW_INFORMATION] = follow


@compiled
def slow_excess_of(average: float, part: float) -> float:
    """Return by how much an average of innovations is larger than white noise would leave it."""
    return min(average * average * (2.0 - part) / part - 1.0, LARGEST_NORMALISED)


@compiled
def learn_from_heading(
    n: Floats, innovation_rad: float, variance: float, noise_square: float, step_s: float, swing_square: float
) -> None:
    """Learn noise, which is noise_square by now, the wandering of the bias and the waves' strength."""
    z = clamp(innovation_rad / math.sqrt(variance), -LARGEST_NORMALISED, LARGEST_NORMALISED)
    count = n[COUNT] + 1.0
    gain = max(1.0 / (count + FIRST_SAMPLES), min(step_s, LONGEST_GAP_S) / STRENGTH_TIME_S)
    part = min(step_s / SLOW_TIME_S, 0.5)
    slow = n[SLOW] + part * (z - n[SLOW])
    slow_excess = slow_excess_of(slow, part)
    pull = BIAS_PULL * (LOG_BIAS_NOISE - n[LOG_BIAS])
    bias = n[LOG_BIAS] + BIAS_GAIN * part * (slow_excess + pull)
    share = min(step_s / AVERAGE_S, 0.5)
    spread_rad = wave_spread_rad(n)
    swing = min(swing_square / (spread_rad * spread_rad) - 1.0, LARGEST_NORMALISED)
    swing_gain = min(step_s, LONGEST_GAP_S) / SWING_TIME_S
    early = FIRST_SWINGS / (count + FIRST_SWINGS)
    excess = z * z - 1.0
    correlation = early * z * n[LAST] if step_s <= LONGEST_GAP_S else 0.0
    weight = min(variance / noise_square, SMALL_PART)
    noise = n[LOG_NOISE] + gain * weight * (excess - correlation)
    waves = early * gain * excess + gain * correlation + (1.0 - early) * swing_gain * swing
    waves += SMOOTH_SHARE * min(noise - LOW_NOISE, 0.0)
    n[LOG_POWER] = clamp(n[LOG_POWER] + waves, LOW_POWER, HIGH_POWER)
    n[LOG_NOISE] = clamp(noise, LOW_NOISE, HIGH_NOISE)
    n[LOG_BIAS] = clamp(bias, LOW_BIAS, HIGH_BIAS)
    n[LAST], n[SLOW], n[COUNT] = z, slow, count
    n[AVERAGE] = n[AVERAGE] + share * (z * z - n[AVERAGE])


@compiled
def learn_from_velocity(n: Floats, north_z: float, east_z: float, step_s: float) -> None:
    """Learn the receiver's noise and its motion in the waves, from momentary velocities."""
    north, east = clamp(north_z, -LARGEST_FIX, LARGEST_FIX), clamp(east_z, -LARGEST_FIX, LARGEST_FIX)
    omega_rad_s = math.exp(n[LOG_OMEGA])
    correlation = 0.0
    angle = omega_rad_s * 1.0 * step_s
    correlation += math.exp(-DAMPING * angle) * math.cos(angle) * (north * n[NORTH_1] + east * n[EAST_1])
    angle = omega_rad_s * 2.0 * step_s
    correlation += math.exp(-DAMPING * angle) * math.cos(angle) * (north * n[NORTH_2] + east * n[EAST_2])
    excess = north * north + east * east - 2.0
    noise = n[LOG_VELOCITY] + FIX_GAIN * (excess - correlation)
    orbit = n[LOG_ORBIT] + FIX_GAIN * (excess + correlation)
    part = min(step_s / SLOW_TIME_S, 0.5)
    slow_north = n[SLOW_NORTH] + part * (north - n[SLOW_NORTH])
    slow_east = n[SLOW_EAST] + part * (east - n[SLOW_EAST])
    slow_excess = 0.0 + slow_excess_of(slow_north, part) + slow_excess_of(slow_east, part)
    pull = SHARE_PULL * (LOG_FIRST_SHARE - n[LOG_SHARE])
    share = n[LOG_SHARE] + SHARE_GAIN * part * (slow_excess + pull)
    n[LOG_VELOCITY] = clamp(noise, LOW_VELOCITY, HIGH_VELOCITY)
    n[LOG_ORBIT] = clamp(orbit, LOW_ORBIT, HIGH_ORBIT)
    n[NORTH_2], n[EAST_2], n[NORTH_1], n[EAST_1] = n[NORTH_1], n[EAST_1], north, east
    n[SLOW_NORTH], n[SLOW_EAST] = slow_north, slow_east
    n[LOG_SHARE] = clamp(share, LOW_SHARE, HIGH_SHARE)
