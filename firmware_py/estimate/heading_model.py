"""Kalman filter of heading, yaw rate, rudder bias and wave yaw, at fixed noise levels. Numeric core.

State vector x = (psi, r, b, w, v):

    d psi = r dt
    d r   = (K (delta - b) - r - alpha r^3) / T dt + sqrt(D) / T dB1     K-T equation (model/kt.py), yaw disturbance D
    d b   = q dB2                                                        rudder bias, random walk
    d w   = v dt                                                         wave yaw of standard deviation sigma
    d v   = -(omega^2 w + 2 zeta omega v) dt + 2 sigma sqrt(zeta omega^3) dB3

D is the diffusion of the heading [rad^2/s]: in times t much longer than T the heading changes by sqrt(D t), as a
standard deviation. The compass measures psi + w + noise. The second-order wave model is the usual one of dynamic
positioning (Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2011, section 8.2). Transition and noise
of a step are exact for a constant rudder angle, except for the cubic term, which is constant during the step.

The matrix products are written out as scalar operations: these take a fifth of the time of array operations, and give
the same bits in the compiled code of the laboratory.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.common.angles import TWO_PI, radians, wrap_pi
from firmware_py.model.kt import KtModel, decay_over, exact_step, held_cubic

OUTLIER_SQUARE = 12.0  # limit of the squared innovation divided by its variance (3.5 standard deviations)
INITIAL_HEADING_VARIANCE = radians(18.0) ** 2  # the wave yaw at the first heading is not known
INITIAL_RATE_VARIANCE = radians(3.0) ** 2
INITIAL_BIAS_VARIANCE = radians(12.8) ** 2
# Added when the model does not explain a turn: with a lost rudder, in tow, or turned by hand.
UNEXPLAINED_RATE_VARIANCE = radians(2.0) ** 2
UNEXPLAINED_BIAS_VARIANCE = radians(20.0) ** 2


class NoiseLevels(NamedTuple):
    """Natural logarithms of the six noise levels.

    Diffusion D [rad^2/s], standard deviation [rad], period [s] and damping ratio of the wave yaw, standard deviation of
    the compass noise [rad], walk q of the rudder bias [rad/sqrt(s)].
    """

    diffusion: float = 0.0
    wave_sd: float = 0.0
    wave_period: float = 0.0
    wave_damping: float = 0.0
    compass_noise: float = 0.0
    bias_walk: float = 0.0


class Motion(NamedTuple):
    """State vector and the upper triangle of its covariance, row by row, in the order psi, r, b, w, v."""

    heading_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    bias_rad: float = 0.0
    wave_rad: float = 0.0
    wave_rate_rad_s: float = 0.0
    p00: float = 0.0
    p01: float = 0.0
    p02: float = 0.0
    p03: float = 0.0
    p04: float = 0.0
    p11: float = 0.0
    p12: float = 0.0
    p13: float = 0.0
    p14: float = 0.0
    p22: float = 0.0
    p23: float = 0.0
    p24: float = 0.0
    p33: float = 0.0
    p34: float = 0.0
    p44: float = 0.0


STATES = 5
ROW_LENGTH = len(Motion._fields)
Floats = NDArray[np.float64]


def write_row(row: Floats, m: Motion) -> None:
    """Write the fields of a state to a row of an array, in place."""
    for i in range(ROW_LENGTH):
        row[i] = m[i]


def read_row(row: Floats) -> Motion:
    """Return the state that `write_row` has written to a row of an array."""
    return Motion(
        float(row[0]), float(row[1]), float(row[2]), float(row[3]), float(row[4]),
        float(row[5]), float(row[6]), float(row[7]), float(row[8]), float(row[9]),
        float(row[10]), float(row[11]), float(row[12]), float(row[13]),
        float(row[14]), float(row[15]), float(row[16]),
        float(row[17]), float(row[18]), float(row[19]),
    )  # fmt: skip


def begin(heading_rad: float, levels: NoiseLevels) -> Motion:
    """Return the state at the first heading, with yaw rate and bias 0."""
    return begin_at(heading_rad, 0.0, INITIAL_RATE_VARIANCE, 0.0, INITIAL_BIAS_VARIANCE, levels)


def begin_at(
    heading_rad: float,
    yaw_rate_rad_s: float,
    rate_variance: float,
    bias_rad: float,
    bias_variance: float,
    levels: NoiseLevels,
) -> Motion:
    """Return the state at the first heading, with this yaw rate and bias and their variances."""
    wave_variance = math.exp(2.0 * levels.wave_sd)
    omega_rad_s = TWO_PI * math.exp(-levels.wave_period)
    return Motion(
        heading_rad, yaw_rate_rad_s, bias_rad, 0.0, 0.0,
        INITIAL_HEADING_VARIANCE, 0.0, 0.0, 0.0, 0.0,
        rate_variance, 0.0, 0.0, 0.0,
        bias_variance, 0.0, 0.0,
        wave_variance, 0.0,
        wave_variance * omega_rad_s * omega_rad_s,
    )  # fmt: skip


def predict(m: Motion, levels: NoiseLevels, model: KtModel, rudder_rad: float, step_s: float) -> Motion:
    """Return the state predicted over step_s > 0 with a constant rudder angle."""
    divisor, cubic, cubic_slope = held_cubic(model.turning_lag_s, model.norrbin_s2, m.yaw_rate_rad_s, step_s)
    ability_1_s, lag_s = model.turning_ability_1_s / divisor, model.turning_lag_s / divisor
    # Yaw: F = [[1, rate_reach, -bias_reach], [0, rate_keep, -bias_gain], [0, 0, 1]].
    decay = decay_over(step_s, lag_s)
    reach_s = lag_s * (1.0 - decay)
    steady_rad_s = (model.turning_ability_1_s * (rudder_rad - m.bias_rad) - cubic * m.yaw_rate_rad_s) / divisor
    heading_rad = m.heading_rad + steady_rad_s * (step_s - reach_s) + m.yaw_rate_rad_s * reach_s
    yaw_rate_rad_s = steady_rad_s + (m.yaw_rate_rad_s - steady_rad_s) * decay
    bias_gain, bias_reach = ability_1_s * (1.0 - decay), ability_1_s * (step_s - reach_s)
    rate_reach, rate_keep = reach_s - cubic_slope * (step_s - reach_s), decay - cubic_slope * (1.0 - decay)
    diffusion = math.exp(levels.diffusion) / (divisor * divisor)
    q00 = diffusion * (step_s - 2.0 * reach_s + 0.5 * lag_s * (1.0 - decay * decay))
    q01 = 0.5 * diffusion * (1.0 - decay) * (1.0 - decay)
    q11 = diffusion * (1.0 - decay * decay) / (2.0 * lag_s)
    q22 = math.exp(2.0 * levels.bias_walk) * step_s
    # Wave: F = [[ww, wv], [vw, vv]]; the noise keeps its variances stationary.
    omega, damping = TWO_PI * math.exp(-levels.wave_period), math.exp(levels.wave_damping)
    damped_omega = omega * math.sqrt(1.0 - damping * damping)
    wave_decay = math.exp(-damping * omega * step_s)
    cosine, sine = (
        wave_decay * math.cos(damped_omega * step_s),
        wave_decay * math.sin(damped_omega * step_s) / damped_omega,
    )
    ww, wv = cosine + damping * omega * sine, sine
    vw, vv = -omega * omega * sine, cosine - damping * omega * sine
    wave_variance = math.exp(2.0 * levels.wave_sd)
    rate_variance = wave_variance * omega * omega
    q33 = wave_variance - ww * ww * wave_variance - wv * wv * rate_variance
    q34 = -ww * vw * wave_variance - wv * vv * rate_variance
    q44 = rate_variance - vw * vw * wave_variance - vv * vv * rate_variance
    # F P, then F P F' + Q.
    a00 = m.p00 + rate_reach * m.p01 - bias_reach * m.p02
    a01 = m.p01 + rate_reach * m.p11 - bias_reach * m.p12
    a02 = m.p02 + rate_reach * m.p12 - bias_reach * m.p22
    a03 = m.p03 + rate_reach * m.p13 - bias_reach * m.p23
    a04 = m.p04 + rate_reach * m.p14 - bias_reach * m.p24
    a11 = rate_keep * m.p11 - bias_gain * m.p12
    a12 = rate_keep * m.p12 - bias_gain * m.p22
    a13 = rate_keep * m.p13 - bias_gain * m.p23
    a14 = rate_keep * m.p14 - bias_gain * m.p24
    a33 = ww * m.p33 + wv * m.p34
    a34 = ww * m.p34 + wv * m.p44
    a43 = vw * m.p33 + vv * m.p34
    a44 = vw * m.p34 + vv * m.p44
    return Motion(
        heading_rad, yaw_rate_rad_s, m.bias_rad,
        ww * m.wave_rad + wv * m.wave_rate_rad_s, vw * m.wave_rad + vv * m.wave_rate_rad_s,
        a00 + rate_reach * a01 - bias_reach * a02 + q00, rate_keep * a01 - bias_gain * a02 + q01, a02,
        ww * a03 + wv * a04, vw * a03 + vv * a04,
        rate_keep * a11 - bias_gain * a12 + q11, a12, ww * a13 + wv * a14, vw * a13 + vv * a14,
        m.p22 + q22, ww * m.p23 + wv * m.p24, vw * m.p23 + vv * m.p24,
        ww * a33 + wv * a34 + q33, vw * a33 + vv * a34 + q34, vw * a43 + vv * a44 + q44,
    )  # fmt: skip


def apply_gain(m: Motion, k0: float, k1: float, k2: float, k3: float, k4: float, scale: float, weight: float) -> Motion:
    """Return x + k scale, P - k k' weight: k = P H', weight = 1 / innovation variance, scale = weight innovation."""
    return Motion(
        m.heading_rad + k0 * scale, m.yaw_rate_rad_s + k1 * scale, m.bias_rad + k2 * scale,
        m.wave_rad + k3 * scale, m.wave_rate_rad_s + k4 * scale,
        m.p00 - k0 * k0 * weight, m.p01 - k0 * k1 * weight, m.p02 - k0 * k2 * weight,
        m.p03 - k0 * k3 * weight, m.p04 - k0 * k4 * weight,
        m.p11 - k1 * k1 * weight, m.p12 - k1 * k2 * weight, m.p13 - k1 * k3 * weight, m.p14 - k1 * k4 * weight,
        m.p22 - k2 * k2 * weight, m.p23 - k2 * k3 * weight, m.p24 - k2 * k4 * weight,
        m.p33 - k3 * k3 * weight, m.p34 - k3 * k4 * weight,
        m.p44 - k4 * k4 * weight,
    )  # fmt: skip


def correct(m: Motion, levels: NoiseLevels, heading_rad: float) -> tuple[Motion, float, float]:
    """Return the state updated with a compass heading, the innovation [rad] and its variance [rad^2].

    For an innovation beyond OUTLIER_SQUARE the variance is raised until it is at that limit, so that the change of the
    state decreases with the size of the innovation.
    """
    k0, k1, k2, k3, k4 = m.p00 + m.p03, m.p01 + m.p13, m.p02 + m.p23, m.p03 + m.p33, m.p04 + m.p34
    variance = k0 + k3 + math.exp(2.0 * levels.compass_noise)
    innovation_rad = wrap_pi(heading_rad - m.heading_rad - m.wave_rad)
    weight = 1.0 / max(variance, innovation_rad * innovation_rad / OUTLIER_SQUARE)
    scale = innovation_rad * weight
    return apply_gain(m, k0, k1, k2, k3, k4, scale, weight), innovation_rad, variance


def log_likelihood(innovation_rad: float, variance: float) -> float:
    """Return the log-likelihood of an innovation without the constant; its square is limited to OUTLIER_SQUARE."""
    return -0.5 * (math.log(variance) + min(innovation_rad * innovation_rad / variance, OUTLIER_SQUARE))


def with_unexplained_turn(m: Motion) -> Motion:
    """Return the state with larger variances of yaw rate and bias, for a turn that the model does not explain."""
    return Motion(
        m.heading_rad, m.yaw_rate_rad_s, m.bias_rad, m.wave_rad, m.wave_rate_rad_s,
        m.p00, m.p01, m.p02, m.p03, m.p04,
        m.p11 + UNEXPLAINED_RATE_VARIANCE, m.p12, m.p13, m.p14,
        m.p22 + UNEXPLAINED_BIAS_VARIANCE, m.p23, m.p24,
        m.p33, m.p34, m.p44,
    )  # fmt: skip


def is_valid(m: Motion) -> bool:
    """Return whether state and variances are finite and the variances positive."""
    mean_sum = m.heading_rad + m.yaw_rate_rad_s + m.bias_rad + m.wave_rad + m.wave_rate_rad_s
    variance_sum = m.p00 + m.p11 + m.p22 + m.p33 + m.p44
    min_variance = min(m.p00, m.p11, m.p22, m.p33, m.p44)
    return math.isfinite(mean_sum) and math.isfinite(variance_sum) and min_variance > 0.0


def correct_course(m: Motion, heading_rad: float, sd_rad: float) -> Motion:
    """Return the state updated with a heading that contains no wave yaw and has the standard deviation sd_rad."""
    k0, k1, k2, k3, k4 = m.p00, m.p01, m.p02, m.p03, m.p04
    innovation_rad = wrap_pi(heading_rad - m.heading_rad)
    weight = 1.0 / max(k0 + sd_rad * sd_rad, innovation_rad * innovation_rad / OUTLIER_SQUARE)
    return apply_gain(m, k0, k1, k2, k3, k4, innovation_rad * weight, weight)


def correct_rate(m: Motion, yaw_rate_rad_s: float, noise_variance: float) -> tuple[Motion, float, float]:
    """Return the state updated with a gyroscope's yaw rate (with waves), the innovation [rad/s] and its variance."""
    k0, k1, k2, k3, k4 = m.p01 + m.p04, m.p11 + m.p14, m.p12 + m.p24, m.p13 + m.p34, m.p14 + m.p44
    variance = k1 + k4 + noise_variance
    innovation_rad_s = yaw_rate_rad_s - m.yaw_rate_rad_s - m.wave_rate_rad_s
    weight = 1.0 / max(variance, innovation_rad_s * innovation_rad_s / OUTLIER_SQUARE)
    return apply_gain(m, k0, k1, k2, k3, k4, innovation_rad_s * weight, weight), innovation_rad_s, variance


def extrapolate(m: Motion, model: KtModel, rudder_rad: float, step_s: float) -> tuple[float, float]:
    """Return heading [rad] and yaw rate [rad/s] after a step, without their covariance."""
    divisor, cubic, _ = held_cubic(model.turning_lag_s, model.norrbin_s2, m.yaw_rate_rad_s, step_s)
    lag_s = model.turning_lag_s / divisor
    steady_rad_s = (model.turning_ability_1_s * (rudder_rad - m.bias_rad) - cubic * m.yaw_rate_rad_s) / divisor
    turned_rad, yaw_rate_rad_s = exact_step(m.yaw_rate_rad_s, steady_rad_s, decay_over(step_s, lag_s), step_s, lag_s)
    return m.heading_rad + turned_rad, yaw_rate_rad_s
