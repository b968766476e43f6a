"""Whether her damping goes with r |r| rather than with r^3, what that does to K and T, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from hil.lab.identify.accuracy import information
from hil.lab.identify.choice import inflation
from hil.lab.identify.fit import CUBIC, Fit
from hil.lab.identify.recording import Floats
from hil.lab.identify.refine import State, refine

NORMAL = 1.96
MOST_GAIN = 1e3  # beyond, one is certain
TOLD = 0.95
MATTERS = 0.02  # of K or T


@dataclass(frozen=True, slots=True)
class Damping:
    """The rival of a cubic fit: by how much ln K, ln T, alpha r^2 and delta0 move, and what is gained.

    gain: what it takes off -2 ln likelihood, below zero where the cubic model is the likelier one.
    """

    fit: Fit
    moved: Floats
    gain: float

    @property
    def likelihood(self) -> float:
        """How likely it is, of both, by this log alone."""
        return 1.0 / (1.0 + math.exp(-0.5 * min(max(self.gain, -MOST_GAIN), MOST_GAIN)))

    def counted(self, spread: Floats) -> Floats:
        """Return so much of what moves that 1.96 standard errors hold 95 % of what K and T are by both models.

        spread: standard errors of ln K and ln T. Each model is as likely as the log says (Bayesian model averaging,
        Hoeting et al., Statistical Science 14, 1999); the interval stays about the cubic model's values.
        """
        apart = float(np.max(np.abs(self.moved[:2]) / np.maximum(spread, 1e-300)))
        if not apart > 0.0:
            return 0.0 * self.moved

        def too_many(half: float) -> float:
            rival = ndtr(apart - half) + ndtr(-apart - half)
            return float((1.0 - self.likelihood) * 2.0 * ndtr(-half) + self.likelihood * rival - 0.05)

        half = float(brentq(too_many, 0.0, apart + 3.0))
        return self.moved * (math.sqrt(max((half / NORMAL) ** 2 - 1.0, 0.0)) / apart)

    @property
    def told(self) -> bool:
        """Whether the log itself says so."""
        return self.likelihood >= TOLD

    def warning(self) -> str:
        """Return what to tell of it, nothing where it is not told or hardly changes K or T."""
        if not self.told or float(np.max(np.abs(self.moved[:2]))) < MATTERS:
            return ""
        gain, lag = (100.0 * (math.exp(min(float(one), 1.0)) - 1.0) for one in self.moved[:2])
        return (
            f"her damping goes rather with the square of the yaw rate than with its cube ({self.gain:.0f} in -2 ln "
            f"likelihood): K, T and alpha hold at the yaw rates of this log; that damping gives K {gain:+.2g} % and T "
            f"{lag:+.2g} %, which she has at small angles, and the standard errors count that"
        )


def damping_of(fit: Fit, *, asked: bool) -> Damping | None:
    """Fit the rival in the metric of a cubic fit; None where no bend shows.

    Both have as many parameters, so that their likelihoods are compared as they are. asked: the cubic model was
    asked for, and is only doubted where the log itself does.
    """
    problem, point = fit.problem, fit.state.point
    if problem.free != CUBIC or not float(point.values[2]) > 0.0:
        return None
    begin = State(replace(point, power=2), fit.state.starts)
    found = refine(problem, begin)
    if not float(found.state.point.values[2]) > 0.0:
        return None
    better = found.state if found.cost < problem.cost(fit.state) else fit.state
    by_alpha, _ = inflation(problem, fit.state, information(problem, better).noise)
    ours, theirs = (state.point.physical(problem.scales) for state in (fit.state, found.state))
    apart = np.zeros(4)
    apart[:2] = np.log(theirs[:2] / ours[:2])
    apart[3] = (theirs[3] - ours[3]) / problem.scales.rudder_rad
    rival = Damping(replace(fit, state=found.state), apart, (problem.cost(fit.state) - found.cost) / by_alpha)
    return rival if rival.told or not asked else None
