"""By how much a fit may be off for reasons that are no noise: each a step of its values, one standard error long."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hil.lab.identify.estimates import Estimates
from hil.lab.identify.fit import Fit
from hil.lab.identify.lateness import Lateness
from hil.lab.identify.loop import Loop
from hil.lab.identify.predict import to_natural
from hil.lab.identify.recording import Floats

ANSWERED_BIAS = 0.25  # of what is unexplained: how far off K and T may be where the rudder answers it


def doubted(estimates: Estimates, fit: Fit, loop: Loop, late: Lateness | None) -> Estimates:
    """Return estimates whose errors allow for a rudder that answers, columns that disagree, and a late answer of hers.

    late: None where nothing is late.
    """
    steps = [*_answers(loop), _disagreement(fit), *([] if late is None else [_moved(fit, late)])]
    by = np.array(steps)[:, list(estimates.free)]
    return replace(estimates, covariance=estimates.covariance + by.T @ by)


def _answers(loop: Loop) -> list[Floats]:
    """Return what a rudder that answers the waves does to ln K and ln T, which are half correlated then."""
    bias = ANSWERED_BIAS * (1.0 - loop.explained) if loop.answered else 0.0
    return [bias * np.array([1.0, 0.5, 0.0, 0.0]), bias * np.array([0.0, math.sqrt(0.75), 0.0, 0.0])]


def _disagreement(fit: Fit) -> Floats:
    """Return what it does to ln K and alpha r^2 that heading and yaw rate turn by different measures."""
    apart = math.log(fit.problem.data.rate_scale)
    return apart * np.array([1.0, 0.0, -2.0 * float(fit.state.point.values[2]), 0.0])


def _moved(fit: Fit, late: Lateness) -> Floats:
    step = np.zeros(4)
    step[list(fit.problem.free)] = to_natural(fit.state.point.values, fit.problem.free)[1] @ late.moved
    return step
