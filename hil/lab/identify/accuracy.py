"""How sure a fit is: covariances that hold for coloured noise, and the channel weights that make them least.

The estimate minimises sum_c w_c e_c' e_c. Its covariance is A^-1 B A^-1 with A = sum_c w_c J_c' J_c and
B = sum_cd w_c w_d J_c' C_cd J_d, C being the covariance of the noise over time and between the channels.
With white noise and the right weights this is the Cramer-Rao bound, A^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.lab.identify.noise import NoiseModel, fit_noise, score_covariances, slower
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import Linear, Normal, Problem, State

SHARES = (0.0, *np.geomspace(1e-5, 1e5, 31).tolist(), np.inf)


@dataclass(frozen=True, slots=True)
class Information:
    """What the channels say of the parameters: `own` J_c'J_c (channels, n, n), `mixed` J_c'C_cd J_d.

    n counts the free parameters first, then the starts of all stretches; `free` is the former's number.
    """

    own: NDArray[np.float64]
    mixed: NDArray[np.float64]
    free: int
    noise: NoiseModel
    rows: int

    def covariance(self, weights: tuple[float, ...]) -> Floats:
        """Return the covariance of the free parameters for given weights of the channels."""
        return np.asarray(self.covariances(np.array([weights]))[0])

    def inverse(self, weights: tuple[float, ...]) -> Floats:
        """Return the part of the free parameters of the inverse of A: what the covariance were, the weights right."""
        a = np.einsum("c,cij->ij", np.array(weights), self.own)
        return np.asarray(_inverse(a[None])[0][: self.free, : self.free])

    def solved(self, weights: tuple[float, ...], slope: Floats) -> Floats:
        """Return A^-1 slope: the Gauss-Newton step of all parameters."""
        a = np.einsum("c,cij->ij", np.array(weights), self.own)
        return np.asarray(_inverse(a[None])[0] @ slope)

    def covariances(self, weights: Floats) -> NDArray[np.float64]:
        """Return the covariances of the free parameters (m, free, free) for weights (m, channels)."""
        robust, plain = self._covariances(weights)
        # Estimating parameters takes their share of the noise away from what is seen of it.
        rows = self._effective_rows(robust, plain)
        return np.asarray(robust * (rows / np.maximum(rows - self.free, 1.0))[:, None, None])

    def step(self, normal: Normal, weights: tuple[float, ...], place: int, spread: float) -> tuple[Floats, Floats]:
        """Return the Gauss-Newton step of the free parameters, one of them believed near its value, and the covariance.

        spread: the belief's standard deviation.
        """
        held = normal.matrix.copy()
        believed = self.rows / (spread**2 * self.effective_rows(weights))
        held[place, place] += believed
        diagonal = np.sqrt(np.maximum(np.diag(held), 1e-300))
        diagonal[diagonal < 1e-9 * diagonal.max()] = diagonal.max()
        scale = np.outer(diagonal, diagonal)
        inverse = np.linalg.inv(held / scale + 1e-13 * np.eye(diagonal.size)) / scale
        weight = np.array(weights)
        middle = np.einsum("c,d,cdij->ij", weight, weight, self.mixed)
        middle[place, place] += (believed * spread) ** 2
        covariance = inverse @ (0.5 * (middle + middle.T)) @ inverse
        return (inverse @ normal.slope)[: self.free], covariance[: self.free, : self.free]

    def effective_rows(self, weights: tuple[float, ...]) -> float:
        """Return how many readings of white noise would leave K and T as unsure as these leave them."""
        return float(self._effective_rows(*self._covariances(np.array([weights])))[0])

    def _effective_rows(self, robust: NDArray[np.float64], plain: NDArray[np.float64]) -> Floats:
        if self.free < 2:
            return np.full(robust.shape[0], float(self.rows))
        share = np.exp(0.5 * (_log_det(plain) - _log_det(robust)))
        return np.asarray(np.clip(self.rows * share, 2.0, self.rows))

    def _covariances(self, weights: Floats) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the covariances of the free parameters with the noise as it is, and were it white."""
        power = weights**2 * self.noise.spread**2
        a = np.einsum("mc,cij->mij", weights, self.own)
        b = np.einsum("mc,md,cdij->mij", weights, weights, self.mixed)
        inverse = _inverse(a)
        robust, plain = (
            (inverse @ (0.5 * (middle + middle.transpose(0, 2, 1))) @ inverse)[:, : self.free, : self.free]
            for middle in (b, np.einsum("mc,cij->mij", power, self.own))
        )
        return robust, plain


