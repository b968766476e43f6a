"""Repairs of a recording: repeated rows, spikes, noise of the speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from hil.errors import UsageError
from hil.lab.identify.recording import MIN_ROWS, Floats, Recording

SPIKE_NEIGHBOURS = 3  # to each side
SPIKE_SPREADS = 8.0  # probability 1e-15 for a normal distribution
NORMAL_MAD, NORMAL_90 = 1.4826, 1.645
NOISE_CERTAIN = 4.0  # standard errors


def once(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Remove exact repetitions, which contain no further information."""
    kept: list[Recording] = []
    for recording in recordings:
        if any(np.array_equal(_motion(recording), _motion(other)) for other in kept):
            notes.append(f"{recording.name}: identical to another file; used once")
            continue
        period = _period(_motion(recording))
        if period < recording.time_s.size:
            times = recording.time_s.size / period
            notes.append(f"{recording.name}: {period} rows are repeated {times:.3g} times; used once")
        kept.append(recording.rows(slice(0, period)))
    return kept


def _motion(recording: Recording) -> Floats:
    """Return rudder and motion, (rows, 2)."""
    motion = recording.heading_rad if recording.yaw_rate_rad_s is None else recording.yaw_rate_rad_s
    return np.column_stack((recording.rudder_rad, motion if motion is not None else recording.rudder_rad))


def _period(rows: Floats) -> int:
    """Return the number of rows after which all rows repeat; the number of all rows without repetition."""
    for first in np.flatnonzero(np.all(rows == rows[0], axis=1)).tolist():
        if first < MIN_ROWS or 2 * first > rows.shape[0]:
            continue
        begin = np.array_equal(rows[first : first + MIN_ROWS], rows[:MIN_ROWS])
        if begin and np.array_equal(rows[first:], rows[:-first]):
            return int(first)
    return int(rows.shape[0])


def without_spikes(values: Floats) -> tuple[Floats, int]:
    """Replace outliers by the median of their neighbours (Hampel), and count them."""
    width = 2 * SPIKE_NEIGHBOURS + 1
    if values.size < width:
        return values.copy(), 0
    padded = np.pad(values, SPIKE_NEIGHBOURS, mode="reflect", reflect_type="odd")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    apart = np.abs(values - middle)
    # Most coarse or slow readings equal their neighbours: the other ones determine the spread.
    spread = max(NORMAL_MAD * float(np.median(apart)), float(np.quantile(apart, 0.9)) / NORMAL_90)
    wrong = apart > SPIKE_SPREADS * spread
    if spread <= 0.0 or not wrong.any():
        return values.copy(), 0
    return np.where(wrong, middle, values), int(np.count_nonzero(wrong))


