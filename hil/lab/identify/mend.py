"""Repairs of a recording: repeated rows, spikes, noise of the speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np

from hil.lab.identify.recording import LEAST_ROWS, Floats, Recording

SPIKE_NEIGHBOURS = 3  # to each side
SPIKE_SPREADS = 8.0  # a normal number is this far out once in 1e15
NORMAL_MAD, NORMAL_90 = 1.4826, 1.645
NOISE_CERTAIN = 4.0  # standard errors


def once(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Leave out exact repetitions: they are no further evidence."""
    kept: list[Recording] = []
    for recording in recordings:
        if any(np.array_equal(_motion(recording), _motion(other)) for other in kept):
            notes.append(f"{recording.name}: the same as another file; counted once")
            continue
        period = _period(_motion(recording))
        if period < recording.time_s.size:
            times = recording.time_s.size / period
            notes.append(f"{recording.name}: the same {period} rows are repeated {times:.3g} times; counted once")
        kept.append(recording.rows(slice(0, period)))
    return kept


def _motion(recording: Recording) -> Floats:
    """Return rudder and motion, (rows, 2)."""
    motion = recording.heading_rad if recording.yaw_rate_rad_s is None else recording.yaw_rate_rad_s
    return np.column_stack((recording.rudder_rad, motion if motion is not None else recording.rudder_rad))


def _period(rows: Floats) -> int:
    """Return the number of rows after which they repeat themselves to the end; all rows if they do not."""
    for first in np.flatnonzero(np.all(rows == rows[0], axis=1)).tolist():
        if first < LEAST_ROWS or 2 * first > rows.shape[0]:
            continue
        begin = np.array_equal(rows[first : first + LEAST_ROWS], rows[:LEAST_ROWS])
        if begin and np.array_equal(rows[first:], rows[:-first]):
            return int(first)
    return int(rows.shape[0])


def without_spikes(values: Floats) -> tuple[Floats, int]:
    """Replace readings that stand far out of their neighbours by those (Hampel), and count them."""
    width = 2 * SPIKE_NEIGHBOURS + 1
    if values.size < width:
        return values.copy(), 0
    padded = np.pad(values, SPIKE_NEIGHBOURS, mode="reflect", reflect_type="odd")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    apart = np.abs(values - middle)
    # Coarse or slow readings mostly equal their neighbours: the outer ones give the spread.
    spread = max(NORMAL_MAD * float(np.median(apart)), float(np.quantile(apart, 0.9)) / NORMAL_90)
    wrong = apart > SPIKE_SPREADS * spread
    if spread <= 0.0 or not wrong.any():
        return values.copy(), 0
    return np.where(wrong, middle, values), int(np.count_nonzero(wrong))


def without_speed_noise(recording: Recording, notes: list[str]) -> Recording:
    """Smooth a measured speed as far as its rows differ by noise, since the model uses powers of it.

    A speed that wanders, seen through white noise (Harvey, Forecasting, structural time series models, 1989, 4.3).
    """
    speed = recording.speed_m_s
    if speed is None or speed.size < LEAST_ROWS:
        return recording
    steps = np.diff(speed)
    noise, unsure = -float(np.mean(steps[1:] * steps[:-1])), NOISE_CERTAIN / math.sqrt(steps.size)
    if not noise > unsure * float(np.mean(steps**2)):
        return recording
    # How far it wanders in a row, over the noise: as much as shows over any time.
    apart = [2**power for power in range((speed.size // LEAST_ROWS).bit_length())]
    wandered = [(float(np.mean((speed[rows:] - speed[:-rows]) ** 2)) / noise - 2.0 - unsure) / rows for rows in apart]
    share = max(*wandered, 1.0 / speed.size**2)
    keep = 1.0 + 0.5 * share - math.sqrt(share + 0.25 * share**2)
    notes.append(f"{recording.name}: speed_m_s has a noise of {math.sqrt(noise):.2g} m/s from row to row; smoothed")
    return replace(recording, speed_m_s=_both_ways(speed, keep) / _both_ways(np.ones(speed.size), keep))


def _both_ways(values: Floats, keep: float) -> Floats:
    """Return sums weighted by keep to the power of the distance in rows."""
    return _one_way(values, keep) + _one_way(values[::-1], keep)[::-1] - values


def _one_way(values: Floats, keep: float) -> Floats:
    """Return sums over each row and those before it (lfilter of scipy.signal, which takes a second to import)."""
    return np.array(list(accumulate(values.tolist(), lambda total, value: value + keep * total)))
