"""Whether a log speaks of a boat that does not run straight by herself, whose T is below zero."""

from __future__ import annotations

import math

import numpy as np

from hil.lab.identify.fit import Fit
from hil.lab.identify.recording import LEAST_ROWS, Floats
from hil.lab.identify.stretch import Stretch

WIDTHS = (5, 10, 20, 50, 100)  # rows, over which the yaw rate's change is set against what makes it
AT_BOUND = 1e-3  # of ln T
MOST_BENT = 10.0  # alpha r^2 of a boat that has a linear term to speak of
CERTAIN, EXPLAINED = 4.0, 0.5  # standard errors; share of the changes


def seems_unstable(fit: Fit) -> bool:
    """Whether a yaw rate that is there makes itself grow: in dr/dt = a rudder + b r + c r^3 + d, b is above zero.

    Noise of the yaw rate only makes b smaller, so that it does not feign this.
    """
    return any(_grows([_changes(stretch, width) for stretch in fit.problem.data.stretches]) for width in WIDTHS)


def runs_away(fit: Fit) -> bool:
    """Whether hardly anything but the cubic term ends a turn: T as long as is looked for, or alpha r^2 far above 1."""
    longest, values = float(fit.problem.bounds()[1][1]), fit.state.point.values
    return 2 in fit.problem.free and (float(values[1]) >= longest - AT_BOUND or float(values[2]) > MOST_BENT)


def _changes(stretch: Stretch, width: int) -> tuple[Floats, Floats]:
    """Return the yaw rate's changes over so many rows, and the means of what makes it change times the time."""
    rate = stretch.yaw_rate_rad_s
    cuts = np.arange(0, stretch.time_s.size, width)
    if rate is None:
        # A heading's differences are too noisy row by row: those over the width stand for its middle.
        time_s = stretch.time_s[cuts]
        middles = 0.5 * (time_s[1:] + time_s[:-1])
        if middles.size < LEAST_ROWS:
            return np.empty(0), np.empty((0, 4))
        rate = np.interp(stretch.time_s, middles, np.diff(stretch.measured()[0][cuts]) / np.diff(time_s))
        cuts = cuts[1:-1] + width // 2
        cuts = cuts[cuts < stretch.time_s.size]
    causes = (stretch.rudder_at_samples(), rate, rate**3, np.ones(rate.size))
    summed = [np.concatenate(([0.0], np.cumsum(0.5 * (one[1:] + one[:-1]) * stretch.step_s))) for one in causes]
    return np.diff(rate[cuts]), np.diff(np.column_stack(summed)[cuts], axis=0)


def _grows(pairs: list[tuple[Floats, Floats]]) -> bool:
    changes, causes = (np.concatenate(columns) for columns in zip(*pairs, strict=True))
    if changes.size < LEAST_ROWS:
        return False
    causes = causes / np.maximum(np.linalg.norm(causes, axis=0), 1e-300)
    values = np.linalg.lstsq(causes, changes, rcond=1e-9)[0]
    rest = float(np.sum((changes - causes @ values) ** 2))
    if rest > (1.0 - EXPLAINED) * float(np.sum((changes - changes.mean()) ** 2)):
        return False
    spread = math.sqrt(max(float(np.linalg.pinv(causes.T @ causes)[1, 1]) * rest / (changes.size - 4), 0.0))
    return float(values[1]) > CERTAIN * spread
