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

SPIKE_NEIGHBOURS = 3  # on each side
MIN_SPIKE_SIGMAS = 8.0  # standard deviations; probability 1e-15 for a normal distribution
# Normal distribution: standard deviation / median deviation, and 90 % quantile of the deviation / standard deviation.
NORMAL_MAD, NORMAL_90 = 1.4826, 1.645
MIN_NOISE_SE = 4.0  # minimum noise variance in standard errors


def remove_repetitions(recordings: Sequence[Recording], notes: list[str]) -> list[Recording]:
    """Remove recordings, and periods within a recording, that repeat another one exactly."""
    distinct: list[Recording] = []
    for recording in recordings:
        if any(np.array_equal(_motion(recording), _motion(other)) for other in distinct):
            notes.append(f"{recording.name}: identical to another file; used once")
            continue
        period = _period(_motion(recording))
        if period < recording.time_s.size:
            times = recording.time_s.size / period
            notes.append(f"{recording.name}: {period} rows are repeated {times:.3g} times; used once")
        distinct.append(recording.rows(slice(0, period)))
    return distinct


def _motion(recording: Recording) -> Floats:
    """Return rudder and motion, (rows, 2)."""
    motion = recording.heading_rad if recording.yaw_rate_rad_s is None else recording.yaw_rate_rad_s
    return np.column_stack((recording.rudder_rad, motion if motion is not None else recording.rudder_rad))


def _period(rows: Floats) -> int:
    """Return the number of rows after which all rows repeat; the number of all rows without repetition."""
    for period in np.flatnonzero(np.all(rows == rows[0], axis=1)).tolist():
        if period < MIN_ROWS or 2 * period > rows.shape[0]:
            continue
        has_equal_start = np.array_equal(rows[period : period + MIN_ROWS], rows[:MIN_ROWS])
        if has_equal_start and np.array_equal(rows[period:], rows[:-period]):
            return int(period)
    return int(rows.shape[0])


def replace_spikes(values: Floats) -> tuple[Floats, int]:
    """Replace outliers by the median of their neighbours (Hampel filter); return values and number of outliers."""
    width = 2 * SPIKE_NEIGHBOURS + 1
    if values.size < width:
        return values.copy(), 0
    padded = np.pad(values, SPIKE_NEIGHBOURS, mode="reflect", reflect_type="odd")
    medians = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
    deviations = np.abs(values - medians)
    # Most readings of a coarse sensor equal their neighbours: the median is 0, the 90 % quantile gives the spread.
    spread = max(NORMAL_MAD * float(np.median(deviations)), float(np.quantile(deviations, 0.9)) / NORMAL_90)
    is_outlier = deviations > MIN_SPIKE_SIGMAS * spread
    if spread <= 0.0 or not is_outlier.any():
        return values.copy(), 0
    return np.where(is_outlier, medians, values), int(np.count_nonzero(is_outlier))


