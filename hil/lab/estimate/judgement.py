"""How right an estimate was, judged by the recording itself.

What the heading of the hull was is not recorded: the compass averaged over one wave period, centred, stands for it
(the compass itself where there is hardly a wave). It is not quite the truth, so that even a perfect filter has an NEES
that is somewhat other than 1. The first minutes, in which the filter learns, do not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil.lab.estimate.predictions import Prediction
from hil.lab.estimate.tick import Watched
from hil.lab.estimate.whiteness import Whiteness, whiteness
from hil.lab.identify.recording import Floats
from hil.report.spectrum import density

LEARNING_S: Final = 900.0  # or half of a recording that is shorter than twice that
END_S: Final = 5.0  # at the end, where no whole wave is averaged
WAVES_HZ: Final = (0.12, 0.9)  # where the peak of the yaw rate's spectrum is looked for
NYQUIST: Final = 0.48  # of the sampling frequency: above it nothing is seen
WAVE_BAND: Final = (0.6, 1.6)  # of the peak's frequency
SEGMENT_S: Final = 256.0
SMOOTHED_LINES: Final = 5
LEAST_WAVE_RAD: Final = math.radians(0.15)
GAP_INTERVALS: Final = 3.0
LOW_PASSES_S: Final = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0)

Rows = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Waves:
    """Period and standard deviation of the yaw in the band of the waves, as the compass shows it."""

    period_s: float
    sd_rad: float


@dataclass(frozen=True, slots=True)
class PredictionFigures:
    """Of headings predicted some seconds ahead: the error, and the share of the change that is explained (R2).

    r2: against a heading that stays. r2_low_pass: against a low-passed compass that stays. nees: 1 is right.
    """

    rows: int
    rms_error_rad: float
    r2: float
    r2_low_pass: float
    nees: float


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the figures of a page and of the JSON are made of; NaN where there is too little to judge.

    reference_rad: what stands for the truth, unwrapped, at each row; NaN beside gaps. low_pass_s: the time constant,
    chosen in hindsight, of the causal low-pass whose error is the least.
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


def judge(watched: Watched, predictions: Mapping[int, Prediction]) -> Judgement:
    """Judge estimate and predictions."""
    time_s, columns = watched.time_s, watched.columns
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
    """Return the wave yaw by the peak of the yaw rate's spectrum; None where rows are too few or too far apart."""
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
    """Return the compass averaged over a wave period around each row, NaN where a gap or an end lies within."""
    half_s = 0.5 * waves.period_s if waves is not None and waves.sd_rad > LEAST_WAVE_RAD else 0.0
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
    """Return the low-passed compass that is nearest to the reference, and its time constant."""
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
    """Return the reference some seconds after each row, NaN where it is not known there."""
    return np.interp(time_s + seconds, time_s, reference, right=np.nan)


def _rms(values: Floats) -> float:
    return math.sqrt(_mean_square(values)) if values.size else math.nan


def _mean_square(values: Floats) -> float:
    return float(np.mean(values**2)) if values.size else math.nan
