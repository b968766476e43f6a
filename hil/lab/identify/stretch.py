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
from hil.lab.identify.agreement import scale_of, without_standstill
from hil.lab.identify.mend import once, without_rate_bias, without_speed_noise, without_spikes
from hil.lab.identify.recording import LEAST_ROWS, Floats, Recording

GAP_SAMPLES = 10.0  # a hole this many usual intervals long: nobody knows what the rudder did in it
JUMP_SAMPLES, ROWS_A_JUMP = 2.5, 200  # one this long in a log that is even but for it: a clock that was set
MOST_STRETCHES = 100
BLOCKS, LEAST_BLOCK = 8, 200  # of an excerpt: how many of each stretch, and their rows
SPEED_RATIO_RANGE = (0.2, 5.0)  # similarity is not stretched further


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

    def part(self, rows: slice) -> Stretch:
        """Return some rows of the stretch, one after the other."""
        inside = slice(rows.start, rows.stop - 1)
        return replace(
            self,
            time_s=self.time_s[rows],
            step_s=self.step_s[inside],
            rudder_rad=self.rudder_rad[rows],
            rudder_end_rad=self.rudder_end_rad[inside],
            heading_rad=None if self.heading_rad is None else self.heading_rad[rows],
            yaw_rate_rad_s=None if self.yaw_rate_rad_s is None else self.yaw_rate_rad_s[rows],
            speed_ratio=self.speed_ratio[rows],
        )

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
    """All that a model is fitted to or judged by; speed_m_s is U0, None where no file has a speed.

    rate_scale: how many times as far the headings turn as the yaw rates say, of the recording that is furthest off.
    """

    stretches: tuple[Stretch, ...]
    speed_m_s: float | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    rate_scale: float = 1.0

    @property
    def rows(self) -> int:
        """How many samples there are."""
        return sum(stretch.time_s.size for stretch in self.stretches)

    @property
    def usual_step_s(self) -> float:
        """The median interval."""
        return float(np.median(np.concatenate([stretch.step_s for stretch in self.stretches])))

    @property
    def duration_s(self) -> float:
        """How long all stretches last together."""
        return sum(float(stretch.time_s[-1] - stretch.time_s[0]) for stretch in self.stretches)

    @property
    def spikes(self) -> int:
        """How many readings were replaced because they stood out of their neighbours."""
        return sum(stretch.spikes for stretch in self.stretches)


def prepare(recordings: Sequence[Recording], speed_m_s: float | None = None) -> Data:
    """Make stretches of recordings; speed_m_s is U0, their mean speed if None. UsageError names the remedy.

    The channels are those that all recordings have.
    """
    warnings: list[str] = []
    recordings = [without_standstill(recording, warnings) for recording in recordings]
    has_heading = all(recording.heading_rad is not None for recording in recordings)
    has_rate = all(recording.yaw_rate_rad_s is not None for recording in recordings)
    if not has_heading and not has_rate:
        raise UsageError("some files have only a heading, others only a yaw rate; give files that share one of them")
    notes = [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    recordings = [without_speed_noise(recording, notes) for recording in once(recordings, notes)]
    if not (has_heading and has_rate) and len(recordings) > 1:
        notes.append(f"only the {'heading' if has_heading else 'yaw rate'} is used: not all files have both")
    with_speed = all(recording.speed_m_s is not None for recording in recordings)
    mean_speed = _mean_speed(recordings) if with_speed else None
    reference = mean_speed if speed_m_s is None else speed_m_s
    stretches: list[Stretch] = []
    scales = [1.0]
    for recording in recordings:
        scales.append(scale_of(recording, warnings))
        recording = without_rate_bias(recording, notes, scales[-1])  # noqa: PLW2901 - mended
        parts = _between_gaps(recording, notes)
        stretches.extend(
            _stretch(recording, part, reference if with_speed else None, heading=has_heading, rate=has_rate)
            for part in parts
        )
    if len(stretches) > MOST_STRETCHES:
        stretches.sort(key=lambda one: -one.time_s.size)
        notes.append(f"only the longest {MOST_STRETCHES} of {len(stretches)} stretches between gaps are used")
        stretches = stretches[:MOST_STRETCHES]
    rate_scale = max(scales, key=lambda scale: abs(math.log(scale)))
    return Data(tuple(stretches), reference, tuple(notes), tuple(warnings), rate_scale)


def timed(data: Data, timing: Timing) -> Data:
    """Return the data with the rudder's ramps from sample to sample taken for something else."""
    return replace(data, stretches=tuple(stretch.timed(timing) for stretch in data.stretches))


def thinned(data: Data, every: int) -> Data:
    """Average every so many samples; the data themselves if that is one."""
    if every < 2:
        return data
    return replace(data, stretches=tuple(_averaged(stretch, every) for stretch in data.stretches))


def excerpt(data: Data, rows: int) -> Data:
    """Return about so many rows, in blocks spread evenly over the data; the data themselves if they are few."""
    if data.rows <= rows:
        return data
    parts: list[Stretch] = []
    for stretch in data.stretches:
        share = rows * stretch.time_s.size / data.rows
        blocks = max(1, min(BLOCKS, int(share / LEAST_BLOCK)))
        length = min(max(int(share / blocks), LEAST_ROWS), stretch.time_s.size)
        firsts = np.linspace(0, stretch.time_s.size - length, blocks).astype(int)
        parts.extend(stretch.part(slice(first, first + length)) for first in firsts.tolist())
    return replace(data, stretches=tuple(parts))


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
    jumps = steps > JUMP_SAMPLES * usual_s
    rare = np.count_nonzero(jumps) * ROWS_A_JUMP <= steps.size
    cuts = np.flatnonzero(jumps if rare else steps > GAP_SAMPLES * usual_s) + 1
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
