"""The global search: a scan over T alone gives the box, the artificial fish swarm searches it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hil.lab.identify.digest import Digest
from hil.lab.identify.kernel import simulate
from hil.lab.identify.objective import output_error
from hil.lab.identify.predict import Point
from hil.lab.identify.recording import Floats
from hil.lab.swarm import SwarmSettings, minimise

SCANNED_LAGS = 40
SHORTEST_LAG_S, LONGEST_LAG_S = 0.02, 2e4
GAIN_MARGIN = math.log(3.0)
OFFSET_MARGIN = 0.5  # of half the rudder's range
LARGEST_OFFSET = 3.0
LEAST_SCALE = 0.02  # of the measured yaw rates, where the rudder seems to do nothing
LARGEST_CUBIC, SMALL_CUBIC = 30.0, 0.01  # alpha r^2; beyond, only ratios of K, T and alpha are left anyway
SETTINGS = SwarmSettings(fish=30, iterations=30, tries=4)

Callback = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Box:
    """Where to search.

    A straight box in ln K and ln T would be nearly empty: where T is longer than the
    manoeuvre only K/T is seen. So K and delta0 are searched around what fits best at each T
    without the cubic term.
    """

    ln_lag: Floats
    ln_gain: Floats  # at each lag
    offset: Floats  # at each lag
    sign: float
    guess: Point  # what the scan alone says
    guess_misfit: float

    def bounds(self, *, cubic: bool) -> tuple[Floats, Floats]:
        """Return low and high of the coordinates ln T, K's and delta0's deviation, and alpha's."""
        low = [self.ln_lag[0], -GAIN_MARGIN, -OFFSET_MARGIN, 0.0]
        high = [self.ln_lag[-1], GAIN_MARGIN, OFFSET_MARGIN, math.log1p(LARGEST_CUBIC / SMALL_CUBIC)]
        return np.asarray(low[: 3 + cubic], np.float64), np.asarray(high[: 3 + cubic], np.float64)

    def points(self, fish: Floats) -> Floats:
        """Turn coordinates (m, 3 or 4) of the box into those of Point (m, 4)."""
        # Even below SMALL_CUBIC and logarithmic beyond.
        cubic = SMALL_CUBIC * np.expm1(fish[:, 3]) if fish.shape[1] > 3 else np.zeros(fish.shape[0])
        ln_gain = np.interp(fish[:, 0], self.ln_lag, self.ln_gain) + fish[:, 1]
        offset = np.interp(fish[:, 0], self.ln_lag, self.offset) + fish[:, 2]
        return np.ascontiguousarray(np.column_stack((ln_gain, fish[:, 0], cubic, offset)))


@dataclass(frozen=True, slots=True)
class Found:
    """The best candidate of a search, its misfit (0 to 1) and how many candidates were tried."""

    point: Point
    misfit: float
    evaluations: int


class GlobalSearch(Protocol):
    """A global search of a box."""

    def __call__(self, record: Digest, box: Box, seed: int, *, cubic: bool, tell: Callback) -> Found:
        """Return the best candidate."""


def with_scale_of(record: Digest, box: Box) -> Digest:
    """Return a record whose yaw rate scale is what the boat turns at, without the noise, by the box's guess."""
    rows = record.flags.size
    heading, rate = np.zeros((rows, 1)), np.zeros((rows, 1))
    for part in record.parts():
        rate[part.start] = record.yaw_rate_rad_s[part.start] if record.rate_power > 0.0 else 0.0
        simulate(
            record.step_s[part][1:],
            record.rudder_rad[part],
            record.rudder_rad[part][1:],
            record.speed_ratio[part],
            1,
            box.guess.candidate(record.scales)[:, None],
            heading[part],
            rate[part],
        )
    noisy = record.scales.yaw_rate_rad_s
    typical = min(max(float(np.sqrt(np.mean(rate**2))), LEAST_SCALE * noisy), noisy)
    largest = min(max(float(np.max(np.abs(rate))), typical), record.scales.largest_rate_rad_s)
    return replace(record, scales=replace(record.scales, yaw_rate_rad_s=typical, largest_rate_rad_s=largest))


def misfit(record: Digest, points: Floats, sign: float) -> Floats:
    """Return the misfit of points (m, 4)."""
    values = np.empty(points.shape[0])
    output_error(np.ascontiguousarray(points), values, *record.arguments(sign))
    return values


