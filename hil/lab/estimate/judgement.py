"""Judge the accuracy of an estimate from the recording itself.

The true heading of the hull is not recorded. Its reference is the compass averaged over one wave period, centred (the
compass itself without waves). The reference has errors, so that the NEES of a perfect filter differs slightly from 1.
The first minutes, in which the filter learns, are ignored.
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

MAX_LAGS = 20
NORMAL_95 = 1.96
MAX_OUTSIDE_FRACTION = 0.2


@dataclass(frozen=True, slots=True)
class Whiteness:
    """Autocorrelation of lag 1, and fraction of the first 20 autocorrelations outside the 95 % limits."""

    lag_one: float
    outside_fraction: float
    is_white: bool


def whiteness(series: NDArray[np.float64]) -> Whiteness:
    """Compute the whiteness of a series; its mean is not subtracted."""
    power = float(series @ series)
    if not power > 0.0:
        return Whiteness(0.0, 0.0, is_white=True)
    lags = min(MAX_LAGS, max(1, series.size // 4 - 1), series.size - 1)
    autocorrelations = np.array([float(series[lag:] @ series[:-lag]) for lag in range(1, lags + 1)]) / power
    outside_fraction = float(np.mean(np.abs(autocorrelations) > NORMAL_95 / np.sqrt(series.size)))
    return Whiteness(float(autocorrelations[0]), outside_fraction, is_white=outside_fraction <= MAX_OUTSIDE_FRACTION)


LEARNING_S: Final = 900.0  # ignored at the start; of a shorter recording the first half is ignored
END_S: Final = 5.0  # ignored at the end, where the wave period is not complete
WAVES_HZ: Final = (0.12, 0.9)  # range of the peak of the yaw rate's spectrum
MAX_FREQUENCY: Final = 0.48  # relative to the sampling frequency
WAVE_BAND: Final = (0.6, 1.6)  # relative to the peak frequency
SEGMENT_S: Final = 256.0
SMOOTHED_LINES: Final = 5
MIN_WAVE_RAD: Final = math.radians(0.15)  # with less wave yaw the compass itself is the reference
GAP_INTERVALS: Final = 3.0  # a gap is longer than this number of median intervals
LOW_PASSES_S: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)

Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Waves:
    """Period and standard deviation of the compass heading in the wave band."""

    period_s: float
    sd_rad: float


@dataclass(frozen=True, slots=True)
class PredictionFigures:
    """Figures of predictions: error, coefficient of determination R2, and NEES.

    `r2` is relative to the present reference heading, `r2_low_pass` to the present low-passed compass heading.
    """

    rows: int
    rms_error_rad: float
    r2: float
    r2_low_pass: float
    nees: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """Figures of an estimate; NaN if there are too few rows.

    `reference_rad` is the reference heading, unwrapped, at each row; NaN near gaps. `low_pass_s` is the time constant
    of the causal low-pass with the smallest error, which is chosen afterwards.
    """

    from_s: float
    waves: Waves | None
    reference_rad: Floats
    nis: float
    whiteness: Whiteness | None
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
    is_judged_time = (time_s > from_s) & (time_s < time_s[-1] - END_S)
    error, sd = wrap_angles(columns["heading_rad"] - reference), columns["heading_sd_rad"]
    is_known = is_judged_time & np.isfinite(error) & (sd > 0.0)
    innovation_sd = columns["innovation_sd_rad"]
    innovation_ratio = columns["innovation_rad"] / np.where(innovation_sd > 0.0, innovation_sd, np.nan)
    has_innovation = is_judged_time & np.isfinite(innovation_ratio)
    low_pass, low_pass_s = _best_low_pass(time_s, compass, reference, is_known)
    return Judgement(
        from_s,
        waves,
        reference,
        _mean_square(innovation_ratio[has_innovation]),
        whiteness(innovation_ratio[has_innovation]) if np.count_nonzero(has_innovation) > 2 * SMOOTHED_LINES else None,
        _rms(error[is_known]),
        _mean_square(error[is_known] / sd[is_known]),
        _rms(wrap_angles(compass - reference)[is_known]),
        _rms(wrap_angles(low_pass - reference)[is_known]),
        low_pass_s,
        {
            seconds: figures
            for seconds, prediction in predictions.items()
            if (figures := _prediction_figures(seconds, time_s, prediction, reference, low_pass, is_judged_time))
            is not None
        },
    )


def wrap_angles(angle_rad: Floats) -> Floats:
    """Return angles in [-pi, pi)."""
    return np.asarray((angle_rad + math.pi) % math.tau - math.pi)


def waves_of(time_s: Floats, heading_rad: Floats) -> Waves | None:
    """Return the wave yaw at the peak of the yaw rate's spectrum; None for too few or too sparse rows."""
    step_s = float(np.median(np.diff(time_s)))
    grid_s = np.arange(time_s[0], time_s[-1], step_s)
    rows = min(int(SEGMENT_S / step_s), grid_s.size // 2)
    if rows < 2 * SMOOTHED_LINES:
        return None
    frequency_hz = np.fft.rfftfreq(rows, step_s)
    power = density(np.interp(grid_s, time_s, heading_rad), rows, step_s)
    is_in_band = (frequency_hz > WAVES_HZ[0]) & (frequency_hz < min(WAVES_HZ[1], MAX_FREQUENCY / step_s))
    if np.count_nonzero(is_in_band) < SMOOTHED_LINES:
        return None
    smoothed_power = np.convolve(
        (power * frequency_hz**2)[is_in_band], np.ones(SMOOTHED_LINES) / SMOOTHED_LINES, "same"
    )
    peak_hz = float(frequency_hz[is_in_band][np.argmax(smoothed_power)])
    is_near_peak = (frequency_hz > WAVE_BAND[0] * peak_hz) & (frequency_hz < WAVE_BAND[1] * peak_hz)
    return Waves(1.0 / peak_hz, math.sqrt(float(np.sum(power[is_near_peak])) * float(frequency_hz[1])))


def _reference(time_s: Floats, heading_rad: Floats, waves: Waves | None) -> Floats:
    """Return the compass averaged over a wave period around each row; NaN near gaps and ends."""
    half_s = 0.5 * waves.period_s if waves is not None and waves.sd_rad > MIN_WAVE_RAD else 0.0
    steps_s = np.diff(time_s)
    gaps = np.flatnonzero(steps_s > GAP_INTERVALS * np.median(steps_s))
    is_near_gap = np.zeros(time_s.size, dtype=bool)
    for gap in gaps.tolist():
        is_near_gap |= (time_s > time_s[gap] - half_s) & (time_s < time_s[gap + 1] + half_s)
    if half_s == 0.0:
        return np.where(is_near_gap, np.nan, heading_rad)
    area = np.concatenate(([0.0], np.cumsum(0.5 * (heading_rad[1:] + heading_rad[:-1]) * steps_s)))
    mean = (np.interp(time_s + half_s, time_s, area) - np.interp(time_s - half_s, time_s, area)) / (2.0 * half_s)
    is_near_gap |= (time_s < time_s[0] + half_s) | (time_s > time_s[-1] - half_s)
    return np.where(is_near_gap, np.nan, mean)


def _best_low_pass(time_s: Floats, compass: Floats, reference: Floats, is_known: Rows) -> tuple[Floats, float]:
    """Return the low-passed compass with the smallest error, and its time constant."""
    best: tuple[float, Floats, float] = (math.inf, compass, 0.0)
    for constant_s in LOW_PASSES_S:
        low_passed = low_pass_filter(time_s, compass, constant_s)
        error = _rms(wrap_angles(low_passed - reference)[is_known])
        if error < best[0]:
            best = (error, low_passed, constant_s)
    return best[1:]


def low_pass_filter(time_s: Floats, values: Floats, constant_s: float) -> Floats:
    """Return the values after a causal first-order low-pass with a time constant."""
    if constant_s == 0.0:
        return values
    weights = -np.expm1(-np.diff(time_s, prepend=time_s[0]) / constant_s)
    out, state = [], float(values[0])
    for weight, value in zip(weights.tolist(), values.tolist(), strict=True):
        state += weight * (value - state)
        out.append(state)
    return np.array(out)


def _prediction_figures(
    seconds: int, time_s: Floats, prediction: Prediction, reference: Floats, low_pass: Floats, is_judged_time: Rows
) -> PredictionFigures | None:
    later_reference = reference_after(seconds, time_s, reference)
    is_used = is_judged_time & np.isfinite(prediction.heading_rad + prediction.sd_rad + later_reference + reference)
    if not is_used.any():
        return None
    error_rad = wrap_angles(prediction.heading_rad - later_reference)[is_used]
    change, from_low_pass = (wrap_angles(later_reference - start)[is_used] for start in (reference, low_pass))
    return PredictionFigures(
        int(np.count_nonzero(is_used)),
        _rms(error_rad),
        1.0 - float(np.sum(error_rad**2) / max(np.sum(change**2), 1e-12)),
        1.0 - float(np.sum(error_rad**2) / max(np.sum(from_low_pass**2), 1e-12)),
        _mean_square(error_rad / prediction.sd_rad[is_used]),
    )


def reference_after(seconds: int, time_s: Floats, reference: Floats) -> Floats:
    """Return the reference `seconds` after each row; NaN if it is unknown."""
    return np.interp(time_s + seconds, time_s, reference, right=np.nan)


def _rms(values: Floats) -> float:
    return math.sqrt(_mean_square(values)) if values.size else math.nan


def _mean_square(values: Floats) -> float:
    return float(np.mean(values**2)) if values.size else math.nan
