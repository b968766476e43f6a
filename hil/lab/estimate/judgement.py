"""Accuracy of an estimate, from the recording itself.

The true heading of the hull is not recorded. Its reference is the compass averaged over one wave period, centred (the
compass itself without waves). The reference has errors, so that the NEES of a perfect filter differs somewhat from 1.
The first minutes, in which the filter learns, do not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.lab.estimate.predictions import Prediction
from hil.lab.estimate.tick import Estimates
from hil.lab.identify.recording import Floats
from hil.report.spectrum import density

LAGS = 20
NORMAL_95 = 1.96
MAX_OUTSIDE = 0.2


@dataclass(frozen=True, slots=True)
class Whiteness:
    """Autocorrelation of lag 1, and share of the first 20 autocorrelations outside the 95 % limits."""

    lag_one: float
    outside: float
    white: bool


def whiteness(series: NDArray[np.float64]) -> Whiteness:
    """Return the whiteness of a series, without subtracting its mean."""
    power = float(series @ series)
    if not power > 0.0:
        return Whiteness(0.0, 0.0, white=True)
    lags = min(LAGS, max(1, series.size // 4 - 1), series.size - 1)
    values = np.array([float(series[lag:] @ series[:-lag]) for lag in range(1, lags + 1)]) / power
    outside = float(np.mean(np.abs(values) > NORMAL_95 / np.sqrt(series.size)))
    return Whiteness(float(values[0]), outside, white=outside <= MAX_OUTSIDE)


LEARNING_S: Final = 900.0  # or half of a shorter recording
END_S: Final = 5.0  # at the end, without a complete wave period
WAVES_HZ: Final = (0.12, 0.9)  # range of the peak of the yaw rate's spectrum
NYQUIST: Final = 0.48  # upper limit relative to the sampling frequency
WAVE_BAND: Final = (0.6, 1.6)  # relative to the peak frequency
SEGMENT_S: Final = 256.0
SMOOTHED_LINES: Final = 5
MIN_WAVE_RAD: Final = math.radians(0.15)
GAP_INTERVALS: Final = 3.0
LOW_PASSES_S: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)

Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Waves:
    """Period and standard deviation of the compass heading in the wave band."""

    period_s: float
    sd_rad: float


@dataclass(frozen=True, slots=True)
class PredictionFigures:
    """Figures of predictions: error, and coefficient of determination R2.

    `r2` is relative to a constant heading, `r2_low_pass` to a constant low-passed compass; the correct `nees` is 1.
    """

    rows: int
    rms_error_rad: float
    r2: float
    r2_low_pass: float
    nees: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """Figures of an estimate; NaN where there are too few rows.

    `reference_rad` is the reference heading, unwrapped, at each row; NaN near gaps. `low_pass_s` is the time constant
    of the causal low-pass with the smallest error, chosen afterwards.
    """

    from_s: float
    waves: Waves | None
    reference_rad: Floats
    nis: float
    white: Whiteness | None
    rms_error_rad: float
    nees: float
    compass_error_rad: float
    low_pass_error_rad: float
    low_pass_s: float
    predictions: Mapping[int, PredictionFigures]


def judge(estimates: Estimates, predictions: Mapping[int, Prediction]) -> Judgement:
    """Compute the figures of estimate and predictions."""
    time_s, columns = estimates.time_s, estimates.columns
    compass = np.unwrap(columns["compass_rad"])
    from_s = min(LEARNING_S, 0.5 * float(time_s[-1]))
    waves = waves_of(time_s, compass)
    reference = _reference(time_s, compass, waves)
    counted = (time_s > from_s) & (time_s < time_s[-1] - END_S)
    error, sd = wrapped(columns["heading_rad"] - reference), columns["heading_sd_rad"]
    known = counted & np.isfinite(error) & (sd > 0.0)
    innovation_sd = columns["innovation_sd_rad"]
    scaled = columns["innovation_rad"] / np.where(innovation_sd > 0.0, innovation_sd, np.nan)
    judged = counted & np.isfinite(scaled)
    low_pass, low_pass_s = _best_low_pass(time_s, compass, reference, known)
    return Judgement(
        from_s,
        waves,
        reference,
        _mean_square(scaled[judged]),
        whiteness(scaled[judged]) if np.count_nonzero(judged) > 2 * SMOOTHED_LINES else None,
        _rms(error[known]),
        _mean_square(error[known] / sd[known]),
        _rms(wrapped(compass - reference)[known]),
        _rms(wrapped(low_pass - reference)[known]),
        low_pass_s,
        {
            seconds: figures
            for seconds, prediction in predictions.items()
            if (figures := _of_prediction(seconds, time_s, prediction, reference, low_pass, counted)) is not None
        },
    )


def wrapped(angle_rad: Floats) -> Floats:
    """Return angles in [-pi, pi)."""
    return np.asarray((angle_rad + math.pi) % math.tau - math.pi)


def waves_of(time_s: Floats, heading_rad: Floats) -> Waves | None:
    """Return the wave yaw at the peak of the yaw rate's spectrum; None for too few or too sparse rows."""
    step_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], step_s)
    rows = min(int(SEGMENT_S / step_s), even_s.size // 2)
    if rows < 2 * SMOOTHED_LINES:
        return None
    hertz = np.fft.rfftfreq(rows, step_s)
    power = density(np.interp(even_s, time_s, heading_rad), rows, step_s)
    band = (hertz > WAVES_HZ[0]) & (hertz < min(WAVES_HZ[1], NYQUIST / step_s))
    if np.count_nonzero(band) < SMOOTHED_LINES:
        return None
    smooth = np.convolve((power * hertz**2)[band], np.ones(SMOOTHED_LINES) / SMOOTHED_LINES, "same")
    peak_hz = float(hertz[band][np.argmax(smooth)])
    near = (hertz > WAVE_BAND[0] * peak_hz) & (hertz < WAVE_BAND[1] * peak_hz)
    return Waves(1.0 / peak_hz, math.sqrt(float(np.sum(power[near])) * float(hertz[1])))


def _reference(time_s: Floats, heading_rad: Floats, waves: Waves | None) -> Floats:
    """Return the compass averaged over a wave period around each row; NaN near gaps and ends."""
    half_s = 0.5 * waves.period_s if waves is not None and waves.sd_rad > MIN_WAVE_RAD else 0.0
    steps_s = np.diff(time_s)
    gaps = np.flatnonzero(steps_s > GAP_INTERVALS * np.median(steps_s))
    beside = np.zeros(time_s.size, dtype=bool)
    for gap in gaps.tolist():
        beside |= (time_s > time_s[gap] - half_s) & (time_s < time_s[gap + 1] + half_s)
    if half_s == 0.0:
        return np.where(beside, np.nan, heading_rad)
    area = np.concatenate(([0.0], np.cumsum(0.5 * (heading_rad[1:] + heading_rad[:-1]) * steps_s)))
    mean = (np.interp(time_s + half_s, time_s, area) - np.interp(time_s - half_s, time_s, area)) / (2.0 * half_s)
    beside |= (time_s < time_s[0] + half_s) | (time_s > time_s[-1] - half_s)
    return np.where(beside, np.nan, mean)


def _best_low_pass(time_s: Floats, compass: Floats, reference: Floats, known: Rows) -> tuple[Floats, float]:
    """Return the low-passed compass with the smallest error, and its time constant."""
    best: tuple[float, Floats, float] = (math.inf, compass, 0.0)
    for constant_s in LOW_PASSES_S:
        values = low_passed(time_s, compass, constant_s)
        error = _rms(wrapped(values - reference)[known])
        if error < best[0]:
            best = (error, values, constant_s)
    return best[1:]


def low_passed(time_s: Floats, values: Floats, constant_s: float) -> Floats:
    """Return a causal first-order low-pass."""
    if constant_s == 0.0:
        return values
    shares = -np.expm1(-np.diff(time_s, prepend=time_s[0]) / constant_s)
    out, now = [], float(values[0])
    for share, value in zip(shares.tolist(), values.tolist(), strict=True):
        now += share * (value - now)
        out.append(now)
    return np.array(out)


def _of_prediction(
    seconds: int, time_s: Floats, prediction: Prediction, reference: Floats, low_pass: Floats, counted: Rows
) -> PredictionFigures | None:
    later = reference_later(seconds, time_s, reference)
    use = counted & np.isfinite(prediction.heading_rad + prediction.sd_rad + later + reference)
    if not use.any():
        return None
    miss = wrapped(prediction.heading_rad - later)[use]
    change, from_low_pass = (wrapped(later - start)[use] for start in (reference, low_pass))
    return PredictionFigures(
        int(np.count_nonzero(use)),
        _rms(miss),
        1.0 - float(np.sum(miss**2) / max(np.sum(change**2), 1e-12)),
        1.0 - float(np.sum(miss**2) / max(np.sum(from_low_pass**2), 1e-12)),
        _mean_square(miss / prediction.sd_rad[use]),
    )


def reference_later(seconds: int, time_s: Floats, reference: Floats) -> Floats:
    """Return the reference some seconds after each row; NaN if it is unknown."""
    return np.interp(time_s + seconds, time_s, reference, right=np.nan)


def _rms(values: Floats) -> float:
    return math.sqrt(_mean_square(values)) if values.size else math.nan


def _mean_square(values: Floats) -> float:
    return float(np.mean(values**2)) if values.size else math.nan
