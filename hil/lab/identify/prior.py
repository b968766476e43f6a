"""Prior of the unknowns: wide, so that it matters only where the log contains little information.

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
    UNKNOWNS,
    WALK,
    WAVE,
)
from hil.lab.identify.recording import Floats

ALPHA_SCALE = 0.5  # of alpha K^2
DELAY_SHARE, LAG_SHARE = 0.3, 0.2  # standard deviations relative to T; the delay has one row in addition
# The rudder bias changes slowly: within T, or ten rows, by at most this share of the rudder's spread. Otherwise a bias
# that follows every model error would give the best prediction of the next row.
WALK_SHARE, SLOW_ROWS = 0.02, 10.0
DEGREE = radians(1.0)
_ANY = 1e9
LOW = np.array([
    -9.0, -4.5, 0.0, -0.6, -_ANY, 0.0, -1.0, 2.0 * math.log(0.003 * DEGREE), math.log(0.01 * DEGREE), math.log(0.3),
    math.log(0.04), math.log(0.005 * DEGREE), math.log(0.001 * DEGREE), math.log(0.001 * DEGREE),
])  # fmt: skip
HIGH = np.array([
    3.5, 7.5, _ANY, 0.6, _ANY, _ANY, 2.0, 2.0 * math.log(14.0 * DEGREE), math.log(40.0 * DEGREE), math.log(25.0),
    math.log(0.8), math.log(5.0 * DEGREE), math.log(6.0 * DEGREE), math.log(20.0 * DEGREE),
])  # fmt: skip
MIDDLE_LAG_S = 5.0
# unknown -> middle, standard deviation
SINGLE = {
    LN_T: (math.log(MIDDLE_LAG_S), 2.0),
    OFFSET: (0.0, 0.15),
    EXPONENT: (1.0, 0.3),
    DIFFUSION: (2.0 * math.log(DEGREE), 2.5),
    WAVE: (math.log(DEGREE), 1.5),
    PERIOD: (math.log(2.8), 0.7),
    DAMPING: (math.log(0.2), 0.6),
    COMPASS: (math.log(0.1 * DEGREE), 1.0),
    WALK: (math.log(0.03 * DEGREE), 1.2),
    GYRO: (math.log(0.1 * DEGREE), 1.5),
}


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal except for alpha: sum of squares of weights v - middles; and the bounds of the unknowns v."""

    weights: Floats
    middles: Floats
    low: Floats
    high: Floats
    constant: float  # of the cost, to compare priors with different T

    @classmethod
    def of(cls, lag_s: float, row_s: float, rudder_spread_rad: float) -> Prior:
        """Return the prior; `lag_s` is about T and scales delay, lag and bias walk."""
        single = SINGLE | {DELAY: (0.0, row_s + DELAY_SHARE * lag_s), LAG: (0.0, LAG_SHARE * lag_s)}
        weights, middles = np.zeros((len(single) + 1, UNKNOWNS)), np.zeros(len(single) + 1)
        for row, (place, (middle, spread)) in enumerate(single.items()):
            weights[row, place], middles[row] = 1.0 / spread, middle / spread
        weights[-1, LN_K] = weights[-1, LN_T] = 0.5
        low, high = LOW.copy(), HIGH.copy()
        low[DELAY], high[DELAY], high[LAG] = -row_s, row_s + 3.0 * lag_s, lag_s
        slow_s = max(lag_s, SLOW_ROWS * row_s)
        high[WALK] = max(math.log(WALK_SHARE * rudder_spread_rad / math.sqrt(slow_s)), low[WALK] + 0.1)
        constant = sum(math.log(single[place][1]) for place in (DELAY, LAG))
        return cls(weights, middles, low, high, constant)

    def start(self, gain_1_s: float, lag_s: float) -> Floats:
        """Return the mean of the prior, except for K and T."""
        values = np.zeros(UNKNOWNS)
        for place, (middle, _) in SINGLE.items():
            values[place] = middle
        values[LN_K], values[LN_T] = math.log(gain_1_s), math.log(lag_s)
        return np.clip(values, self.low, self.high)

    def residuals(self, values: Floats) -> Floats:
        """Return residuals (weights + 1,): the cost is half the sum of their squares, plus the constant."""
        return np.append(self.weights @ values - self.middles, math.sqrt(math.log1p(_cubic(values) ** 2)))

    def cost(self, values: Floats) -> float:
        """Return minus the logarithm of the density."""
        off = self.residuals(values)
        return 0.5 * float(off @ off) + self.constant

    def derivatives(self, values: Floats) -> tuple[Floats, Floats]:
        """Return gradient and curvature of the cost."""
        cubic = _cubic(values)
        slope = np.zeros(UNKNOWNS)
        slope[ALPHA], slope[LN_K] = math.exp(2.0 * values[LN_K]) / ALPHA_SCALE, 2.0 * cubic
        weight = 1.0 / (1.0 + cubic * cubic)
        gradient = self.weights.T @ (self.weights @ values - self.middles) + weight * cubic * slope
        return gradient, self.weights.T @ self.weights + weight * np.outer(slope, slope)


def _cubic(values: Floats) -> float:
    """Return alpha K^2 in its scale."""
    return float(values[ALPHA]) * math.exp(2.0 * float(values[LN_K])) / ALPHA_SCALE
