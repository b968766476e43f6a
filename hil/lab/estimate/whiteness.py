"""How white a series of innovations is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LAGS = 20
NORMAL_95 = 1.96
MOST_OUTSIDE = 0.2


@dataclass(frozen=True, slots=True)
class Whiteness:
    """The autocorrelation of neighbours, and the share of the first 20 autocorrelations outside of the 95 % band."""

    lag_one: float
    outside: float
    white: bool


def whiteness(series: NDArray[np.float64]) -> Whiteness:
    """Return the whiteness of a series, taken as it is, without subtracting its mean."""
    power = float(series @ series)
    if not power > 0.0:
        return Whiteness(0.0, 0.0, white=True)
    lags = min(LAGS, max(1, series.size // 4 - 1), series.size - 1)
    values = np.array([float(series[lag:] @ series[:-lag]) for lag in range(1, lags + 1)]) / power
    outside = float(np.mean(np.abs(values) > NORMAL_95 / np.sqrt(series.size)))
    return Whiteness(float(values[0]), outside, white=outside <= MOST_OUTSIDE)