def _inverse(a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert matrices (m, n, n), of which some rows may be as good as empty."""
    diagonal = np.sqrt(np.maximum(np.diagonal(a, axis1=1, axis2=2), 1e-300))
    largest = diagonal.max(axis=1, keepdims=True)
    diagonal = np.where(diagonal < 1e-9 * largest, largest, diagonal)
    scale = diagonal[:, :, None] * diagonal[:, None, :]
    return np.asarray(np.linalg.inv(a / scale + 1e-13 * np.eye(diagonal.shape[1])) / scale)


def _log_det(covariances: NDArray[np.float64]) -> Floats:
    """Return the logarithms of the determinants of the part of K and T."""
    return np.asarray(np.linalg.slogdet(covariances[:, :2, :2] + 1e-300 * np.eye(2))[1])


def linearised(problem: Problem, state: State) -> list[Linear]:
    """Linearise all stretches around a fit."""
    parts = zip(problem.data.stretches, state.starts, strict=True)
    return [problem.linear(stretch, state, start) for stretch, start in parts]


def information(problem: Problem, state: State, noise: NoiseModel | None = None) -> Information:
    """Linearise around a fit and model the noise that it leaves, if none is given."""
    linears = linearised(problem, state)
    if noise is None:
        noise = fit_noise(_coloured(problem, linears))
    return information_of(linears, len(problem.free), noise, problem.data.rows)


def information_of(linears: Sequence[Linear], free: int, noise: NoiseModel, rows: int) -> Information:
    """Sum up what stretches say of so many free parameters, which come first in their slopes."""
    size, channels = free + 2 * len(linears), len(linears[0].errors)
    own = np.zeros((channels, size, size))
    mixed = np.zeros((channels, channels, size, size))
    for index, linear in enumerate(linears):
        at = np.ix_(*[[*range(free), free + 2 * index, free + 2 * index + 1]] * 2)
        mixed_here = score_covariances(noise, linear.slopes)
        for c in range(channels):
            own[c][at] += linear.slopes[c].T @ linear.slopes[c]
            for d in range(channels):
                mixed[c, d][at] += mixed_here[c, d]
    return Information(own, mixed, free, noise, rows)


def slow_noise(problem: Problem, state: State, noise: NoiseModel, *, cautious: bool = False) -> NoiseModel:
    """Complete the model of the noise that a fit leaves by what its averages say of slow disturbances."""
    pieces = _coloured(problem, linearised(problem, state))
    return slower(noise, pieces, problem.data.usual_step_s, cautious=cautious)


def _coloured(problem: Problem, linears: Sequence[Linear]) -> list[Floats]:
    """Return the errors (rows, channels) of stretches but for the first rows, which lack a past to be filtered by."""
    skip = problem.weights.heading_lags.size
    return [np.column_stack(linear.errors)[skip:] for linear in linears]


def best_weights(known: Information) -> tuple[float, ...]:
    """Return the channel weights, heading first, that make K and T surest given the noise as it is.

    For white noise these are the reciprocal variances; a heading that drifts away from the
    model counts for nothing beside a yaw rate, and a yaw rate full of waves for little.
    """
    power = 1.0 / np.maximum(known.noise.spread**2, 1e-300)
    if power.size == 1:
        return (float(power[0]),)
    pairs = np.array([(power[0], 0.0) if share == np.inf else (power[0] * share, power[1]) for share in SHARES])
    signs, values = np.linalg.slogdet(known.covariances(pairs)[:, :2, :2])
    values = np.where((signs > 0) & np.isfinite(values), values, np.inf)
    best = pairs[int(np.argmin(values))] if np.isfinite(values).any() else power
    return (float(best[0]), float(best[1]))
