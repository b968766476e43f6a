"""Whittle's recursion (Biometrika 50, 1963): autoregressions of every order in turn, from covariances, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.identify.recording import Floats


@compiled
def _determinant(matrix: Floats) -> float:
    """Return the determinant of a (1, 1) or (2, 2) matrix."""
    if matrix.shape[0] == 1:
        return float(matrix[0, 0])
    return float(matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0])


@compiled
def _solve(right: Floats, matrix: Floats, result: Floats) -> None:
    """Fill result with -right matrix^-1, of (1, 1) or (2, 2) matrices."""
    scale = -1.0 / _determinant(matrix)
    if matrix.shape[0] == 1:
        result[0, 0] = scale * right[0, 0]
        return
    for i in range(2):
        result[i, 0] = scale * (right[i, 0] * matrix[1, 1] - right[i, 1] * matrix[1, 0])
        result[i, 1] = scale * (right[i, 1] * matrix[0, 0] - right[i, 0] * matrix[0, 1])


@compiled
def whittle(gamma: NDArray[np.float64], rows: int, lags: NDArray[np.float64], covariance: Floats) -> int:
    """Return the order that AIC chooses, with its autoregression in lags and what it leaves in covariance.

    Args:
        gamma: covariances sum_t e[t] e[t - lag]' / rows for lag 0 on, (lags, channels, channels), channels 1 or 2.
        rows: how many they are the means of.
        lags: the result, (lags - 1, channels, channels), of which the first order ones are filled.
        covariance: the result, (channels, channels).
    """
    channels = gamma.shape[1]
    forward, backward = np.zeros(lags.shape), np.zeros(lags.shape)
    old, was = np.zeros(lags.shape), np.zeros(lags.shape)
    ahead, behind = gamma[0].copy(), gamma[0].copy()
    front, back, rest = np.zeros(covariance.shape), np.zeros(covariance.shape), np.zeros(covariance.shape)
    best = 0
    covariance[:] = ahead
    determinant = _determinant(ahead)
    least = rows * np.log(determinant) if determinant > 0.0 else np.inf
    for order in range(1, gamma.shape[0]):
        # What the present order leaves unexplained one lag further.
        rest[:] = gamma[order]
        for k in range(order - 1):
            for i in range(channels):
                for j in range(channels):
                    for m in range(channels):
                        rest[i, m] += forward[k, i, j] * gamma[order - 1 - k, j, m]
        _solve(rest, behind, front)
        _solve(rest.T, ahead, back)
        old[:], was[:] = forward, backward
        for k in range(order - 1):
            for i in range(channels):
                for j in range(channels):
                    for m in range(channels):
                        forward[k, i, m] += front[i, j] * was[order - 2 - k, j, m]
                        backward[k, i, m] += back[i, j] * old[order - 2 - k, j, m]
        forward[order - 1], backward[order - 1] = front, back
        for i in range(channels):
            for j in range(channels):
                for m in range(channels):
                    ahead[i, m] += front[i, j] * rest[m, j]
                    behind[i, m] += back[i, j] * rest[j, m]
        determinant = _determinant(ahead)
        if not determinant > 0.0:
            break
        value = rows * np.log(determinant) + 2.0 * order * channels * channels
        if value < least:
            least, best = value, order
            lags[:order] = forward[:order]
            covariance[:] = 0.5 * (ahead + ahead.T)
    return best
