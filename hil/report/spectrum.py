"""Yaw spectra of a boat: compass, estimated heading, and their difference, which the filter attributes to waves."""

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
_MAX_PERIOD_S: Final = 60.0  # turns are slower
_LINES: Final = 160  # of the page: equally spaced in octaves
_DIGITS: Final = 8
_MIN_WAVES_DEG: Final = 0.2  # below, the filter's wave period is meaningless


def spectrum_of(log: FieldLog) -> dict[str, Any] | None:
    """Return the spectra for a page, in deg2/Hz; None for a log that is too short, or without an estimate."""
    truth = log.truth
    # The longest part without a gap.
    part = slice(*max(pairwise([0, *log.cuts, truth.time_s.size]), key=lambda ends: ends[1] - ends[0]))
    time_s, compass, hull = (column[part] for column in (truth.time_s, truth.heading_rad, truth.heading_low_rad))
    if time_s.size < 3 or np.array_equal(compass, hull):
        return None
    period_s, waves_deg = log.more["wave_period_s"][part], log.more["wave_sd_deg"][part]
    known = np.isfinite(period_s) & (waves_deg > _MIN_WAVES_DEG)
    return spectra(time_s, compass, hull, period_s[known & _second_half(known)])


def spectra(time_s: Array, compass_rad: Array, hull_rad: Array, period_s: Array) -> dict[str, Any] | None:
    """Return the spectra of unwrapped headings for a page; None if the time is too short.

    The median of period_s, the estimated wave period, is marked.
    """
    step_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], step_s)
    rows = min(int(SEGMENT_S / step_s), even_s.size)
    if rows * step_s < _MIN_SEGMENT_S:
        return None
    compass, steered = (np.degrees(np.interp(even_s, time_s, heading)) for heading in (compass_rad, hull_rad))
    hertz: Array = np.asarray(np.fft.rfftfreq(rows, step_s)[1:], dtype=np.float64)
    lines = [
        [label, look, numbers(_smoothed(hertz, density(values, rows, step_s)[1:]), _DIGITS)]
        for label, look, values in (
            ("compass", "faint", compass),
            ("waves (estimated)", "command", compass - steered),
            ("heading (estimated)", "main", steered),
        )
    ]
    marks = []
    if period_s.size:
        middle_s = float(np.median(period_s))
        marks.append([round(1.0 / middle_s, 5), f"filter: {middle_s:.1f} s"])
    return {"frequency_hz": numbers(_places(hertz), _DIGITS), "lines": lines, "marks": marks}


def _second_half(rows: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.arange(rows.size) >= rows.size // 2  # the filter learns in the first half


def density(values: Array, rows: int, step_s: float) -> Array:
    """Return the one-sided power spectral density: Welch's mean over half-overlapping Hann windows without trends."""
    window = np.hanning(rows)
    line = np.linspace(-1.0, 1.0, rows)
    total, count = np.zeros(rows // 2 + 1), 0
    for begin in range(0, values.size - rows + 1, max(1, rows // 2)):
        part = values[begin : begin + rows]
        part = part - part.mean() - line * (part @ line) / (line @ line)
        total += np.abs(np.fft.rfft(part * window)) ** 2
        count += 1
    return np.asarray(2.0 * step_s * total / (max(count, 1) * float(window @ window)))


def _places(hertz: Array) -> Array:
    return np.geomspace(max(hertz[0], 1.0 / _MAX_PERIOD_S), hertz[-1], _LINES)


def _smoothed(hertz: Array, values: Array) -> Array:
    """Return means around frequencies that are equally spaced in octaves, interpolated between two frequencies."""
    places = _places(hertz)
    width = math.sqrt(places[1] / places[0])
    first, last = (np.searchsorted(hertz, places * factor) for factor in (1.0 / width, width))
    sums = np.concatenate(([0.0], np.cumsum(values)))
    counts = last - first
    means = (sums[last] - sums[first]) / np.maximum(counts, 1)
    return np.where(counts > 1, means, np.interp(places, hertz, values))