def scan(record: Digest) -> Box:
    """Solve for K and delta0 at each of many T, where they enter linearly, and draw the box around."""
    lags = np.geomspace(
        max(SHORTEST_LAG_S, record.interval_s / 5.0),
        min(LONGEST_LAG_S, 30.0 * record.duration_s),
        SCANNED_LAGS,
    )
    gains, offsets = _solved(record, lags)
    scales = record.scales
    least = 1e-9 * scales.yaw_rate_rad_s / scales.rudder_rad
    offsets = np.where(np.abs(gains) > least, offsets / np.where(gains == 0.0, 1.0, gains) / scales.rudder_rad, 0.0)
    offsets = np.clip(offsets, -LARGEST_OFFSET, LARGEST_OFFSET)
    ln_gain = np.log(np.maximum(np.abs(gains), least))
    points = np.column_stack((ln_gain, np.log(lags), np.zeros(lags.size), offsets))
    signs = np.where(gains < 0.0, -1.0, 1.0)
    values = np.array([misfit(record, one[None], sign)[0] for one, sign in zip(points, signs, strict=True)])
    best = int(np.argmin(values))
    sign = float(signs[best])
    return Box(points[:, 1], ln_gain, offsets, sign, Point(points[best], sign), float(values[best]))


def _solved(record: Digest, lags: Floats) -> tuple[Floats, Floats]:
    """Return K and K delta0 (from the rudder's middle) by least squares for each lag."""
    count, rows = lags.size, record.flags.size
    middle = record.scales.rudder_middle_rad
    # Three answers at each lag: to the rudder, to a constant rudder, and the free decay.
    candidates = np.zeros((5, 3 * count))
    candidates[0, : 2 * count], candidates[1] = 1.0, np.tile(lags, 3)
    candidates[3, :count], candidates[3, count : 2 * count] = middle, middle - 1.0
    heading, rate = np.zeros((rows, 3 * count)), np.zeros((rows, 3 * count))
    parts = record.parts()
    for part in parts:
        rate[part.start, 2 * count :] = 1.0
        simulate(
            record.step_s[part][1:],
            record.rudder_rad[part],
            record.rudder_rad[part][1:],
            record.speed_ratio[part],
            1,
            candidates,
            heading[part],
            rate[part],
        )
    matrix, right = np.zeros((count, 2, 2)), np.zeros((count, 2))
    channels = []
    if record.heading_power > 0.0:
        measured = _centred(record.heading_rad[:, None], record.flags)
        channels.append((_centred(heading, record.flags), measured))
    if record.rate_power > 0.0:
        channels.append((rate, record.yaw_rate_rad_s[:, None]))
    for simulated, measured in channels:
        power = max(float(np.sum(measured**2)), 1e-300)
        for part in parts:
            turned, steady, decay = (simulated[part, k * count : (k + 1) * count] for k in range(3))
            steady = steady - turned
            told = np.broadcast_to(measured[part], turned.shape)
            turned, steady, told = (_without(decay, values) for values in (turned, steady, told))
            for a, one in enumerate((turned, steady)):
                right[:, a] += np.sum(one * told, axis=0) / power
                for b, other in enumerate((turned, steady)):
                    matrix[:, a, b] += np.sum(one * other, axis=0) / power
    matrix += (1e-10 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(2)
    solution = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    return np.asarray(solution[:, 0], np.float64), np.asarray(-solution[:, 1], np.float64)


def _without(direction: Floats, values: Floats) -> Floats:
    """Take out of columns what lies along the columns of direction."""
    power = np.maximum(np.sum(direction**2, axis=0), 1e-300)
    return np.asarray(values - direction * (np.sum(direction * values, axis=0) / power))


def _centred(values: Floats, flags: Floats) -> Floats:
    """Take each window's mean out of columns (rows, n)."""
    windows = np.split(values, np.flatnonzero(flags > 0)[1:])
    return np.concatenate([one - one.mean(axis=0) for one in windows])


def swarm_search(record: Digest, box: Box, seed: int, *, cubic: bool, tell: Callback = lambda: None) -> Found:
    """Let the artificial fish search."""
    low, high = box.bounds(cubic=cubic)

    def value(fish: Floats) -> Floats:
        return misfit(record, box.points(fish), box.sign)

    result = minimise(value, low, high, replace(SETTINGS, seed=seed), lambda _: tell())
    return Found(Point(box.points(result.best[None])[0], box.sign), result.best_value, result.evaluations)
