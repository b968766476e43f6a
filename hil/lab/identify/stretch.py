"""Cuts recordings at gaps into stretches that can be simulated through, and takes spikes out of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise
from typing import Self

import numpy as np

from hil.errors import UsageError
from hil.lab.identify.recording import LEAST_ROWS, Floats, Recording

GAP_SAMPLES = 10.0  # a hole this many usual intervals long: nobody knows what the rudder did in it
MOST_STRETCHES = 100
SPIKE_NEIGHBOURS = 3  # to each side
SPIKE_SPREADS = 8.0  # a normal number is this far out once in 1e15
NORMAL_MAD, NORMAL_90 = 1.4826, 1.645
BIAS_BLOCKS, BIAS_CERTAIN, BIAS_MATTERS = 10, 8.0, 0.02  # standard errors; of the yaw rate's spread
SPEED_RATIO_RANGE = (0.2, 5.0)  # similarity is not stretched further
DEGREES_SLOPE = 20.0  # a heading that changes this many times faster than the yaw rate says is in degrees


class Timing(Enum):
    """What the rudder did between two samples."""

    RAMP = "goes evenly from sample to sample"
    HELD = "is held from each sample to the next"
    AHEAD = "is at each sample what it has been since the one before"


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples without a gap: intervals (one fewer), rudder, heading from its start, yaw rate, U / U0.

    In an interval the rudder goes evenly from `rudder_rad` to `rudder_end_rad`. `long_step_s` is an
    interval that hardly any other exceeds.
    """

    name: str
    time_s: Floats
    step_s: Floats
    rudder_rad: Floats
    rudder_end_rad: Floats
    heading_rad: Floats | None
    yaw_rate_rad_s: Floats | None
    speed_ratio: Floats
    spikes: int
    long_step_s: float

    @classmethod
    def of(
        cls,
        name: str,
        time_s: Floats,
        rudder_rad: Floats,
        heading_rad: Floats | None,
        yaw_rate_rad_s: Floats | None,
        speed_ratio: Floats,
        spikes: int = 0,
    ) -> Self:
        """Complete the intervals; the rudder goes evenly from sample to sample."""
        step_s = np.diff(time_s)
        long_s = float(np.quantile(step_s, 0.99))
        end = rudder_rad[1:]
        return cls(name, time_s, step_s, rudder_rad, end, heading_rad, yaw_rate_rad_s, speed_ratio, spikes, long_s)

    def timed(self, timing: Timing) -> Stretch:
        """Return the stretch with its ramps from sample to sample taken for something else."""
        if timing is Timing.RAMP:
            return self
        before, after = self.rudder_rad[:-1], self.rudder_rad[1:]
        if timing is Timing.HELD:
            return replace(self, rudder_end_rad=before)
        return replace(self, rudder_rad=np.concatenate((after, after[-1:])), rudder_end_rad=after)

    def rudder_at_samples(self) -> Floats:
        """Return the rudder at each sample, where it jumps there the mean of both sides."""
        before = np.concatenate((self.rudder_rad[:1], self.rudder_end_rad))
        return np.asarray(0.5 * (before + self.rudder_rad))

    def measured(self) -> Floats:
        """Return heading and yaw rate as (2, rows), zeros for what was not measured."""
        zeros = np.zeros(self.time_s.size)
        columns = (self.heading_rad, self.yaw_rate_rad_s)
        return np.array([zeros if column is None else column for column in columns])


@dataclass(frozen=True, slots=True)
class Data:
    """All that a model is fitted to or judged by; speed_m_s is U0, None where no file has a speed."""

    stretches: tuple[Stretch, ...]
    speed_m_s: float | None
    notes: tuple[str, ...]

    @property
    def rows(self) -> int:
        """How many samples there are."""
        return sum(stretch.time_s.size for stretch in self.stretches)

    @property
    def spikes(self) -> int:
        """How many readings were replaced because they stood out of their neighbours."""
        return sum(stretch.spikes for stretch in self.stretches)