def without_speed_noise(recording: Recording, notes: list[str]) -> Recording:
    """Smooth the noise of a measured speed, since the model uses powers of it.

    Random walk in white noise (Harvey, Forecasting, structural time series models, 1989, 4.3).
    """
    speed = recording.speed_m_s
    if speed is None or speed.size < MIN_ROWS:
        return recording
    steps = np.diff(speed)
    noise, unsure = -float(np.mean(steps[1:] * steps[:-1])), NOISE_CERTAIN / math.sqrt(steps.size)
    if not noise > unsure * float(np.mean(steps**2)):
        return recording
    # Variance of the random walk in a row relative to the noise: the largest estimate over any time.
    apart = [2**power for power in range((speed.size // MIN_ROWS).bit_length())]
    wandered = [(float(np.mean((speed[rows:] - speed[:-rows]) ** 2)) / noise - 2.0 - unsure) / rows for rows in apart]
    share = max(*wandered, 1.0 / speed.size**2)
    keep = 1.0 + 0.5 * share - math.sqrt(share + 0.25 * share**2)
    notes.append(f"{recording.name}: speed_m_s has noise of {math.sqrt(noise):.2g} m/s from row to row; smoothed")
    return replace(recording, speed_m_s=_both_ways(speed, keep) / _both_ways(np.ones(speed.size), keep))


def _both_ways(values: Floats, keep: float) -> Floats:
    """Return sums weighted by keep to the power of the distance in rows."""
    return _one_way(values, keep) + _one_way(values[::-1], keep)[::-1] - values


def _one_way(values: Floats, keep: float) -> Floats:
    """Return sums over each row and those before it (lfilter of scipy.signal, which takes a second to import)."""
    return np.array(list(accumulate(values.tolist(), lambda total, value: value + keep * total)))


LONG_STILL = 10.0  # relative to the median time for which a value stays the same
COLUMN_SHARE = 0.5  # with more frozen rows the whole column is removed
ACTIVITY = 0.5  # rms of another column, relative to the other rows, that proves motion
NEXT_STEPS = 2.0  # largest change in sensor steps after a real standstill, as at the end of a turn
COARSE_STEPS = 5.0  # minimum motion elsewhere in the same time, in sensor steps
DEGREES_RATIO = 20.0  # a heading that turns so much faster than the yaw rate is in degrees
WINDOWS = (1000, 300, 100, 30, 15)  # numbers of windows over which the turns are compared
MIN_WINDOWS = 10
CERTAIN_SE, MIN_SCALE_ERROR = 4.0, 0.02


def without_standstill(recording: Recording, warnings: list[str]) -> Recording:
    """Remove the rows in which heading or yaw rate is frozen, or a column that is frozen in most rows."""
    frozen = np.zeros(recording.time_s.size, dtype=bool)
    for name, other in (("heading_rad", recording.yaw_rate_rad_s), ("yaw_rate_rad_s", recording.heading_rad)):
        values = getattr(recording, name)
        if values is None:
            continue
        if other is not None and np.ptp(values) == 0.0 < np.ptp(other):
            warnings.append(f"{recording.name}: {name} is constant: dead sensor; column ignored")
            return _without(recording, name)
        if name == "heading_rad":
            rows = _frozen(np.unwrap(values), recording.rudder_rad, None if other is None else (other, other))
        elif other is None:
            rows = _frozen(values, recording.rudder_rad, None)
        else:
            # A coarse yaw rate is constant in a steady turn: only the heading can prove that it should have changed.
            turning = np.gradient(np.unwrap(other), recording.time_s)
            apart = turning - values
            rows = _frozen(values, None, (apart - float(np.median(apart)), turning))
        if rows.any():
            most = other is not None and float(rows.mean()) > COLUMN_SHARE
            seconds = float(np.sum(np.diff(recording.time_s)[rows[1:]]))
            first = float(recording.time_s[int(np.argmax(rows))])
            warnings.append(
                f"{recording.name}: {name} is constant for {seconds:.0f} s (first from {first:.6g} s) while the rudder "
                f"or the boat moves: frozen sensor; {'column' if most else 'these rows'} ignored"
            )
            if most:
                return without_standstill(_without(recording, name), warnings)
        frozen |= rows
    if not frozen.any():
        return recording
    if int(np.count_nonzero(~frozen)) < MIN_ROWS:
        raise UsageError(
            f"{recording.name}: heading or yaw rate is frozen in almost all rows; repair the sensor or empty its column"
        )
    return recording.rows(~frozen)


def _without(recording: Recording, name: str) -> Recording:
    return replace(recording, heading_rad=None) if name == "heading_rad" else replace(recording, yaw_rate_rad_s=None)


def _frozen(values: Floats, rudder: Floats | None, turning: tuple[Floats, Floats] | None) -> NDArray[np.bool_]:
    """Return the rows in which values are constant for long although rudder or another sensor show motion.

    rudder: None if it proves nothing. turning: of another sensor, for the constant rows and for the other rows.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1, [values.size]))
    lengths = np.diff(bounds)
    long = lengths > max(MIN_ROWS, LONG_STILL * float(np.median(lengths)))
    frozen, moving = np.zeros(values.size, dtype=bool), np.repeat(~long, lengths)
    elsewhere = int(np.count_nonzero(moving))
    if not long.any() or elsewhere < MIN_WINDOWS:
        return frozen
    steps = np.abs(np.diff(values)[np.diff(values) != 0.0])
    step, usual = (float(np.quantile(steps, share)) for share in (0.05, 0.5))  # resolution, and step with noise
    for number in np.flatnonzero(long).tolist():
        rows = slice(int(bounds[number]), int(bounds[number + 1]))
        width = max(min(int(lengths[number]), elsewhere // 4), 2)
        parts = values[moving][: elsewhere // width * width].reshape(-1, width)
        if float(np.quantile(np.ptp(parts, axis=1), 0.25)) <= COARSE_STEPS * step:
            continue
        # Truncated digits make the steps of a coarse sensor larger for larger headings.
        own = max(step, float(abs(values[rows.start] - values[max(rows.start - 1, 0)])), usual)
        goes_on = rows.stop < values.size and abs(values[rows.stop] - values[rows.start]) <= NEXT_STEPS * own
        turns = turning is not None and _rms(turning[0][rows]) > ACTIVITY * _rms(turning[1][moving])
        steered = rudder is not None and _rms(rudder[rows]) > ACTIVITY * _rms(rudder[moving])
        # A coarse compass may be constant between two turns, independent of the rudder.
        frozen[rows] = turns or (steered and not goes_on)
    return frozen


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values**2)))


def with_agreeing_rate(recording: Recording, warnings: list[str]) -> Recording:
    """Remove a yaw rate whose integral is not the heading, with a warning.

    Errors of the yaw rate make the regression of the heading on it too small, errors of the heading make the opposite
    one too large: the scale must be outside both.
    """
    if recording.heading_rad is None or recording.yaw_rate_rad_s is None:
        return recording
    psi, _ = without_spikes(np.unwrap(recording.heading_rad))
    rate = recording.yaw_rate_rad_s
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(recording.time_s))))
    found = [_slopes(recording.time_s, psi, turned, parts) for parts in WINDOWS if 2 * parts < psi.size]
    low, high = min((one for one in found if one is not None), key=lambda one: one[1] - one[0], default=(1.0, 1.0))
    scale = 0.5 * (low + high)
    if low <= 1.0 <= high or abs(scale - 1.0) < MIN_SCALE_ERROR or low <= 0.0 <= high:
        return recording
    doubt = "turns against" if high < 0.0 else f"turns {scale:.3g} times as far as the integral of"
    unit = "is one of them in degrees? " if low > DEGREES_RATIO or 0.0 < high < 1.0 / DEGREES_RATIO else ""
    warnings.append(f"{recording.name}: heading_rad {doubt} yaw_rate_rad_s; {unit}heading used, yaw rate ignored")
    return replace(recording, yaw_rate_rad_s=None)


def _slopes(time_s: Floats, psi: Floats, turned: Floats, parts: int) -> tuple[float, float] | None:
    """Return limits of the ratio of heading turns to yaw rate turns, allowing for a constant error of the yaw rate."""
    cuts = np.linspace(0, time_s.size - 1, parts + 1).astype(int)
    spans, y, x = (np.diff(values[cuts]) for values in (time_s, psi, turned))
    whole = spans < 3.0 * float(np.median(spans))  # without a gap
    spans, y, x = spans[whole], y[whole], x[whole]
    share = spans / float(spans @ spans)
    x, y = x - spans * float(share @ x), y - spans * float(share @ y)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if spans.size < MIN_WINDOWS or not xx * yy > 0.0 or xy == 0.0:
        return None
    rest = max(1.0 - xy * xy / (xx * yy), 0.0) / (spans.size - 2)
    near, far = xy / xx, yy / xy
    spread = CERTAIN_SE * math.sqrt(rest * yy / xx)
    return min(near, far) - spread, max(near, far) + spread