def smooth_speed_noise(recording: Recording, notes: list[str]) -> Recording:
    """Smooth the noise of a measured speed, since the model uses powers of it.

    Random walk in white noise (Harvey, Forecasting, structural time series models, 1989, 4.3).
    """
    speed = recording.speed_m_s
    if speed is None or speed.size < MIN_ROWS:
        return recording
    steps = np.diff(speed)
    noise, margin = -float(np.mean(steps[1:] * steps[:-1])), MIN_NOISE_SE / math.sqrt(steps.size)
    if not noise > margin * float(np.mean(steps**2)):
        return recording
    # Variance of the random walk per row relative to the noise: the largest estimate over several distances.
    distances = [2**power for power in range((speed.size // MIN_ROWS).bit_length())]
    estimates = [
        (float(np.mean((speed[rows:] - speed[:-rows]) ** 2)) / noise - 2.0 - margin) / rows for rows in distances
    ]
    variance_ratio = max(*estimates, 1.0 / speed.size**2)
    keep = 1.0 + 0.5 * variance_ratio - math.sqrt(variance_ratio + 0.25 * variance_ratio**2)
    notes.append(f"{recording.name}: speed_m_s has noise of {math.sqrt(noise):.2g} m/s from row to row; smoothed")
    return replace(recording, speed_m_s=_two_sided_sums(speed, keep) / _two_sided_sums(np.ones(speed.size), keep))


def _two_sided_sums(values: Floats, keep: float) -> Floats:
    """Return sums over all rows, weighted by `keep` to the power of the distance in rows."""
    return _one_sided_sums(values, keep) + _one_sided_sums(values[::-1], keep)[::-1] - values


def _one_sided_sums(values: Floats, keep: float) -> Floats:
    """Return weighted sums over each row and the previous ones; the import of scipy.signal.lfilter takes a second."""
    return np.array(list(accumulate(values.tolist(), lambda total, value: value + keep * total)))


MIN_FROZEN_RATIO = 10.0  # rows with the same value, relative to the median
MAX_FROZEN_FRACTION = 0.5  # with more frozen rows the whole column is removed
MIN_ACTIVITY = 0.5  # rms of another column, relative to the other rows, that proves motion
MAX_NEXT_STEPS = 2.0  # largest change in sensor steps after a real standstill, as at the end of a turn
MIN_MOTION_STEPS = 5.0  # minimum motion elsewhere in the same time, in sensor steps
DEGREES_RATIO = 20.0  # a heading that turns so much faster than the yaw rate is in degrees
WINDOW_COUNTS = (1000, 300, 100, 30, 15)  # numbers of windows over which the turns are compared
MIN_WINDOWS = 10
SCALE_MARGIN_SE, MIN_SCALE_ERROR = 4.0, 0.02  # margin of the scale's limits in standard errors; ignored scale errors


def remove_frozen_rows(recording: Recording, warnings: list[str]) -> Recording:
    """Remove the rows in which heading or yaw rate is frozen, or a column that is frozen in most rows."""
    frozen = np.zeros(recording.time_s.size, dtype=bool)
    for name, other in (("heading_rad", recording.yaw_rate_rad_s), ("yaw_rate_rad_s", recording.heading_rad)):
        values = getattr(recording, name)
        if values is None:
            continue
        if other is not None and np.ptp(values) == 0.0 < np.ptp(other):
            warnings.append(f"{recording.name}: {name} is constant: dead sensor; column ignored")
            return _remove_column(recording, name)
        if name == "heading_rad":
            rows = _frozen_rows(np.unwrap(values), recording.rudder_rad, None if other is None else (other, other))
        elif other is None:
            rows = _frozen_rows(values, recording.rudder_rad, None)
        else:
            # A coarse yaw rate is constant in a steady turn; only the heading can prove that it should have changed.
            turning = np.gradient(np.unwrap(other), recording.time_s)
            deviations = turning - values
            rows = _frozen_rows(values, None, (deviations - float(np.median(deviations)), turning))
        if rows.any():
            remove_column = other is not None and float(rows.mean()) > MAX_FROZEN_FRACTION
            seconds = float(np.sum(np.diff(recording.time_s)[rows[1:]]))
            first_s = float(recording.time_s[int(np.argmax(rows))])
            warnings.append(
                f"{recording.name}: {name} is constant for {seconds:.0f} s (first from {first_s:.6g} s) while the "
                f"rudder or the boat moves: frozen sensor; {'column' if remove_column else 'these rows'} ignored"
            )
            if remove_column:
                return remove_frozen_rows(_remove_column(recording, name), warnings)
        frozen |= rows
    if not frozen.any():
        return recording
    if int(np.count_nonzero(~frozen)) < MIN_ROWS:
        raise UsageError(
            f"{recording.name}: heading or yaw rate is frozen in almost all rows; repair the sensor or empty its column"
        )
    return recording.rows(~frozen)


def _remove_column(recording: Recording, name: str) -> Recording:
    return replace(recording, heading_rad=None) if name == "heading_rad" else replace(recording, yaw_rate_rad_s=None)


def _frozen_rows(values: Floats, rudder: Floats | None, turning: tuple[Floats, Floats] | None) -> NDArray[np.bool_]:
    """Return the rows in which values are constant for long although rudder or another sensor shows motion.

    rudder: None if it is no evidence. turning: yaw rates of another sensor, for the constant and for the other rows.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1, [values.size]))
    lengths = np.diff(bounds)
    is_long = lengths > max(MIN_ROWS, MIN_FROZEN_RATIO * float(np.median(lengths)))
    frozen, is_moving = np.zeros(values.size, dtype=bool), np.repeat(~is_long, lengths)
    moving_rows = int(np.count_nonzero(is_moving))
    if not is_long.any() or moving_rows < MIN_WINDOWS:
        return frozen
    steps = np.abs(np.diff(values)[np.diff(values) != 0.0])
    # Resolution, and step with noise.
    step, usual_step = (float(np.quantile(steps, fraction)) for fraction in (0.05, 0.5))
    for number in np.flatnonzero(is_long).tolist():
        rows = slice(int(bounds[number]), int(bounds[number + 1]))
        width = max(min(int(lengths[number]), moving_rows // 4), 2)
        windows = values[is_moving][: moving_rows // width * width].reshape(-1, width)
        if float(np.quantile(np.ptp(windows, axis=1), 0.25)) <= MIN_MOTION_STEPS * step:
            continue
        # Truncated digits make the steps of a coarse sensor larger for larger headings.
        sensor_step = max(step, float(abs(values[rows.start] - values[max(rows.start - 1, 0)])), usual_step)
        continues = (
            rows.stop < values.size and abs(values[rows.stop] - values[rows.start]) <= MAX_NEXT_STEPS * sensor_step
        )
        is_turning = turning is not None and _rms(turning[0][rows]) > MIN_ACTIVITY * _rms(turning[1][is_moving])
        is_steered = rudder is not None and _rms(rudder[rows]) > MIN_ACTIVITY * _rms(rudder[is_moving])
        # A coarse compass may be constant between two turns, independent of the rudder.
        frozen[rows] = is_turning or (is_steered and not continues)
    return frozen


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(values**2)))


def remove_disagreeing_rate(recording: Recording, warnings: list[str]) -> Recording:
    """Remove a yaw rate whose integral is not the heading, with a warning.

    Errors of the yaw rate make the slope of the heading over it too small; errors of the heading make the inverse slope
    too large. The scale is wrong only if 1 is outside both.
    """
    if recording.heading_rad is None or recording.yaw_rate_rad_s is None:
        return recording
    psi, _ = replace_spikes(np.unwrap(recording.heading_rad))
    rate = recording.yaw_rate_rad_s
    integral_rad = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(recording.time_s))))
    limits_found = [
        _scale_limits(recording.time_s, psi, integral_rad, windows)
        for windows in WINDOW_COUNTS
        if 2 * windows < psi.size
    ]
    low, high = min(
        (limits for limits in limits_found if limits is not None),
        key=lambda limits: limits[1] - limits[0],
        default=(1.0, 1.0),
    )
    scale = 0.5 * (low + high)
    if low <= 1.0 <= high or abs(scale - 1.0) < MIN_SCALE_ERROR or low <= 0.0 <= high:
        return recording
    problem = "turns against" if high < 0.0 else f"turns {scale:.3g} times as far as the integral of"
    unit_hint = "is one of them in degrees? " if low > DEGREES_RATIO or 0.0 < high < 1.0 / DEGREES_RATIO else ""
    warnings.append(
        f"{recording.name}: heading_rad {problem} yaw_rate_rad_s; {unit_hint}heading used, yaw rate ignored"
    )
    return replace(recording, yaw_rate_rad_s=None)


def _scale_limits(time_s: Floats, psi: Floats, integral_rad: Floats, windows: int) -> tuple[float, float] | None:
    """Return limits of the ratio of heading changes to integrated yaw rates, without a constant yaw rate error."""
    cuts = np.linspace(0, time_s.size - 1, windows + 1).astype(int)
    spans, y, x = (np.diff(values[cuts]) for values in (time_s, psi, integral_rad))
    is_gapless = spans < 3.0 * float(np.median(spans))
    spans, y, x = spans[is_gapless], y[is_gapless], x[is_gapless]
    weights = spans / float(spans @ spans)
    x, y = x - spans * float(weights @ x), y - spans * float(weights @ y)
    xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
    if spans.size < MIN_WINDOWS or not xx * yy > 0.0 or xy == 0.0:
        return None
    residual = max(1.0 - xy * xy / (xx * yy), 0.0) / (spans.size - 2)
    min_slope, max_slope = xy / xx, yy / xy
    spread = SCALE_MARGIN_SE * math.sqrt(residual * yy / xx)
    return min(min_slope, max_slope) - spread, max(min_slope, max_slope) + spread