def prepare(recordings: Sequence[Recording], speed_m_s: float | None = None) -> Data:
    """Make stretches of recordings; speed_m_s is U0, their mean speed if None. UsageError names the remedy.

    The channels are those that all recordings have.
    """
    has_heading = all(recording.heading_rad is not None for recording in recordings)
    has_rate = all(recording.yaw_rate_rad_s is not None for recording in recordings)
    if not has_heading and not has_rate:
        raise UsageError("some files have only a heading, others only a yaw rate; give files that share one of them")
    notes = [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    if not (has_heading and has_rate) and len(recordings) > 1:
        notes.append(f"only the {'heading' if has_heading else 'yaw rate'} is used: not all files have both")
    with_speed = all(recording.speed_m_s is not None for recording in recordings)
    mean_speed = _mean_speed(recordings) if with_speed else None
    reference = mean_speed if speed_m_s is None else speed_m_s
    stretches: list[Stretch] = []
    for recording in recordings:
        _check_agreement(recording)
        recording = _without_rate_bias(recording, notes)  # noqa: PLW2901 - mended
        parts = _between_gaps(recording, notes)
        stretches.extend(
            _stretch(recording, part, reference if with_speed else None, heading=has_heading, rate=has_rate)
            for part in parts
        )
    if len(stretches) > MOST_STRETCHES:
        stretches.sort(key=lambda one: -one.time_s.size)
        notes.append(f"only the longest {MOST_STRETCHES} of {len(stretches)} stretches between gaps are used")
        stretches = stretches[:MOST_STRETCHES]
    return Data(tuple(stretches), reference, tuple(notes))


def timed(data: Data, timing: Timing) -> Data:
    """Return the data with the rudder's ramps from sample to sample taken for something else."""
    return replace(data, stretches=tuple(stretch.timed(timing) for stretch in data.stretches))


def thinned(data: Data, rows: int) -> Data:
    """Average every few samples so that about so many rows are left; the data themselves if they are few."""
    every = data.rows // rows
    if every < 2:
        return data
    return replace(data, stretches=tuple(_averaged(stretch, every) for stretch in data.stretches))


def _averaged(stretch: Stretch, every: int) -> Stretch:
    every = max(1, min(every, stretch.time_s.size // LEAST_ROWS))
    rows = stretch.time_s.size // every

    def mean(values: Floats) -> Floats:
        return np.asarray(values[: rows * every].reshape(rows, every).mean(axis=1))

    return Stretch.of(
        stretch.name,
        mean(stretch.time_s),
        mean(stretch.rudder_at_samples()),
        None if stretch.heading_rad is None else mean(stretch.heading_rad),
        None if stretch.yaw_rate_rad_s is None else mean(stretch.yaw_rate_rad_s),
        mean(stretch.speed_ratio),
        stretch.spikes,
    )


def _mean_speed(recordings: Sequence[Recording]) -> float | None:
    speeds = np.concatenate([recording.speed_m_s for recording in recordings if recording.speed_m_s is not None])
    mean = float(np.mean(np.abs(speeds)))
    return mean if mean > 1e-3 else None


def _between_gaps(recording: Recording, notes: list[str]) -> list[slice]:
    steps = np.diff(recording.time_s)
    usual_s = float(np.median(steps))
    cuts = np.flatnonzero(steps > GAP_SAMPLES * usual_s) + 1
    bounds = [0, *cuts.tolist(), recording.time_s.size]
    parts = [slice(low, high) for low, high in pairwise(bounds)]
    kept = [part for part in parts if part.stop - part.start >= LEAST_ROWS]
    if cuts.size:
        lost = sum(part.stop - part.start for part in parts) - sum(part.stop - part.start for part in kept)
        notes.append(
            f"{recording.name}: {cuts.size} gaps; each side starts anew" + (f", {lost} rows lost" * (lost > 0))
        )
    if not kept:
        raise UsageError(
            f"{recording.name}: too short: no stretch of {LEAST_ROWS} rows without a gap; record without holes"
        )
    return kept


def _stretch(recording: Recording, part: slice, speed_m_s: float | None, *, heading: bool, rate: bool) -> Stretch:
    time_s = recording.time_s[part]
    spikes = 0
    psi = r = None
    if heading and recording.heading_rad is not None:
        turns = np.unwrap(recording.heading_rad[part])
        psi, count = without_spikes(turns - turns[0])
        spikes += count
    if rate and recording.yaw_rate_rad_s is not None:
        r, count = without_spikes(recording.yaw_rate_rad_s[part])
        spikes += count
    ratio = np.ones(time_s.size)
    if speed_m_s is not None and recording.speed_m_s is not None:
        ratio = np.clip(np.abs(recording.speed_m_s[part]) / speed_m_s, *SPEED_RATIO_RANGE)
    return Stretch.of(recording.name, time_s, recording.rudder_rad[part], psi, r, ratio, spikes)


def without_spikes(values: Floats) -> tuple[Floats, int]:
    """Replace readings that stand far out of their neighbours by those (Hampel), and count them."""
    width = 2 * SPIKE_NEIGHBOURS + 1
    if values.size < width:
        return values.copy(), 0
    padded = np.pad(values, SPIKE_NEIGHBOURS, mode="reflect", reflect_type="odd")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    apart = np.abs(values - middle)
    # Coarse or slow readings are mostly equal to their neighbours: then the outer ones tell the spread.
    spread = max(NORMAL_MAD * float(np.median(apart)), float(np.quantile(apart, 0.9)) / NORMAL_90)
    wrong = apart > SPIKE_SPREADS * spread
    if spread <= 0.0 or not wrong.any():
        return values.copy(), 0
    return np.where(wrong, middle, values), int(np.count_nonzero(wrong))


def _without_rate_bias(recording: Recording, notes: list[str]) -> Recording:
    """Take a yaw rate's constant error away where the heading beside it shows one for certain."""
    if recording.heading_rad is None or recording.yaw_rate_rad_s is None:
        return recording
    time_s, rate = recording.time_s, recording.yaw_rate_rad_s
    cuts = np.linspace(0, time_s.size - 1, BIAS_BLOCKS + 1).astype(int)
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s))))
    apart = (turned - np.unwrap(recording.heading_rad))[cuts]
    biases = np.diff(apart) / np.diff(time_s[cuts])
    bias, spread = float(np.median(biases)), float(np.std(biases)) / math.sqrt(BIAS_BLOCKS)
    if abs(bias) < max(BIAS_CERTAIN * spread, BIAS_MATTERS * float(np.std(rate))):
        return recording
    notes.append(f"{recording.name}: yaw_rate_rad_s is {bias:+.3g} rad/s off what the heading does; taken away")
    return replace(recording, yaw_rate_rad_s=rate - bias)


