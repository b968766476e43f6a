"""Yaw spectra: compass heading, estimated heading, and their difference (the estimated wave yaw)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_py.view.model import numbers
from hil.report.field_log import FieldLog
from hil.sim.truth import Array

SEGMENT_S: Final = 200.0
_MIN_SEGMENT_S: Final = 20.0
_MAX_PERIOD_S: Final = 60.0  # longer periods are turns, not waves
_POINTS: Final = 160  # of each curve on the page, logarithmically spaced
_DIGITS: Final = 8
_MIN_WAVE_YAW_DEG: Final = 0.2  # with less wave yaw the estimated wave period is meaningless


def log_spectra(log: FieldLog) -> dict[str, Any] | None:
    """Return the yaw spectra of a log in deg2/Hz, for a page; None if the log is too short or has no estimate."""
    truth = log.truth
    # Use the longest part without a gap.
    longest = slice(*max(pairwise([0, *log.cuts, truth.time_s.size]), key=lambda ends: ends[1] - ends[0]))
    time_s, compass, estimated = (
        column[longest] for column in (truth.time_s, truth.heading_rad, truth.heading_low_rad)
    )
    if time_s.size < 3 or np.array_equal(compass, estimated):
        return None
    period_s, wave_yaw_deg = log.columns["wave_period_s"][longest], log.columns["wave_sd_deg"][longest]
    is_valid = np.isfinite(period_s) & (wave_yaw_deg > _MIN_WAVE_YAW_DEG)
    return heading_spectra(time_s, compass, estimated, period_s[is_valid & _second_half(is_valid.size)])


def heading_spectra(time_s: Array, compass_rad: Array, estimated_rad: Array, period_s: Array) -> dict[str, Any] | None:
    """Return the spectra of unwrapped headings in deg2/Hz, for a page; None if the time is too short.

    The page marks the median of `period_s`, the estimated wave periods.
    """
    step_s = float(np.median(np.diff(time_s)))
    grid_s = np.arange(time_s[0], time_s[-1], step_s)
    rows = min(int(SEGMENT_S / step_s), grid_s.size)
    if rows * step_s < _MIN_SEGMENT_S:
        return None
    compass, estimated = (np.degrees(np.interp(grid_s, time_s, heading)) for heading in (compass_rad, estimated_rad))
    hertz: Array = np.asarray(np.fft.rfftfreq(rows, step_s)[1:], dtype=np.float64)
    lines = [
        [label, style, numbers(_smoothed(hertz, density(values, rows, step_s)[1:]), _DIGITS)]
        for label, style, values in (
            ("compass", "faint", compass),
            ("waves (estimated)", "command", compass - estimated),
            ("heading (estimated)", "main", estimated),
        )
    ]
    marks = []
    if period_s.size:
        median_s = float(np.median(period_s))
        marks.append([round(1.0 / median_s, 5), f"filter: {median_s:.1f} s"])
    return {"frequency_hz": numbers(_output_frequencies(hertz), _DIGITS), "lines": lines, "marks": marks}


def _second_half(rows: int) -> NDArray[np.bool_]:
    return np.arange(rows) >= rows // 2  # the filter converges in the first half


def density(values: Array, rows: int, step_s: float) -> Array:
    """Return the one-sided power spectral density: Welch's mean over detrended, half-overlapping Hann windows."""
    window = np.hanning(rows)
    ramp = np.linspace(-1.0, 1.0, rows)
    total, count = np.zeros(rows // 2 + 1), 0
    for begin in range(0, values.size - rows + 1, max(1, rows // 2)):
        segment = values[begin : begin + rows]
        segment = segment - segment.mean() - ramp * (segment @ ramp) / (ramp @ ramp)
        total += np.abs(np.fft.rfft(segment * window)) ** 2
        count += 1
    return np.asarray(2.0 * step_s * total / (max(count, 1) * float(window @ window)))


def _output_frequencies(hertz: Array) -> Array:
    return np.geomspace(max(hertz[0], 1.0 / _MAX_PERIOD_S), hertz[-1], _POINTS)


def _smoothed(hertz: Array, values: Array) -> Array:
    """Return the means around the output frequencies; interpolate where a mean has fewer than two values."""
    centres_hz = _output_frequencies(hertz)
    width = math.sqrt(centres_hz[1] / centres_hz[0])
    first, last = (np.searchsorted(hertz, centres_hz * factor) for factor in (1.0 / width, width))
    sums = np.concatenate(([0.0], np.cumsum(values)))
    counts = last - first
    means = (sums[last] - sums[first]) / np.maximum(counts, 1)
    return np.where(counts > 1, means, np.interp(centres_hz, hertz, values))
