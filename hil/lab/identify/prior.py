"""Prior density of the unknowns; it is wide, so that it matters only if the log contains little information.

By similarity (paper eq. 7) the products K T = K'T' and alpha K^2 = alpha' K'^2 do not depend on a boat's length and
speed. Published hulls:

    hull                                             K T        alpha K^2
    Ocean Rambler (Wang et al. 2018)                 0.2        0.04
    Zeefakkel, 45 m (van Amerongen 1982)             5 to 36    0.01 to 0.28
    Mariner class (Kempf; Fossen 2011)               20         -

So ln (K T) is normal with mean 0 and standard deviation 2, and ln T normal around 5 s with standard deviation 2, which
includes model boats. The density of alpha K^2 is constant up to 0.5 and then decreases as its inverse: a tanker that is
almost unstable on course (KVLCC2) has large K and T, and an alpha that limits its turns. Dead time and lag of the
rudder are probably small compared with T. The means of the noise levels are those of the autopilot's own filter
(heading_filter.py), with a larger spread.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from firmware_py.common.angles import radians
from hil.lab.identify.filter import (
    ALPHA,
    COMPASS,
    DAMPING,
    DELAY,
    DIFFUSION,
    EXPONENT,
    GYRO,
    LAG,
    LN_K,
    LN_T,
    OFFSET,
    PERIOD,
    UNKNOWN_COUNT,
    WALK,
    WAVE,
)
from hil.lab.identify.recording import Floats

ALPHA_SCALE = 0.5  # limit of alpha K^2 up to which its density is constant
DELAY_SD, LAG_SD = 0.3, 0.2  # standard deviations relative to T; that of the delay is one row larger
# Within T, or ten rows, the rudder bias changes by at most this fraction of the rudder's spread. Otherwise a bias
# that follows every model error would give the best prediction of the next row.
MAX_WALK, MIN_WALK_ROWS = 0.02, 10.0
_DEG = radians(1.0)
_ANY = 1e9
# Bounds of the unknowns, in the order of their indices in filter.py.
LOW = np.array([
    -9.0, -4.5, 0.0, -0.6, -_ANY, 0.0, -1.0, 2.0 * math.log(0.003 * _DEG), math.log(0.01 * _DEG), math.log(0.3),
    math.log(0.04), math.log(0.005 * _DEG), math.log(0.001 * _DEG), math.log(0.001 * _DEG),
])  # fmt: skip
HIGH = np.array([
    3.5, 7.5, _ANY, 0.6, _ANY, _ANY, 2.0, 2.0 * math.log(14.0 * _DEG), math.log(40.0 * _DEG), math.log(25.0),
    math.log(0.8), math.log(5.0 * _DEG), math.log(6.0 * _DEG), math.log(20.0 * _DEG),
])  # fmt: skip
MEAN_LAG_S = 5.0
# unknown -> mean, standard deviation
MEANS_AND_SDS = {
    LN_T: (math.log(MEAN_LAG_S), 2.0),
    OFFSET: (0.0, 0.15),
    EXPONENT: (1.0, 0.3),
    DIFFUSION: (2.0 * math.log(_DEG), 2.5),
    WAVE: (math.log(_DEG), 1.5),
    PERIOD: (math.log(2.8), 0.7),
    DAMPING: (math.log(0.2), 0.6),
    COMPASS: (math.log(0.1 * _DEG), 1.0),
    WALK: (math.log(0.03 * _DEG), 1.2),
    GYRO: (math.log(0.1 * _DEG), 1.5),
}


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal density of weights @ v - means, except for alpha; low and high bound the unknowns v."""

    weights: Floats
    means: Floats
    low: Floats
    high: Floats
    constant: float  # added to the cost, so that priors for different T can be compared

    @classmethod
    def of(cls, lag_s: float, row_s: float, rudder_spread_rad: float) -> Prior:
        """Return the prior; `lag_s` is a value near T that scales delay, lag and bias walk."""
        means_and_sds = MEANS_AND_SDS | {DELAY: (0.0, row_s + DELAY_SD * lag_s), LAG: (0.0, LAG_SD * lag_s)}
        weights, means = np.zeros((len(means_and_sds) + 1, UNKNOWN_COUNT)), np.zeros(len(means_and_sds) + 1)
        for row, (index, (mean, sd)) in enumerate(means_and_sds.items()):
            weights[row, index], means[row] = 1.0 / sd, mean / sd
        weights[-1, LN_K] = weights[-1, LN_T] = 0.5
        low, high = LOW.copy(), HIGH.copy()
        low[DELAY], high[DELAY], high[LAG] = -row_s, row_s + 3.0 * lag_s, lag_s
        walk_time_s = max(lag_s, MIN_WALK_ROWS * row_s)
        high[WALK] = max(math.log(MAX_WALK * rudder_spread_rad / math.sqrt(walk_time_s)), low[WALK] + 0.1)
        constant = sum(math.log(means_and_sds[index][1]) for index in (DELAY, LAG))
        return cls(weights, means, low, high, constant)

    def start(self, gain_1_s: float, lag_s: float) -> Floats:
        """Return the mean of the prior, except for K and T."""
        values = np.zeros(UNKNOWN_COUNT)
        for index, (mean, _) in MEANS_AND_SDS.items():
            values[index] = mean
        values[LN_K], values[LN_T] = math.log(gain_1_s), math.log(lag_s)
        return np.clip(values, self.low, self.high)

    def residuals(self, values: Floats) -> Floats:
        """Return the residuals, one more than weights; the cost is half the sum of their squares plus the constant."""
        return np.append(self.weights @ values - self.means, math.sqrt(math.log1p(_scaled_cubic(values) ** 2)))

    def cost(self, values: Floats) -> float:
        """Return minus the logarithm of the density."""
        residuals = self.residuals(values)
        return 0.5 * float(residuals @ residuals) + self.constant

    def derivatives(self, values: Floats) -> tuple[Floats, Floats]:
        """Return gradient and curvature (Gauss-Newton) of the cost."""
        scaled_cubic = _scaled_cubic(values)
        slope = np.zeros(UNKNOWN_COUNT)
        slope[ALPHA], slope[LN_K] = math.exp(2.0 * values[LN_K]) / ALPHA_SCALE, 2.0 * scaled_cubic
        weight = 1.0 / (1.0 + scaled_cubic * scaled_cubic)
        gradient = self.weights.T @ (self.weights @ values - self.means) + weight * scaled_cubic * slope
        return gradient, self.weights.T @ self.weights + weight * np.outer(slope, slope)


def _scaled_cubic(values: Floats) -> float:
    """Return alpha K^2 / ALPHA_SCALE."""
    return float(values[ALPHA]) * math.exp(2.0 * float(values[LN_K])) / ALPHA_SCALE
