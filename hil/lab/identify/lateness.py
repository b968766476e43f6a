"""Whether she answers later, or sooner, than the rudder column and the equation say, and what that does to K and T."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hil.lab.identify.accuracy import information_of, linearised, slow_noise
from hil.lab.identify.fit import Fit
from hil.lab.identify.noise import whitened
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import Linear, State, moved

CERTAIN = 3.0  # standard errors
MATTERS = 0.02  # of K or T


@dataclass(frozen=True, slots=True)
class Lateness:
    """By how much she answers later than the model, how its free coordinates would move with that, and where to."""

    seconds: float
    moved: Floats
    state: State

    def warning(self) -> str:
        """Return what to tell of it, nothing where it hardly changes K or T."""
        if float(np.max(np.abs(self.moved[:2]))) < MATTERS:
            return ""
        if self.seconds > 0.0:
            how, what = "later", "a compass or a servo that is late, slack in the steering, or a second lag"
        else:
            how, what = "sooner", "a rudder feedback that is late"
        gain, lag = (100.0 * (math.exp(min(float(one), 1.0)) - 1.0) for one in self.moved[:2])
        return (
            f"she answers {abs(self.seconds):.2g} s {how} than the rudder column says, as of {what}; "
            f"allowing for it changes K by {gain:+.2g} % and T by {lag:+.2g} %, and the standard errors count that"
        )


def lateness_of(fit: Fit) -> Lateness | None:
    """Take one Gauss-Newton step with a dead time that is free, too; None where it is not certain."""
    problem, free = fit.problem, len(fit.problem.free)
    linears = list(_with_dead_time(fit))
    noise = slow_noise(problem, fit.state, fit.accuracy.noise)
    weights = problem.channel_weights()
    known = information_of(linears, free + 1, noise, problem.data.rows)
    slope = np.zeros(known.own.shape[1])
    for index, linear in enumerate(linears):
        places = [*range(free + 1), free + 1 + 2 * index, free + 2 + 2 * index]
        for weight, by, errors in zip(weights, linear.slopes, linear.errors, strict=True):
            slope[places] += weight * (by.T @ errors)
    step = known.solved(weights, slope)
    spread = math.sqrt(max(float(known.covariance(weights)[free, free]), 0.0))
    late_s = float(step[free])
    if not abs(late_s) > CERTAIN * spread:
        return None
    return Lateness(late_s, step[:free], moved(problem, fit.state, np.delete(step, free)))


def _with_dead_time(fit: Fit) -> Iterator[Linear]:
    """Yield the linearised stretches with one column more, of the dead time: minus the motion's own rate."""
    problem, free = fit.problem, len(fit.problem.free)
    parts = zip(problem.data.stretches, fit.state.starts, linearised(problem, fit.state), strict=True)
    for stretch, start, linear in parts:
        _, rate = problem.motion(stretch, fit.state, start)
        columns = []
        if stretch.heading_rad is not None:
            columns.append(whitened(-rate[:, None], problem.weights.heading_lags)[:, 0])
        if stretch.yaw_rate_rad_s is not None:
            columns.append(-np.gradient(rate, stretch.time_s))
        slopes = tuple(np.insert(by, free, column, axis=1) for by, column in zip(linear.slopes, columns, strict=True))
        yield Linear(linear.errors, slopes)
