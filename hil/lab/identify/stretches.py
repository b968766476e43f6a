"""Split recordings at gaps into stretches, and convert them to columns for the filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from hil.errors import UsageError
from hil.lab.identify.filter import apply_lag
from hil.lab.identify.mend import remove_disagreeing_rate, remove_frozen_rows, remove_repetitions, smooth_speed_noise
from hil.lab.identify.recording import MIN_ROWS, Floats, Recording

MAX_GAP_ROWS = 10.0  # median intervals; in a longer gap the rudder is unknown
MIN_JUMP_ROWS, MIN_ROWS_PER_JUMP = 2.5, 200  # rare intervals above this many median intervals: the clock was set
SPEED_RATIO_RANGE = (0.2, 5.0)  # outside it, similarity is not assumed


@dataclass(frozen=True, slots=True)
class Stretch:
    """Consecutive rows without a gap. The heading is relative to the first row; speed_ratio is U / U0."""

    name: str
    time_s: Floats
    rudder_rad: Floats
    heading_rad: Floats | None
    yaw_rate_rad_s: Floats | None
    speed_ratio: Floats

    def measured(self, *, use_headings: bool) -> Floats:
        """Return the headings, or the yaw rates."""
        values = self.heading_rad if use_headings else self.yaw_rate_rad_s
        if values is None:
            raise ValueError("a stretch without that column")
        return values

    def rows(self, rows: slice) -> Stretch:
        """Return selected rows."""
        return Stretch(
            self.name,
            self.time_s[rows],
            self.rudder_rad[rows],
            None if self.heading_rad is None else self.heading_rad[rows],
            None if self.yaw_rate_rad_s is None else self.yaw_rate_rad_s[rows],
            self.speed_ratio[rows],
        )


@dataclass(frozen=True, slots=True)
class Data:
    """All stretches, and the speed U0 for which the model is valid; None if a file has no speed."""

    stretches: tuple[Stretch, ...]
    speed_m_s: float | None
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return sum(stretch.time_s.size for stretch in self.stretches)

    @property
    def median_step_s(self) -> float:
        """Return the median interval of the rows."""
        return float(np.median(np.concatenate([np.diff(stretch.time_s) for stretch in self.stretches])))

    @property
    def duration_s(self) -> float:
        """Return the total duration of all stretches."""
        return sum(float(stretch.time_s[-1] - stretch.time_s[0]) for stretch in self.stretches)

    @property
    def rudder_rad(self) -> Floats:
        """Return the rudder of all rows."""
        return np.concatenate([stretch.rudder_rad for stretch in self.stretches])


class Columns:
    """The rows of all stretches, averaged in groups; the means of the rudder are exact, from all rows."""

    def __init__(self, data: Data, every: int = 1) -> None:
        """Average groups of `every` rows."""
        self.uses_headings = all(stretch.heading_rad is not None for stretch in data.stretches)
        slices = [_average(stretch, every, use_headings=self.uses_headings) for stretch in data.stretches]
        self.times = [times for times, _, _ in slices]
        self.measured = np.concatenate([measured for _, measured, _ in slices])
        self.speed_ratio = np.concatenate([ratio for _, _, ratio in slices])
        self.step_s = np.concatenate([np.diff(times, prepend=times[0]) for times in self.times])
        self.is_first = np.concatenate([np.arange(times.size) == 0 for times in self.times])
        self._rudders = [_Integral(stretch.time_s, stretch.rudder_rad) for stretch in data.stretches]

    def rudder_rad(self, delay_s: float, lag_s: float) -> Floats:
        """Return the mean rudder over the interval before each row, after a dead time and a first-order lag."""
        mean = np.concatenate(
            [rudder.means(times - delay_s) for rudder, times in zip(self._rudders, self.times, strict=True)]
        )
        if lag_s <= 0.0:
            return mean
        out = np.empty_like(mean)
        apply_lag(mean, self.step_s, self.is_first, lag_s, out)
        return out


class _Integral:
    """Integral over a rudder angle that is linear between rows and constant before and after them."""

    def __init__(self, time_s: Floats, rudder_rad: Floats) -> None:
        steps = np.diff(time_s)
        self._time_s, self._rudder = time_s, rudder_rad
        self._slope = np.diff(rudder_rad) / steps
        self._area = np.concatenate(([0.0], np.cumsum(0.5 * (rudder_rad[1:] + rudder_rad[:-1]) * steps)))

    def means(self, time_s: Floats) -> Floats:
        """Return the mean over the interval that ends at each time; at the first time, the angle itself."""
        first, last = self._time_s[0], self._time_s[-1]
        row = np.clip(np.searchsorted(self._time_s, time_s, side="right") - 1, 0, self._slope.size - 1)
        inside = np.clip(time_s, first, last) - self._time_s[row]
        area = self._area[row] + inside * (self._rudder[row] + 0.5 * inside * self._slope[row])
        area += self._rudder[0] * np.minimum(time_s - first, 0.0) + self._rudder[-1] * np.maximum(time_s - last, 0.0)
        now = float(np.interp(time_s[0], self._time_s, self._rudder))
        return np.concatenate(([now], np.diff(area) / np.diff(time_s)))


def _average(stretch: Stretch, every: int, *, use_headings: bool) -> tuple[Floats, Floats, Floats]:
    """Average groups of rows; return times, headings (or yaw rates) and speed ratios."""
    measured = stretch.measured(use_headings=use_headings)
    every = max(1, min(every, stretch.time_s.size // MIN_ROWS))
    rows = stretch.time_s.size // every

    def means(values: Floats) -> Floats:
        return np.asarray(values[: rows * every].reshape(rows, every).mean(axis=1))

    return means(stretch.time_s), means(measured), means(stretch.speed_ratio)


def prepare(recordings: Sequence[Recording], speed_m_s: float | None = None, *, fitted: bool = True) -> Data:
    """Convert recordings to stretches, or raise UsageError.

    speed_m_s: U0, None for the mean speed. fitted: the data are for the fit, not only for a prediction.
    """
    warnings = [f"{recording.name}: {text}" for recording in recordings for text in recording.warnings]
    notes = [f"{recording.name}: {note}" for recording in recordings for note in recording.notes]
    recordings = [remove_frozen_rows(recording, warnings) for recording in recordings]
    agreeing_recordings = [remove_disagreeing_rate(recording, warnings) for recording in recordings]
    recordings = agreeing_recordings if fitted else recordings
    recordings = [smooth_speed_noise(recording, notes) for recording in remove_repetitions(recordings, notes)]
    headings = all(recording.heading_rad is not None for recording in recordings)
    rates = all(recording.yaw_rate_rad_s is not None for recording in recordings)
    if not headings and not rates:
        raise UsageError("some files have only a heading, others only a yaw rate; give files that share one of them")
    speeds = [recording.speed_m_s for recording in recordings]
    if any(speed is None for speed in speeds):
        speed_m_s = None
    elif speed_m_s is None:
        mean = float(np.mean(np.abs(np.concatenate([speed for speed in speeds if speed is not None]))))
        speed_m_s = mean if mean > 1e-3 else None
    stretches = tuple(
        _to_stretch(recording, part, speed_m_s) for recording in recordings for part in _between_gaps(recording, notes)
    )
    return Data(stretches, speed_m_s, tuple(notes), tuple(warnings))


def excerpt(data: Data, rows: int) -> Data:
    """Return about `rows` rows: of each stretch, those in which the rudder moves most."""
    if data.rows <= rows:
        return data
    excerpts = []
    for stretch in data.stretches:
        length = min(max(round(rows * stretch.time_s.size / data.rows), MIN_ROWS), stretch.time_s.size)
        firsts = np.linspace(0, stretch.time_s.size - length, 20).astype(int).tolist()
        spreads = [float(np.std(stretch.rudder_rad[at : at + length])) for at in firsts]
        first = firsts[int(np.argmax(spreads))]
        excerpts.append(stretch.rows(slice(first, first + length)))
    excerpts.sort(key=lambda part: -part.time_s.size)
    count = max(1, rows // MIN_ROWS)
    return replace(data, stretches=tuple(excerpts[:count]))


def _between_gaps(recording: Recording, notes: list[str]) -> list[slice]:
    steps = np.diff(recording.time_s)
    usual_interval_s = float(np.median(steps))
    is_jump = steps > MIN_JUMP_ROWS * usual_interval_s
    is_rare = np.count_nonzero(is_jump) * MIN_ROWS_PER_JUMP <= steps.size
    cuts = np.flatnonzero(is_jump if is_rare else steps > MAX_GAP_ROWS * usual_interval_s) + 1
    slices = [slice(low, high) for low, high in pairwise([0, *cuts.tolist(), recording.time_s.size])]
    long_parts = [part for part in slices if part.stop - part.start >= MIN_ROWS]
    if cuts.size:
        lost_rows = recording.time_s.size - sum(part.stop - part.start for part in long_parts)
        notes.append(
            f"{recording.name}: {cuts.size} gaps; the fit starts again after each"
            + f", {lost_rows} rows between them ignored" * (lost_rows > 0)
        )
    if not long_parts:
        raise UsageError(f"{recording.name}: too short: fewer than {MIN_ROWS} rows without a gap; record without gaps")
    return long_parts


def _to_stretch(recording: Recording, part: slice, speed_m_s: float | None) -> Stretch:
    selected = recording.rows(part)
    heading = selected.heading_rad
    if heading is not None:
        heading = np.unwrap(heading)
        heading = heading - heading[0]
    ratio = np.ones(selected.time_s.size)
    if speed_m_s is not None and selected.speed_m_s is not None:
        ratio = np.clip(np.abs(selected.speed_m_s) / speed_m_s, *SPEED_RATIO_RANGE)
    return Stretch(recording.name, selected.time_s, selected.rudder_rad, heading, selected.yaw_rate_rad_s, ratio)
