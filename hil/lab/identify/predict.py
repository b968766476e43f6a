"""What the model says of a stretch, and how that changes with every parameter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.identify.kernel import differentiate, simulate
from hil.lab.identify.recording import Floats
from hil.lab.identify.stretch import Stretch

MOST_INNER_STEPS = 32
# One-sided: that the derivatives are a few 1e-6 off moves an estimate by no more than this part of its
# standard error, and half the columns are half the work.
DIFFERENCE = 3e-6
SIMD_WIDTH = 8
CUBIC_TOLERANCE = 2e-4  # of the yaw rate, that the integration of the cubic term may be wrong by


@dataclass(frozen=True, slots=True)
class Scales:
    """What a yaw rate and a rudder angle of this data are like, so that parameters are near 1.

    The largest rate bounds how negative alpha may be: where 3 alpha r^2 < -1 the boat spins up without end.
    """

    yaw_rate_rad_s: float
    rudder_rad: float
    rudder_middle_rad: float
    largest_rate_rad_s: float


@dataclass(frozen=True, slots=True)
class Point:
    """A candidate in the coordinates that are searched and refined in, and K's sign.

    c = alpha r^2 with r the typical yaw rate; ln(|K| / (1 + c)) and ln(T / (1 + c)), which are what
    a linear model would see at that rate; c; and delta0 in scales times (1 + c) / (1 + 3 c), which
    with the others sets the mean yaw rate. In K, T, alpha and delta0 themselves the good
    candidates lie along a bent valley; here it is nearly straight. With a power of 2 it is the rival whose damping
    goes with r |r|: c is that of it, and alpha is zero.
    """

    values: Floats  # (4,)
    sign: float
    power: int = 3

    def physical(self, scales: Scales) -> Floats:
        """Return K [1/s], T [s], alpha [s^2], delta0 [rad]."""
        return self.candidate(scales)[:4]

    def candidate(self, scales: Scales) -> Floats:
        """Return K [1/s], T [s], alpha [s^2], delta0 [rad] and the coefficient of r |r| [s]."""
        ln_gain, ln_lag, bend, offset = (float(value) for value in self.values)
        return np.array(
            [
                self.sign * math.exp(ln_gain) * (1.0 + bend),
                math.exp(ln_lag) * (1.0 + bend),
                bend / scales.yaw_rate_rad_s**2 if self.power == 3 else 0.0,
                scales.rudder_middle_rad + offset * scales.rudder_rad * (1.0 + self.power * bend) / (1.0 + bend),
                bend / scales.yaw_rate_rad_s if self.power == 2 else 0.0,
            ]
        )


def to_natural(point: Point, free: Sequence[int]) -> tuple[Floats, Floats]:
    """Return ln |K|, ln T, c and delta0 of a point's coordinates, and their derivatives by the free ones."""
    natural = point.values.copy()
    bend, offset = float(natural[2]), float(natural[3])
    stretch = (1.0 + point.power * bend) / (1.0 + bend)
    natural[:2] += math.log1p(bend)
    natural[3] = offset * stretch
    turn = np.eye(len(free))
    if 2 in free:
        turn[:2, free.index(2)] = 1.0 / (1.0 + bend)
        turn[free.index(3), free.index(2)] = (point.power - 1.0) * offset / (1.0 + bend) ** 2
    turn[-1, -1] = stretch
    return natural, turn


@dataclass(frozen=True, slots=True)
class Start:
    """Where a stretch begins: heading and yaw rate before its first sample's noise."""

    heading_rad: float
    yaw_rate_rad_s: float


def inner_steps(stretch: Stretch, candidate: Floats, largest_rate_rad_s: float) -> int:
    """Return into how many steps to cut an interval so that the integration does not show."""
    gain, lag_s, cubic, offset, quadratic = (float(value) for value in candidate)
    u = stretch.speed_ratio
    fastest = float(np.max(u))
    # A rate is no larger than the steady one at the largest rudder, linear or cubic.
    drive = abs(gain) * float(np.max(np.abs(stretch.rudder_rad - offset)))
    rate = min(largest_rate_rad_s, drive)
    bend = max(cubic, 0.0) * rate * rate + max(quadratic, 0.0) * rate
    x = stretch.long_step_s * fastest / lag_s
    count = max(x * (1.0 + 3.0 * bend), x * math.sqrt(bend / (2.0 * CUBIC_TOLERANCE)), 1.0)
    return math.ceil(min(count, MOST_INNER_STEPS))


def trajectories(stretch: Stretch, candidates: Floats, starts: Sequence[Start], steps: int) -> tuple[Floats, Floats]:
    """Return heading and yaw rate, (rows, candidates), of candidates (5, n)."""
    shape = (stretch.time_s.size, len(starts))
    heading, rate = np.empty(shape), np.empty(shape)
    heading[0] = [start.heading_rad for start in starts]
    rate[0] = [start.yaw_rate_rad_s for start in starts]
    simulate(
        stretch.step_s,
        stretch.rudder_rad,
        stretch.rudder_end_rad,
        stretch.speed_ratio,
        steps,
        np.ascontiguousarray(candidates),
        heading,
        rate,
    )
    return heading, rate


def perturbed(point: Point, scales: Scales, start: Start, free: Sequence[int]) -> tuple[Floats, Floats]:
    """Return candidates (5, columns) and starts (2, columns) for one-sided differences.

    First the point itself, then each free parameter up, then the initial yaw rate [in scales] up;
    repeated to a multiple of the SIMD width.
    """
    base = point.candidate(scales)
    columns = [base]
    rates = [start.yaw_rate_rad_s] * (len(free) + 1)
    for index in free:
        values = point.values.copy()
        values[index] += DIFFERENCE
        columns.append(replace(point, values=values).candidate(scales))
    columns.append(base)
    rates.append(start.yaw_rate_rad_s + DIFFERENCE * scales.yaw_rate_rad_s)
    fill = -len(columns) % SIMD_WIDTH
    candidates = np.ascontiguousarray(np.array([*columns, *[base] * fill]).T)
    first = np.array([[start.heading_rad] * len(rates), rates])
    return candidates, np.ascontiguousarray(np.pad(first, ((0, 0), (0, fill)), mode="edge"))


def sensitivities(
    stretch: Stretch, point: Point, scales: Scales, start: Start, free: Sequence[int], steps: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return heading, yaw rate, and their derivatives (rows, free parameters + 2) by one-sided differences.

    The last two columns are by the initial heading [rad] and yaw rate [in scales].
    """
    candidates, first = perturbed(point, scales, start, free)
    starts = [Start(heading, rate) for heading, rate in first.T.tolist()]
    heading, rate = trajectories(stretch, candidates, starts, steps)
    width = len(free)
    by_heading, by_rate = np.empty((heading.shape[0], width + 2)), np.empty((heading.shape[0], width + 2))
    for values, result in ((heading, by_heading), (rate, by_rate)):
        slopes = np.empty((heading.shape[0], width + 1))
        differentiate(values, DIFFERENCE, slopes)
        result[:, :width] = slopes[:, :width]
        result[:, width + 1] = slopes[:, width]
    by_heading[:, width] = 1.0
    by_rate[:, width] = 0.0
    return heading[:, 0].copy(), rate[:, 0].copy(), by_heading, by_rate