def _check_agreement(recording: Recording) -> None:
    """Refuse a heading in degrees beside a yaw rate in radians, or the other way round."""
    if recording.heading_rad is None or recording.yaw_rate_rad_s is None:
        return
    psi, _ = without_spikes(np.unwrap(recording.heading_rad))
    rate = recording.yaw_rate_rad_s
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(recording.time_s))))
    turned -= turned.mean()
    psi = psi - psi.mean()
    power = float(turned @ turned)
    if not power > 0.0 or not float(psi @ psi) > 0.0:
        return
    slope = float(psi @ turned) / power
    likeness = float(psi @ turned) / math.sqrt(power * float(psi @ psi))
    name, there = recording.name, "as the yaw rate adds up to"
    if abs(likeness) < 0.9:
        return
    if slope > DEGREES_SLOPE:
        raise UsageError(f"{name}: heading_rad turns {slope:.0f} times as far {there}: is it in degrees? convert it")
    if 0.0 < slope < 1.0 / DEGREES_SLOPE:
        raise UsageError(
            f"{name}: heading_rad turns {slope:.3f} times as far {there}: is yaw_rate_rad_s in deg/s? convert it"
        )
    if slope < 0.0:
        raise UsageError(
            f"{name}: heading_rad and yaw_rate_rad_s turn against each other; turn the sign of one: "
            "both are positive to starboard"
        )
