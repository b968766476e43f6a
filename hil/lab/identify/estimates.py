"""The values that a fit stands for, with their covariance, and what an alpha too small to show adds to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hil.lab.identify.accuracy import information, slow_noise
from hil.lab.identify.fit import CUBIC, Fit
from hil.lab.identify.predict import Point, Scales, to_natural
from hil.lab.identify.recording import Floats

LONGEST_ALLOWED = 0.5  # step of ln K, ln T, c and delta0 in scales
NORMAL = 1.96
POSSIBLE_CUBIC = 0.1  # alpha r^2 at the yaw rates of a log in which it does not show, one sigma


@dataclass(frozen=True, slots=True)
class Estimates:
    """Values of ln |K|, ln T, c = alpha r^2 and delta0 in scales, and the covariance of those that `free` names."""

    values: Floats
    free: tuple[int, ...]
    covariance: Floats

    def physical(self, scales: Scales, sign: float) -> tuple[float, float, float, float]:
        """Return K [1/s], T [s], alpha [s^2], delta0 [rad]."""
        ln_gain, ln_lag, cubic, offset = (float(value) for value in self.values)
        return (
            sign * math.exp(ln_gain),
            math.exp(ln_lag),
            cubic / scales.yaw_rate_rad_s**2,
            scales.rudder_middle_rad + offset * scales.rudder_rad,
        )


def estimates_of(fit: Fit) -> Estimates:
    """Return what a fit itself says."""
    return _natural(fit.state.point, fit.problem.free, fit.covariance)


def with_slow_noise(fit: Fit) -> Fit:
    """Return a fit with a covariance that knows of noise slower than the model of it that weighed the channels."""
    noise = slow_noise(fit.problem, fit.state, fit.accuracy.noise, cautious=True)
    accuracy = information(fit.problem, fit.state, noise)
    return replace(fit, covariance=accuracy.covariance(fit.problem.channel_weights()))


def _natural(point: Point, free: tuple[int, ...], covariance: Floats) -> Estimates:
    natural, turn = to_natural(point, free)
    return Estimates(natural, free, turn @ covariance @ turn.T)


def allowing_for_bend(linear: Fit, powers: Sequence[int]) -> Estimates | None:
    """Return a linear fit's values with the errors that a bend adds which is not zero but too small to show.

    The fit to such a boat is off by more than its own standard errors say, for the term acts like a smaller K. So
    it is put back, with what is believed beforehand of its size; the values stay those of the fit, which is the
    model that predicts. powers: of the yaw rate, 3 and 2; what does not show cannot tell them apart, and the mean of
    both is taken. None where one Gauss-Newton step leads too far to be right: then so little is known that it makes
    no difference.
    """
    found = [_allowing(linear, power) for power in powers]
    known = [one for one in found if one is not None]
    if not known:
        return None
    return replace(known[0], covariance=np.mean([one.covariance for one in known], axis=0))


def _allowing(linear: Fit, power: int) -> Estimates | None:
    problem = replace(linear.problem, free=CUBIC)
    point = replace(linear.state.point, power=power)
    state = replace(linear.state, point=point)
    accuracy = information(problem, state, slow_noise(problem, state, linear.accuracy.noise, cautious=True))
    weights = problem.channel_weights()
    normal = problem.normal(state)
    unit = (problem.scales.yaw_rate_rad_s / linear.typical_rate_rad_s()) ** (power - 1)
    place = CUBIC.index(2)
    step, covariance = accuracy.step(normal, weights, place, POSSIBLE_CUBIC * unit)
    if not (np.all(np.isfinite(step)) and np.max(np.abs(step)) < LONGEST_ALLOWED):
        return None
    # The others go with the bend as they would in its fit; of the bend, all that is not below zero counts.
    variance = max(float(covariance[place, place]), 1e-300)
    with_bend = covariance[place] / variance
    counted = (_most(float(step[place]), math.sqrt(variance)) / NORMAL) ** 2
    return _natural(point, CUBIC, covariance + (counted - variance) * np.outer(with_bend, with_bend))


def _most(value: float, spread: float) -> float:
    """Return up to where the 95 % interval reaches of a quantity that cannot be below zero, given an estimate of it.

    An estimate far below zero tells more of what the model lacks than of the quantity: it counts as one standard error
    below at most (Cowan, Cranmer, Gross, Vitells, Power-constrained limits, arXiv:1105.3166).
    """
    return max(value, -spread) + NORMAL * spread
