"""The compiled objective of the global search.

Loops run over samples outside and over candidates (fish) inside, as in kernel.py.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.lab.compiled import compiled
from hil.lab.identify.kernel import P2, P3, TINY, exponential_step
from hil.lab.identify.recording import Floats

Integers = NDArray[np.int64]

LANES = 8  # doubles in the widest vector register: no candidate is left over to be computed alone

# The arrays that output_error carries along have a value for each candidate and come in tuples, because the
# compiler makes SIMD of separate arrays only:
# state: heading, yaw rate, free decay, free turn.
# window: sums over a window, of the heading's error e, of the free turn t, of ee, tt and et.
# stretch: sums over a stretch, of tt and et of the heading without means, of tt and et of the yaw rate.
# total: squared errors of heading and of yaw rate.
Columns = tuple[Floats, ...]


@compiled
def _advance(state: Columns, model: Columns, rudder_rad: float, next_rad: float, step_s: float, u: float) -> None:
    """Move all candidates on by one sample."""
    psi, r, decay, turn = state
    gain, lag, cubic, offset = model
    lag_scale, cubic_scale = 1.0 / u, 1.0 / (u * u)
    for f in range(psi.size):
        lag_s = lag[f] * lag_scale
        psi[f], r[f] = exponential_step(
            psi[f], r[f], rudder_rad, next_rad, step_s, gain[f] * u, lag_s, cubic[f] * cubic_scale, offset[f], 0.0
        )
        # The free decay needs no more than a direction, so a short form serves.
        x = step_s / lag_s
        decayed = decay[f] / (1.0 + x * (1.0 + x * (P2 + x * P3)))
        turn[f] += 0.5 * step_s * (decay[f] + decayed)
        decay[f] = decayed


@compiled
def _add_heading_errors(state: Columns, window: Columns, heading_rad: float) -> None:
    psi, _, _, turn = state
    e1, t1, e2, t2, et = window
    for f in range(psi.size):
        error = heading_rad - psi[f]
        e1[f] += error
        t1[f] += turn[f]
        e2[f] += error * error
        t2[f] += turn[f] * turn[f]
        et[f] += error * turn[f]


@compiled
def _add_rate_errors(state: Columns, stretch: Columns, total: Columns, yaw_rate_rad_s: float) -> None:
    _, r, decay, _ = state
    _, _, rate_t2, rate_et = stretch
    _, rate_e2 = total
    for f in range(r.size):
        error = yaw_rate_rad_s - r[f]
        rate_t2[f] += decay[f] * decay[f]
        rate_et[f] += error * decay[f]
        rate_e2[f] += error * error


@compiled
def _end_window(state: Columns, window: Columns, stretch: Columns, total: Columns, rows: int) -> None:
    """Take the means out of a window's sums, and start its headings anew."""
    e1, t1, e2, t2, et = window
    share = 1.0 / max(rows, 1)
    for f in range(e1.size):
        total[0][f] += e2[f] - share * e1[f] * e1[f]
        stretch[0][f] += t2[f] - share * t1[f] * t1[f]
        stretch[1][f] += et[f] - share * e1[f] * t1[f]
    for column in window:
        column[:] = 0.0
    state[0][:] = 0.0
    state[3][:] = 0.0


@compiled
def _end_stretch(state: Columns, stretch: Columns, total: Columns) -> None:
    """Take what an initial yaw rate would explain out of a stretch's errors, and start anew."""
    heading_t2, heading_et, rate_t2, rate_et = stretch
    for f in range(heading_t2.size):
        total[0][f] -= heading_et[f] * heading_et[f] / max(heading_t2[f], TINY)
        total[1][f] -= rate_et[f] * rate_et[f] / max(rate_t2[f], TINY)
    for column in stretch:
        column[:] = 0.0
    state[1][:] = 0.0
    state[2][:] = 1.0


@compiled
def output_error(
    points: Floats,
    values: Floats,
    scales: Floats,
    flags: Integers,
    step_s: Floats,
    rudder_rad: Floats,
    speed_ratio: Floats,
    heading_rad: Floats,
    yaw_rate_rad_s: Floats,
) -> None:
    """Fill the misfit of points (m, 4), the coordinates of predict.Point: 1 explains nothing, 0 all.

    It is the geometric mean over the channels in use of the squared error's share of the
    channel's own power, which is the likelihood with the noise's size eliminated. What an unknown
    initial yaw rate would add (the free decay of the linear model) is taken out of the error of
    each stretch, and its mean out of a heading's error in each window, so that neither the
    start nor a slow drift weighs.

    points (m, 4): one candidate a row; values (m,): the result. scales: sign of K, yaw rate and
    rudder scale, middle of the rudder, power of heading and of yaw rate; a power of 0 leaves the
    channel out. Of each sample: flags, 2 where a stretch begins, 1 where a window begins, else 0;
    step_s, which leads to it; speed_ratio, U / U0; heading_rad, from the start of its window.
    """
    count = -(-points.shape[0] // LANES) * LANES
    full = np.zeros((count, 4))
    full[: points.shape[0]] = points
    model = (
        scales[0] * np.exp(full[:, 0]) * (1.0 + full[:, 2]),
        np.exp(full[:, 1]) * (1.0 + full[:, 2]),
        full[:, 2] / (scales[1] * scales[1]),
        scales[3] + full[:, 3] * scales[2] * (1.0 + 3.0 * full[:, 2]) / (1.0 + full[:, 2]),
    )
    state = (np.zeros(count), np.zeros(count), np.ones(count), np.zeros(count))
    window = (np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count))
    stretch = (np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count))
    total = (np.zeros(count), np.zeros(count))
    inside = 0
    for n in range(flags.size):
        if flags[n] > 0:
            _end_window(state, window, stretch, total, inside)
            inside = 0
        if flags[n] == 2:
            _end_stretch(state, stretch, total)
        else:
            u = 0.5 * (speed_ratio[n - 1] + speed_ratio[n])
            _advance(state, model, rudder_rad[n - 1], rudder_rad[n], step_s[n], u)
        if scales[4] > 0.0:
            _add_heading_errors(state, window, heading_rad[n])
        if scales[5] > 0.0:
            _add_rate_errors(state, stretch, total, yaw_rate_rad_s[n])
        inside += 1
    _end_window(state, window, stretch, total, inside)
    _end_stretch(state, stretch, total)
    for f in range(points.shape[0]):
        heading, rate = max(total[0][f], 0.0), max(total[1][f], 0.0)
        if scales[4] > 0.0 and scales[5] > 0.0:
            values[f] = np.sqrt(heading / scales[4] * (rate / scales[5]))
        else:
            values[f] = heading / scales[4] if scales[4] > 0.0 else rate / scales[5]
