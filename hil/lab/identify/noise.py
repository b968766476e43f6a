"""The noise that a fit leaves: a vector autoregression, its spectrum, and what it does to standard errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hil.lab.identify.kernel import filter_columns
from hil.lab.identify.recording import Floats
from hil.lab.identify.whittle import whittle

MOST_ORDERS = 60
PADDING = 4096  # rows; how far a correlation reaches that is looked at
COARSER, LEAST_MEANS = 4, 60  # how much longer each average is than the one before; averages that tell a spectrum
DRIFT_AT, DRIFTS = (2.0, 16.0), 10.0  # cycles a log; times the density at the second, that a drift has at the first
LEAST_TIMES = 4.0  # that a correlation fits into the log
SLOW = 0.2  # cycles an average, below which the averages tell it
ROWS_PER_ORDER = 12  # fewer rows than this for each order do not tell one


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """e[t] + sum_k lags[k] e[t - k - 1] = white noise of the given covariance; e has one value a channel."""

    lags: NDArray[np.float64]  # (order, channels, channels)
    covariance: Floats  # of the white noise
    spread: Floats  # standard deviation of each channel of e
    slow: tuple[tuple[int, NoiseModel], ...] = ()  # rows averaged over, and a model of the last channel's averages
    step_s: float = 1.0
    rows: int = 1

    @property
    def order(self) -> int:
        """How many samples back it reaches; 0 for white noise."""
        return int(self.lags.shape[0])

    def surprise(self, pieces: Sequence[Floats]) -> float:
        """Return minus twice the logarithm of the likelihood of pieces (rows, channels), but for a constant."""
        inverse, total = np.linalg.inv(self.covariance), 0.0
        for piece in pieces:
            white = piece[self.order :].copy()
            for back, lag in enumerate(self.lags, start=1):
                white += piece[self.order - back : piece.shape[0] - back] @ lag.T
            total += float(np.einsum("ti,ij,tj->", white, inverse, white, optimize=True))
        return total

    def spectrum(self, count: int) -> NDArray[np.complex128]:
        """Return the covariance density of e at the count // 2 + 1 frequencies of a real FFT of that length."""
        channels = self.covariance.shape[0]
        taps = np.concatenate((np.eye(channels)[None], self.lags))
        response = np.fft.rfft(taps, count, axis=0)
        shape = _inverse(response)
        density = np.asarray(np.einsum("fij,jk,flk->fil", shape, self.covariance, np.conj(shape), optimize=True))
        for every, means in self.slow:
            share = np.arange(int(SLOW * count / every) + 1) / count
            grid = np.arange(PADDING // 2 + 1) / PADDING
            seen = every / np.interp(every * share, grid, 1.0 / means.spectrum(PADDING)[:, 0, 0].real)
            self._add_slow(density[: share.size], seen / np.sinc(every * share) ** 2, share)
        return density

    def _add_slow(self, low: NDArray[np.complex128], seen: Floats, share: Floats) -> None:
        """Raise the last channel to what its averages show, and with it a heading before it that is seen to drift.

        A fit keeps its heading from drifting off, so that both together seem to have no slow part.
        """
        more = np.maximum(seen - low[:, -1, -1].real, 0.0)
        if low.shape[1] > 1:
            at, above = (int(np.searchsorted(share, times / self.rows)) for times in DRIFT_AT)
            if above >= share.size or low[at, 0, 0].real < DRIFTS * low[above, 0, 0].real:
                return
        speed = 2j * np.pi * np.maximum(share, 0.5 / self.rows) / self.step_s
        ways = np.stack([1.0 / speed, np.ones(share.size)])[2 - low.shape[1] :]
        low += more[:, None, None] * np.einsum("if,jf->fij", ways, np.conj(ways))


def _inverse(matrices: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Invert (n, 1, 1) or (n, 2, 2) matrices, much faster than a general routine."""
    if matrices.shape[1] == 1:
        return 1.0 / matrices
    adjoint = np.empty_like(matrices)
    adjoint[:, 0, 0], adjoint[:, 1, 1] = matrices[:, 1, 1], matrices[:, 0, 0]
    adjoint[:, 0, 1], adjoint[:, 1, 0] = -matrices[:, 0, 1], -matrices[:, 1, 0]
    determinant = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return np.asarray(adjoint / determinant[:, None, None])


def fit_noise(pieces: Sequence[Floats], most_orders: int = MOST_ORDERS) -> NoiseModel:
    """Fit an autoregression to pieces (rows, channels) of a noise, its order chosen by AIC.

    AIC rather than BIC: what matters is the spectrum at low frequencies, which too short a model gets
    wrong, and a few orders too many hardly disturb.
    """
    channels = pieces[0].shape[1]
    rows = sum(piece.shape[0] for piece in pieces)
    most = max(0, min(most_orders, rows // (ROWS_PER_ORDER * channels), min(len(piece) for piece in pieces) - 2))
    scale = np.sqrt(np.maximum(sum(np.sum(piece**2, axis=0) for piece in pieces) / rows, 1e-300))
    scaled = [piece / scale for piece in pieces]
    gamma = _covariances(scaled, most, rows)
    gamma[0] += 1e-12 * np.eye(channels)
    lags, covariance = np.zeros((most, channels, channels)), np.zeros((channels, channels))
    lags = lags[: whittle(gamma, rows, lags, covariance)]
    turn = scale[:, None] / scale[None, :]
    return NoiseModel(lags * turn, covariance * np.outer(scale, scale), scale)


def slower(model: NoiseModel, pieces: Sequence[Floats], step_s: float, *, cautious: bool = False) -> NoiseModel:
    """Add to a model of pieces (rows, channels) those of the last channel's averages, which see further back.

    They are looked at alone: beside a heading that a fit has kept from drifting off, they seem to have no slow part.
    cautious: as an interval is stated by, with one standard error more of how long it lasts. The density at no
    frequency grows without bounds with that, so that too little makes an interval too short by far more than too much
    makes it too long.
    """
    rows, slow, every = sum(piece.shape[0] for piece in pieces), [], COARSER
    while rows // every >= LEAST_MEANS:
        means = [piece[: len(piece) // every * every, -1].reshape(-1, every).mean(axis=1) for piece in pieces]
        means = [mean[:, None] for mean in means if len(mean) * len(pieces) >= LEAST_MEANS]
        if means:
            slow.append((every, _less_biased(fit_noise(means), sum(map(len, means)), cautious=cautious)))
        every *= COARSER
    return replace(model, slow=tuple(slow), step_s=step_s, rows=max(len(piece) for piece in pieces))


def _less_biased(model: NoiseModel, rows: int, *, cautious: bool) -> NoiseModel:
    """Allow for what taking a mean away takes from the persistence of a few rows (Kendall, Biometrika 41, 1954)."""
    kept = -float(np.sum(model.lags))
    if kept <= 0.0:
        return model
    more = kept + (1.0 + 4.0 * kept) / rows
    more += math.sqrt(max(1.0 - more * more, 0.0) / rows) if cautious else 0.0
    return replace(model, lags=model.lags * (min(more, max(kept, 1.0 - LEAST_TIMES / rows)) / kept))


def _covariances(pieces: Sequence[Floats], most: int, rows: int) -> NDArray[np.float64]:
    """Return sum_t e[t] e[t - lag]' / rows for lag 0 to most, as (lags, channels, channels)."""
    channels = pieces[0].shape[1]
    total = np.zeros((most + 1, channels, channels))
    for piece in pieces:
        count = _fft_length(piece.shape[0] + most + 1)
        turned = np.fft.rfft(piece.T, count)
        for a in range(channels):
            for b in range(channels):
                total[:, a, b] += np.fft.irfft(turned[a] * np.conj(turned[b]), count)[: most + 1]
    return total / rows


def score_covariances(model: NoiseModel, sensitivities: Sequence[Floats]) -> NDArray[np.float64]:
    """Return J_a' C_ab J_b for every pair of channels, C being the noise's covariance over time.

    sensitivities: for each channel (rows, parameters) of one stretch. The result is (channels,
    channels, parameters, parameters); with white noise it is J'J times the variance.
    """
    rows, width = sensitivities[0].shape
    channels = len(sensitivities)
    result = np.zeros((channels, channels, width, width))
    if model.order == 0 and not model.slow:
        for a in range(channels):
            for b in range(channels):
                result[a, b] = model.covariance[a, b] * (sensitivities[a].T @ sensitivities[b])
        return result
    count = _fft_length(rows + min(rows, PADDING))
    spectrum = model.spectrum(count)
    weight = np.full(count // 2 + 1, 2.0)  # a real FFT leaves the negative frequencies out
    weight[0] = weight[-1] = 1.0
    turned = [np.fft.rfft(sensitivity, count, axis=0) for sensitivity in sensitivities]
    for a in range(channels):
        for b in range(channels):
            density = weight * spectrum[:, a, b] / count
            result[a, b] = np.real(np.conj(turned[a]).T @ (density[:, None] * turned[b]))
    return result


def _fft_length(least: int) -> int:
    """Return an even length from least up that has small factors only."""
    power = 1 << max(1, (least - 1).bit_length())
    return min(size for size in (power, power * 3 // 4, power * 5 // 8, power * 9 // 16) if size >= least)


def whitening_taps(lags: Floats) -> Floats:
    """Return (order + 1, order + 1): in row n the filter of a sample that has n before it, latest first.

    The last row is 1, lags: e[t] + lags[0] e[t - 1] + ... The first samples lack some of their past
    and are filtered by what is left of it, which is less certain and so counts for less: Levinson's
    recursion backward. Were they left out, the filter could take the decay of a wrong start for
    noise, and the start would stay wrong. Where the noise has no bounds, as with a filter of
    differences, their rows are zero.
    """
    taps = np.zeros((lags.size + 1, lags.size + 1))
    row, share = np.concatenate(([1.0], lags)), 1.0  # share: the last filter's variance over this one's
    for order in range(lags.size, -1, -1):
        taps[order, : order + 1] = np.sqrt(share) * row
        rest = 1.0 - row[-1] ** 2
        if order == 0 or rest <= 0.0:
            break
        row, share = ((row - row[-1] * row[::-1]) / rest)[:-1], share * rest
    return taps


def whitened(values: Floats, lags: Floats) -> Floats:
    """Return values (rows, ...) filtered by whitening_taps."""
    if lags.size == 0:
        return values
    result = np.zeros_like(values)
    rows = values.shape[0]
    filter_columns(values.reshape(rows, -1), whitening_taps(lags), result.reshape(rows, -1))
    return result


@dataclass(frozen=True, slots=True)
class Whiteness:
    """How white a residual is: the share of its first 20 autocorrelations that lie outside of the 95 % band."""

    lag_one: float
    outside: float
    white: bool


def whiteness(pieces: Sequence[Floats]) -> Whiteness:
    """Judge pieces (rows,) of one channel."""
    rows = sum(piece.size for piece in pieces)
    lags = min(20, max(1, rows // 4 - 1), min(piece.size for piece in pieces) - 1)
    columns = [piece[:, None] for piece in pieces]
    gamma = _covariances(columns, lags, rows)[:, 0, 0]
    if not gamma[0] > 0.0:
        return Whiteness(0.0, 0.0, white=True)
    values = gamma[1:] / gamma[0]
    outside = float(np.mean(np.abs(values) > 1.96 / np.sqrt(rows)))
    return Whiteness(float(values[0]), outside, white=outside <= 0.2)
