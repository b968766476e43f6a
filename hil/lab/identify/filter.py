"""Likelihood of a recording: the autopilot's own Kalman filter of the heading with a known rudder.

State, transition and updates are those of firmware_py/estimate/heading_model.py. Here the cubic term is linearised at
the yaw rate at the start of each step (exponential Rosenbrock step: Hochbruck and Ostermann, Acta Numerica 19, 2010),
which is stable for any step and any alpha.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_py.model.kt import KtModel
from hil.lab.compiled import compiled
from hil.lab.identify.recording import Floats
from hil.lab.numeric_core import Motion, NoiseLevels, heading_model, inner, kt

# Indices of the unknowns. K, T and the noise levels are natural logarithms. OFFSET is delta0 [rad], DELAY and LAG are
# dead time and lag of the rudder [s], EXPONENT is the exponent of the speed.
LN_K, LN_T, ALPHA, OFFSET, DELAY, LAG, EXPONENT, DIFFUSION, WAVE, PERIOD, DAMPING, COMPASS, WALK, GYRO = range(14)
UNKNOWN_COUNT = 14

OUTLIER_SQUARE = heading_model.OUTLIER_SQUARE
UNKNOWN_RATE_VARIANCE = 1.0  # (rad/s)^2, at the first row of a recording without yaw rates
BIAS_MEMORY_S = 300.0  # the initial bias variance is that of a random walk of this duration from delta0


@inner
def advance(
    m: Motion, levels: NoiseLevels, gain_1_s: float, lag_s: float, alpha_s2: float, rudder_rad: float, step_s: float
) -> Motion:
    """Predict the state over one step, with the cubic term linearised at the start of the step."""
    rate = m.yaw_rate_rad_s
    cubic = alpha_s2 * rate * rate
    slope = 1.0 + 3.0 * cubic
    # Keeps the disturbance of dr/dt, sqrt(D) / T, when T is scaled.
    diffusion = levels.diffusion - 2.0 * math.log(slope)
    scaled = NoiseLevels(
        diffusion, levels.wave_sd, levels.wave_period, levels.wave_damping, levels.compass_noise, levels.bias_walk
    )
    model = KtModel(gain_1_s / slope, lag_s / slope, 0.0, 0.0, 1.0)
    return heading_model.predict(m, scaled, model, rudder_rad + 2.0 * cubic * rate / gain_1_s, step_s)


@compiled
def innovations(
    values: Floats,
    sign: float,
    step_s: Floats,
    is_first: NDArray[np.bool_],
    measured: Floats,
    rudder_rad: Floats,
    speed_ratio: Floats,
    use_headings: bool,  # noqa: FBT001 - numba takes no keywords
    out: Floats,
) -> None:
    """Compute the innovations and their variances into `out`, (2, rows).

    sign: that of K. is_first: the first rows of stretches. measured: headings, or yaw rates. rudder_rad: the mean over
    the interval that ends at each row.
    """
    levels = NoiseLevels(
        values[DIFFUSION], values[WAVE], values[PERIOD], values[DAMPING], values[COMPASS], values[WALK]
    )
    walk, gyro = math.exp(2.0 * values[WALK]), math.exp(2.0 * values[GYRO])
    gain_1_s, lag_s, alpha_s2 = sign * math.exp(values[LN_K]), math.exp(values[LN_T]), values[ALPHA]
    m = start = heading_model.begin(0.0, levels)
    for row in range(step_s.shape[0]):
        if is_first[row]:
            heading, rate = (measured[row], 0.0) if use_headings else (0.0, measured[row])
            rate_variance = UNKNOWN_RATE_VARIANCE if use_headings else gyro + start.p44
            m = heading_model.begin_at(heading, rate, rate_variance, values[OFFSET], walk * BIAS_MEMORY_S, levels)
        else:
            ratio = speed_ratio[row] ** values[EXPONENT]
            gain, lag, alpha = gain_1_s * ratio, lag_s / ratio, alpha_s2 / (ratio * ratio)
            m = advance(m, levels, gain, lag, alpha, rudder_rad[row], step_s[row])
        if use_headings:
            m, out[0, row], out[1, row] = heading_model.correct(m, levels, measured[row])
        else:
            m, out[0, row], out[1, row] = heading_model.correct_rate(m, measured[row], gyro)


@compiled
def add_derivatives(base: Floats, moved: Floats, change: Floats, gradient: Floats, information: Floats) -> None:
    """Add the gradient and the Fisher information of minus the log-likelihood, by finite differences.

    base: (2, rows), innovations and variances. moved: (unknowns, 2, rows), with one unknown changed by its `change`.
    """
    count = moved.shape[0]
    innovation_slopes, variance_slopes = np.zeros(count), np.zeros(count)
    for row in range(base.shape[1]):
        variance = base[1, row]
        spread = math.sqrt(variance)
        z = base[0, row] / spread
        is_inlier = z * z <= OUTLIER_SQUARE
        for i in range(count):
            variance_slopes[i] = (moved[i, 1, row] - variance) / change[i] / variance
            innovation_slopes[i] = (moved[i, 0, row] - base[0, row]) / change[i] / spread if is_inlier else 0.0
        for i in range(count):
            gradient[i] += (
                0.5 * variance_slopes[i] * (1.0 - z * z) + z * innovation_slopes[i]
                if is_inlier
                else variance_slopes[i] / 2
            )
            for j in range(i + 1):
                information[i, j] += (
                    innovation_slopes[i] * innovation_slopes[j] + 0.5 * variance_slopes[i] * variance_slopes[j]
                )


@compiled
def apply_lag(mean_rad: Floats, step_s: Floats, is_first: NDArray[np.bool_], lag_s: float, out: Floats) -> None:
    """Compute the means after a first-order lag into `out`; the lag starts each stretch at its first input."""
    lagged = 0.0
    for row in range(step_s.shape[0]):
        if is_first[row]:
            lagged = out[row] = mean_rad[row]
            continue
        decay = math.exp(-step_s[row] / lag_s)
        out[row] = mean_rad[row] + (lagged - mean_rad[row]) * (1.0 - decay) * lag_s / step_s[row]
        lagged = mean_rad[row] + (lagged - mean_rad[row]) * decay


def model_of(values: Floats, sign: float) -> Floats:
    """Return K, T, alpha, delta0 and the exponent of the speed from the unknowns."""
    return np.array([sign * math.exp(values[LN_K]), math.exp(values[LN_T]), *values[[ALPHA, OFFSET, EXPONENT]]])


@compiled
def simulate(
    model: Floats,
    starts_rad_s: Floats,
    step_s: Floats,
    is_first: NDArray[np.bool_],
    rudder_rad: Floats,
    speed_ratio: Floats,
    out: Floats,
) -> None:
    """Compute heading and yaw rate from the rudder alone into `out`, (2, rows); each stretch starts at heading 0.

    model: see model_of. starts_rad_s: the first yaw rate of each stretch.
    """
    heading = rate = 0.0
    stretch = -1
    for row in range(step_s.shape[0]):
        if is_first[row]:
            stretch += 1
            heading, rate = 0.0, starts_rad_s[stretch]
        else:
            ratio = speed_ratio[row] ** model[4]
            gain, lag, alpha = model[0] * ratio, model[1] / ratio, model[2] / (ratio * ratio)
            steps = min(max(math.ceil(4.0 * step_s[row] / lag), 1), 20)
            step = step_s[row] / steps
            for _ in range(steps):
                cubic = alpha * rate * rate
                slope = 1.0 + 3.0 * cubic
                steady = (gain * (rudder_rad[row] - model[3]) + 2.0 * cubic * rate) / slope
                decay = kt.decay_over(step, lag / slope)
                heading_change, rate = kt.exact_step(rate, steady, decay, step, lag / slope)
                heading += heading_change
        out[0, row], out[1, row] = heading, rate
